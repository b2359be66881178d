"""A scene's drive as the arrays of its control law, and the slopes that they give a chain."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.rigidified import rigidified
from flexlink.describe.scene import Scene
from flexlink.dynamics.terms import gravity_torque
from flexlink.dynamics.vibration.stability import Gains
from flexlink.inputs.interpolation import held_knots, pieces_of
from flexlink.inputs.references import ReferenceArrays, constant, reference_arrays
from flexlink.inputs.static_feedforward import holding_torque
from flexlink.kernels.bodies.rigid_model import RigidModel
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.inputs.drive_torque import SampledLaw, drive_torque
from flexlink.kernels.inputs.law_computed_torque import ComputedTorqueLaw
from flexlink.kernels.inputs.law_pd import PdLaw
from flexlink.kernels.inputs.law_pd_gravity import GravityPdLaw
from flexlink.kernels.inputs.law_table import TableLaw

Array = NDArray[np.float64]
Law = TableLaw | PdLaw | GravityPdLaw | ComputedTorqueLaw
Drive = Law | SampledLaw

NUDGE = 1e-5
"""Angle [rad], or rate, of the central differences of a law; of a linear one they are exact but for rounding."""


def drive_arrays(scene: Scene, chain: Chain) -> Drive:
    """The scene's drive; no driven joint at all where it has nothing to say.

    Raises
    ------
    SceneError
        The torques change by more than float64 can hold.
    ConvergenceError
        gravity = "static", and the arm finds no equilibrium at the reference.
    """
    law = LAWS[scene.drive.kind if len(chain.active) else "none"](scene, chain)
    return law if scene.drive.rate is None else _sampled(scene, law)


def held(chain: Chain, times: Array, torques: Array, effort: Array | None = None) -> TableLaw:
    """A drive of torques (m, d) at the driven joints, each row held until the next time."""
    limits = np.full(len(chain.active), np.inf) if effort is None else effort
    return TableLaw(chain.active.copy(), limits, held_knots(times), np.ascontiguousarray(torques[:, None]))


def effort_of(scene: Scene, chain: Chain) -> Array:
    """Largest torque of every driven joint [N m], shape (d,); inf where none is said."""
    effort = scene.drive.effort
    return np.full(len(chain.active), np.inf) if effort is None else of_joints(chain, effort)


def same_law(a: Drive, b: Drive) -> bool:
    """Whether two drives are one, and act on eight chains side by side: of numbers that are the same for all."""
    if not (isinstance(a, TableLaw | PdLaw) and type(a) is type(b)):
        return False
    return all(np.array_equal(x, y) for x, y in zip(_arrays(a), _arrays(b), strict=True))


def _arrays(of: tuple[Any, ...]) -> Iterator[Array]:
    for part in of:
        yield from _arrays(part) if isinstance(part, tuple) else [part]


def remembered(drive: Drive) -> tuple[Array, ...]:
    """The arrays of a drive that a run changes."""
    return (drive.held, drive.asked) if isinstance(drive, SampledLaw) else ()


def gains_of(chain: Chain, drive: Drive, t: float, q: Array, qd: Array) -> Gains:
    """−∂T_EX/∂q and −∂T_EX/∂q̇ of a drive at a state, apart from its limits; those of a sampled one are zero.

    Shape (n,) each if every joint's torque depends on its own motion only, else (n, n).
    """
    n, joints = chain.n, drive.joints
    if not len(joints):
        return Gains(*np.zeros((2, n)))
    slopes = np.zeros((2, n, len(joints)))
    if not isinstance(drive, SampledLaw):
        law, state = drive._replace(effort=np.full(len(joints), np.inf)), np.array([q, qd])
        for part in range(2):
            for d, k in enumerate(joints):
                ends = np.zeros((2, n))
                for side, end in zip((-1, 1), ends, strict=True):
                    there = state.copy()
                    there[part, k] += side * NUDGE
                    drive_torque(law, t, t, there[0], there[1], end)
                slopes[part, :, d] = (ends[0] - ends[1]) / (2 * NUDGE)
    own = slopes[:, joints]
    if not np.any(own - own * np.eye(len(joints))):
        diagonal = np.zeros((2, n))
        diagonal[:, joints] = np.diagonal(own, axis1=1, axis2=2)
        return Gains(*diagonal)
    whole = np.zeros((2, n, n))
    whole[:, :, joints] = slopes
    return Gains(*whole)


def _table(scene: Scene, chain: Chain) -> TableLaw:
    drive, joints = scene.drive, chain.active.copy()
    times = np.array(drive.times or (0.0,))
    torques = np.array([of_joints(chain, row) for row in drive.torques or (drive.torque,)])
    if drive.hold:
        return held(chain, times, torques, effort_of(scene, chain))
    coefficients = pieces_of("drive.torques", times, torques, smooth=drive.smooth)
    return TableLaw(joints, effort_of(scene, chain), times, coefficients)


def _none(scene: Scene, chain: Chain) -> TableLaw:
    return TableLaw(np.empty(0, np.intp), np.empty(0), np.zeros(1), np.zeros((1, 2, 0)))


def _pd(scene: Scene, chain: Chain) -> PdLaw | GravityPdLaw:
    """A feed-forward of a reference that stays is computed once, the rigid model's of one that moves at every stage."""
    drive, target = scene.drive, reference_arrays(scene, chain)
    joints, effort, kp, kd = chain.active.copy(), effort_of(scene, chain), *_gains(scene, chain)
    still = len(target.knots) == 1 and not target.coefficients[:, 1:].any()
    if drive.gravity == "rigid" and not still:
        return GravityPdLaw(joints, effort, target, kp, kd, _model(scene))
    return PdLaw(joints, effort, target, kp, kd, GRAVITY[drive.gravity](scene, chain, target))


