"""Workspace for the steps of a method on a chain, and the data that are kept from one step to the next."""

import functools
import math

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import keep_last
from flexlink.common.types import Array, Indices
from flexlink.describe.schemes.methods import Method
from flexlink.dynamics import rounding
from flexlink.dynamics.floating_base import FAR
from flexlink.dynamics.ties import acting
from flexlink.dynamics.vibration.extremes import Posture, scratch
from flexlink.kernels.bodies.plane import planar_workspace
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.forces.elements import forces_of
from flexlink.kernels.forward.mass_plus import factor_columns
from flexlink.kernels.forward.mass_plus_plane import plane_postures
from flexlink.kernels.forward.mass_plus_shapes import ShapedPosture, shaped_postures
from flexlink.kernels.forward.mass_plus_space import space_postures
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.embedded import EmbeddedMethod, EmbeddedWork
from flexlink.kernels.stepping.error_norm import Springs
from flexlink.kernels.stepping.implicit_layout import VECTOR, ImplicitMethod, ImplicitWork, Turning
from flexlink.kernels.stepping.saturation import Saturation
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.tie_rows import LAW, places_of
from flexlink.kernels.stepping.ties import Answers, Ties
from flexlink.motion.inputs.drives import gains_at_zero
from flexlink.motion.tolerable import read_by
from flexlink.results.record import Record

FEW_PASSES = 12  # Newton iterations of an adaptive step beyond which a shorter step is cheaper


def workspace(method: Method, record: Record, slowest: float) -> EmbeddedWork | ImplicitWork:
    """Workspace of a method's steps on the chain of a record; `slowest`: its lowest natural frequency [rad/s]."""
    of_fixed_step = 50  # Newton iterations, more than for an adaptive step, since a fixed step cannot be shortened
    chain, arrays, n, s = record.chain, record.chain.arrays, record.chain.n, method.stages
    posture = posture_of(chain)
    numbers, new, width = np.zeros(STEPPER.size), np.zeros((3, n)), factor_columns(posture)
    numbers[STEPPER.inverse_ω1], numbers[STEPPER.rounding] = 1.0 / slowest, rounding.of_reach(chain.size)
    numbers[STEPPER.max_iterations] = FEW_PASSES if record.run.controlled else of_fixed_step
    numbers[STEPPER.far] = FAR if chain.has_free_base else 0.0
    gains = own_gains(record)
    kp, kd, kick = (gain.copy() for gain in gains)
    free = (chain.stiffness == 0.0) & (gains[0] == 0.0) & ~chain.held
    numbers[STEPPER.coast] = record.run.duration if record.run.controlled and free.any() else 0.0
    numbers[STEPPER.read] = read_by(method)[1]
    own, forces = (None, None) if arrays.rare is None else (np.zeros((2, n)), forces_of(arrays))
    springs = Springs(kp, kd, own, kick, np.zeros((n, width)), *np.zeros((2, n)))
    inverse = planar_workspace(arrays) if chain.is_planar else rne_workspace(arrays)
    saturation = Saturation(*(gain.copy() for gain in gains[:2]), *np.zeros((5, n)))
    if method.explicit:
        coefficients = EmbeddedMethod(*method.arrays, method.error, *(method.dense or (None, None, None)))
        K, L = np.zeros((2, s + 1 + method.more_stages, n))
        (Q, tau), e = np.zeros((2, 2, n))
        powers = 0 if method.dense is None else method.dense[2].shape[2]
        return EmbeddedWork(
            coefficients, arrays, record.scratch, posture, numbers, new, K, L, np.zeros(len(K)),
            np.zeros((2, powers, n)), np.zeros(powers), Q, tau, e, springs, saturation, forces,
            *((ties_of(record, 1, 1, 0), np.zeros((1, n, width)), np.zeros((VECTOR.size, n)), inverse)
              if record.tied else ()),
        )  # fmt: skip
    r, p = len(method.modes.real), len(method.modes.complex)
    # largest number of joints, since the cost of the small matrix grows as (stages · joints)³; few fixed steps need it
    most = 8 if record.run.controlled else 40
    if record.tied:
        most = 0  # responses to friction do not contain the ties, so friction is linearized
    turning, with_error = turning_of(chain, most, s, r, p), record.run.controlled and method.controlled
    numbers[STEPPER.wait] = 0.0 if with_error else np.inf
    # Factor on the error of a step in which dry friction stops or releases a joint: the stages K jump there, and the
    # error of the joint's rate persists. Measured on stick-slip motion with widths from 1e-1 to 1e-6 rad/s, errors at
    # the end are at most 2.5 tolerances; with a factor of 1 they are up to 14
    numbers[STEPPER.turning] = 4.0 if with_error and len(turning.joints) == len(turning.dry) else 0.0
    return ImplicitWork(
        coefficients_of(method), arrays, inverse, forces, posture, numbers, new,
        np.zeros((6, s, n)), np.zeros(s), np.zeros((VECTOR.size, n)), springs, saturation,
        np.zeros((r, n, width)), np.zeros((2, n), complex), np.zeros((p, n, width), complex),
        stage_postures(chain, s, posture), np.zeros((s, n, width)), turning, ties_of(record, s, r, p),
    )  # fmt: skip


def ties_of(record: Record, s: int, real: int, pairs: int) -> Ties | None:
    """Workspace for the ties of a record's problem and a method with s stages; None for an open chain."""
    given, chain = record.problem.ties, record.chain
    if given is None:
        return None
    rows, lengths = acting(given, chain)
    r, n = len(rows), chain.n
    λ, last, gap = np.zeros((3, s, r))
    J, middle = np.zeros((2, r, n))
    of_real, of_pairs, again = (
        Answers(*(np.zeros(shape, kind) for shape in ((p, r, n), (p, r, r), (p, r, r), (p, r), r, r, n)))
        for p, kind in ((real, float), (pairs, complex), (1, float))
    )
    held, ranges = np.isinf(rows["stiffness"]), (rows["low"] < rows["high"]) | (rows["bulk"] > 0)
    numbers = np.array([np.count_nonzero(ranges), 0, np.count_nonzero(~held), np.count_nonzero(chain.held)])
    law = np.where(held, LAW.held, LAW.free)
    return Ties(
        rows, np.array([chain.size]), numbers, lengths, np.zeros((3, r)), law, np.full(r, np.nan),
        λ, last, gap, np.zeros((2, r)), np.zeros(2), np.zeros((2, r)), places_of(chain.arrays), J, middle,
        of_real, of_pairs, again, np.zeros(r), np.zeros(6),
    )  # fmt: skip


def stage_postures(chain: Chain, s: int, posture: Posture) -> Posture:
    """Workspace for the configurations of s stages."""
    if isinstance(posture, ShapedPosture):
        found: Posture = shaped_postures(s, posture, stage_postures(chain, s, posture.hinges))
        return found
    found = (plane_postures if chain.is_planar else space_postures)(s, posture)
    return found


def posture_of(chain: Chain) -> Posture:
    """Workspace for configurations of the chain, with the radii that convert rotations into lengths."""
    return scratch(chain)._replace(radius=chain.turning_radii)


def own_gains(record: Record) -> tuple[Array, Array, Array]:
    """The `drive_gains` of the drive of a record."""
    return record.kept("gains", id(record.inputs), lambda: drive_gains(record.chain, record.inputs))


def drive_gains(chain: Chain, inputs: Inputs) -> tuple[Array, Array, Array]:
    """Gains k_p, k_d (n,) of the drive for Newton's matrix, and T k_d if it is sampled with period T; read-only."""
    drive = inputs.drive
    kick = gains_at_zero(drive, chain, True).diagonals()[1] / drive.rate if drive.rate else np.zeros(chain.n)
    return *gains_at_zero(drive, chain).diagonals(), kick


def remembered(work: EmbeddedWork | ImplicitWork) -> tuple[Array, ...]:
    """Arrays that are kept from one step to the next; all others are temporary."""
    springs = work.springs
    return work.stepper, springs.kp, springs.kd, springs.impulse, *work.saturation[:2], *stages_of(work)


def stages_of(work: EmbeddedWork | ImplicitWork) -> tuple[Array, ...]:
    """What the next step starts from: slopes of force elements, stages of the last step, forces and laws of ties."""
    stages = () if work.springs.own is None else (work.springs.own,)
    stages += (work.stages,) if isinstance(work, ImplicitWork) else ()
    return stages if work.ties is None else (*stages, work.ties.λ, work.ties.last, work.ties.left, work.ties.used)


def friction_laws(work: EmbeddedWork | ImplicitWork) -> tuple[float, ...]:
    """Values of STEPPER.turning for parts of fixed steps: a linearized law, then the nonlinear one if there is room."""
    dry = isinstance(work, ImplicitWork) and 0 < len(work.turning.dry) == len(work.turning.joints)
    return (0.0, math.inf) if dry else (0.0,)


def turning_of(chain: Chain, most: int, stages: int, r: int, p: int) -> Turning:
    """Workspace for up to `most` joints whose friction reverses in a step; r real eigenvalues, p complex pairs."""
    coulomb = chain.hinges["coulomb"]
    if not any(coulomb.tolist()):
        return without_friction(chain.n, stages, r, p)._replace(count=np.zeros(1, np.int64))
    dry = np.flatnonzero((coulomb > 0) & ~chain.held)
    return turning_at(dry, min(most, len(dry)), chain.n, stages, r, p)


@functools.cache
def without_friction(n: int, stages: int, r: int, p: int) -> Turning:
    """Workspace for chains without dry friction; runs share all its arrays except the count."""
    return turning_at(np.empty(0, np.int64), 0, n, stages, r, p)


def turning_at(dry: Indices, d: int, n: int, stages: int, r: int, p: int) -> Turning:
    """Workspace for d of these joints with dry friction, among n joints."""
    G, J = np.zeros((2, stages * d, stages * d))
    rows, probe = np.zeros((5, stages * d)), np.zeros((3, stages * d))
    real, pairs = np.zeros((r, d, n)), np.zeros((p, d, n), complex)
    return Turning(dry, np.zeros(d, np.int64), np.zeros(1, np.int64), G, J, rows, probe, real, pairs)


@keep_last(32)
def coefficients_of(method: Method) -> ImplicitMethod:
    """Coefficients of an implicit method in the form that its kernel takes."""
    (A, b, c), modes = method.arrays, method.modes
    γ, d = method.embedded if method.controlled else (0.0, np.zeros(method.stages))
    return ImplicitMethod(
        np.array([A, modes.A2]), np.array([b, modes.bA, c, d]), γ, modes.real, modes.T_real, modes.Tinv_real,
        modes.complex, modes.T_complex, modes.Tinv_complex, dense_weights(c),
    )  # fmt: skip


def dense_weights(c: Array) -> Array:
    """Coefficients (2, s, s) of β_i(x)/x and α_i(x)/x²: the Lagrange polynomials of c integrated once and twice."""
    m = np.arange(len(c))
    once = np.linalg.inv(c[:, None] ** m).T / (m + 1)
    return np.array([once, once / (m + 2)])