def _computed_torque(scene: Scene, chain: Chain) -> ComputedTorqueLaw:
    joints, effort, kp, kd = chain.active.copy(), effort_of(scene, chain), *_gains(scene, chain)
    return ComputedTorqueLaw(joints, effort, reference_arrays(scene, chain), kp, kd, _model(scene))


LAWS: dict[str, Callable[[Scene, Chain], Law]] = {
    "none": _none,
    "constant": _table,
    "table": _table,
    "pd": _pd,
    "computed_torque": _computed_torque,
}
"""By the kind of the drive."""


def _sampled(scene: Scene, law: Law) -> SampledLaw:
    """A law that is asked at instants, counted from t = 0, with room for what it gives at all of a run's."""
    run, rate = scene.run, float(scene.drive.rate or 0.0)
    if not run.controlled:
        rate = 1.0 / (round(1.0 / (rate * run.step)) * run.step)  # as far from the decimal one as the step
    rows = round(run.duration * rate) + 2
    return SampledLaw(law, law.joints, law.effort, rate, np.zeros((rows, len(law.joints))), np.zeros(1, np.int64))


def _gains(scene: Scene, chain: Chain) -> tuple[Array, Array]:
    drive = scene.drive
    return of_joints(chain, drive.kp), of_joints(chain, drive.kd)


def _model(scene: Scene) -> RigidModel:
    chain = lump(rigidified(scene)).arrays
    return RigidModel(chain, rne_workspace(chain), np.zeros(6), *np.zeros((4, len(chain.hinges))))


def _no_gravity(scene: Scene, chain: Chain, target: ReferenceArrays) -> ReferenceArrays:
    return constant(np.zeros(len(chain.active)))


def _rigid_gravity(scene: Scene, chain: Chain, target: ReferenceArrays) -> ReferenceArrays:
    """Of the rigid model at the reference."""
    return constant(gravity_torque(lump(rigidified(scene)), target.coefficients[0, 0]))


def _static_gravity(scene: Scene, chain: Chain, target: ReferenceArrays) -> ReferenceArrays:
    """Of the arm, bent by gravity with its joints at the reference."""
    return holding_torque(chain, target)


GRAVITY = {"none": _no_gravity, "rigid": _rigid_gravity, "static": _static_gravity}
"""Feed-forward of a reference that does not move, by the drive's `gravity`."""


def of_joints(chain: Chain, per_link: tuple[float, ...] | None) -> Array:
    """Of numbers per link those of the driven joints, shape (d,)."""
    numbers = per_link or (0.0,) * len(chain.link_names)
    return np.array([numbers[chain.coordinates[k].link - 1] for k in chain.active], dtype=np.float64)
