"""The checked public functions of a chain: shapes and finiteness here, then the kernel.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX                         (paper, equations 2 and 3)

All torques are in N m, all angles in rad, arrays are float64 of shape (n,) in sequential order. The tip wrench
(f_x, f_y, f_z, m_x, m_y, m_z) [N, N m] acts on the arm at the origin of the tip frame, in axes of frame 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain import Chain
from flexlink.checks import all_given, beyond_float64, choice, dimensions, given, matrix, vector, wrench_vector
from flexlink.errors import ArgumentError
from flexlink.kernels import forward, mass
from flexlink.kernels.energy import energies
from flexlink.kernels.finite import is_finite
from flexlink.kernels.kinematics import kinematics
from flexlink.kernels.lanes import LANES
from flexlink.kernels.rne import inverse_dynamics as inverse_dynamics_kernel
from flexlink.singularity import no_acceleration

Array = NDArray[np.float64]

MASS_METHODS = {
    "columns": mass.mass_columns,
    "lower": mass.mass_lower,
    "upper": mass.mass_upper,
    "composite": mass.mass_composite,
}
SOLVERS = {"articulated": forward.ARTICULATED, "lu": forward.LU, "cholesky": forward.CHOLESKY}


class Energy(NamedTuple):
    """Energies [J]: scalars for one state, arrays over samples in a `Trajectory`."""

    kinetic: Array | float
    gravity: Array | float  # zero when all mass is at the origin of frame 0
    elastic: Array | float

    @property
    def total(self) -> Array | float:
        """Kinetic + gravity + elastic."""
        return self.kinetic + self.gravity + self.elastic


class Frames(NamedTuple):
    """Where the `chain.bodies` are, in frame 0; the last one is the tip frame."""

    rotations: Array  # (bodies, 3, 3), R: v_0 = R v_body
    points: Array  # (bodies, 3), origins [m]


def inverse_dynamics(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tip_wrench: ArrayLike | None = None
) -> Array:
    """Torque M q̈ + T_GC that the rigid-body motion takes, without springs and friction.

    Recursive Newton-Euler (Luh, Walker & Paul 1980; paper, section 3).

    Parameters
    ----------
    chain
        The chain.
    q, qd, qdd
        Angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,).
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Returns
    -------
    Array
        τ = M(q) q̈ + T_GC(q, q̇), shape (n,) [N m].

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a torque is beyond float64.
    """
    n = given("chain", chain, Chain).n
    q, qd, qdd, wrench = vector("q", q, n), vector("qd", qd, n), vector("qdd", qdd, n), wrench_vector(tip_wrench)
    tau: Array = inverse_dynamics_kernel(chain.arrays, wrench, q, qd, qdd)
    if not is_finite(tau):
        raise beyond_float64(_at("torque", chain, tau), q=q, qd=qd, qdd=qdd, tip_wrench=wrench, gravity=chain.gravity)
    return tau


def _at(what: str, chain: Chain, values: Array) -> str:
    """Words for the first of `values`, one per joint, that is not finite."""
    return f"the {what} of joint {chain.joint_name(int(np.argmin(np.isfinite(values))))!r}"


def bias_torque(chain: Chain, q: ArrayLike, qd: ArrayLike, tip_wrench: ArrayLike | None = None) -> Array:
    """T_GC: gravity, Coriolis, centrifugal and tip wrench torques, `inverse_dynamics` with q̈ = 0 (paper, eq. 3).

    Parameters, shapes and errors are those of `inverse_dynamics`. Pinocchio calls it `nle`, MuJoCo `qfrc_bias`.
    """
    return inverse_dynamics(chain, q, qd, np.zeros(given("chain", chain, Chain).n), tip_wrench)


def gravity_torque(chain: Chain, q: ArrayLike) -> Array:
    """T_G: the torque that holds the arm against gravity, T_GC with q̇ = 0, shape (n,) [N m].

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    """
    return bias_torque(chain, q, np.zeros(given("chain", chain, Chain).n))


def elastic_torque(chain: Chain, q: ArrayLike) -> Array:
    """T_FL = k (θ − θ₀) on passive joints, 0 on active ones, shape (n,) [N m].

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite, or a torque is beyond float64.
    """
    q = vector("q", q, given("chain", chain, Chain).n)
    with np.errstate(over="ignore"):
        torque: Array = chain.stiffness * (q - chain.rest)
    if not is_finite(torque):
        raise beyond_float64(_at("elastic torque", chain, torque), q=q)
    return torque


def friction_torque(chain: Chain, qd: ArrayLike) -> Array:
    """T_FR = d q̇ + c tanh(q̇ / w), shape (n,) [N m].

    d is viscous friction on active joints and structural damping on passive ones; c is the Coulomb torque and w the
    `coulomb_width` over which the law turns round smoothly.

    Raises
    ------
    ArgumentError
        `qd` has the wrong shape, is not real or not finite, or a torque is beyond float64.
    """
    qd = vector("qd", qd, given("chain", chain, Chain).n)
    hinges = chain.hinges
    with np.errstate(over="ignore"):  # far beyond the width tanh is 1
        torque: Array = hinges["damping"] * qd + hinges["coulomb"] * np.tanh(qd / hinges["coulomb_width"])
    if not is_finite(torque):
        raise beyond_float64(_at("friction torque", chain, torque), qd=qd)
    return torque


def mass_matrix(chain: Chain, q: ArrayLike, method: str = "composite") -> Array:
    """Joint-space inertia M(q), symmetric positive definite, shape (n, n) [kg m²].

    Parameters
    ----------
    chain
        The chain.
    q
        Angles [rad], shape (n,).
    method
        "columns", "lower", "upper": methods 1, 2, 3 of Walker & Orin (1982), as named in the paper;
        "composite": composite rigid bodies in inertial axes (Featherstone 2008, section 6.2), the fastest.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite, the method is unknown, or M is beyond float64.
    """
    q = vector("q", q, given("chain", chain, Chain).n)
    M = np.zeros((chain.n, chain.n))
    trace = choice("method", method, MASS_METHODS)(chain.arrays, q, M)
    if not math.isfinite(trace):
        raise ArgumentError(f"the mass matrix of {chain.name!r} is beyond float64; expected smaller masses and lengths")
    return M


def forward_dynamics(
    chain: Chain | Sequence[Chain],
    q: ArrayLike,
    qd: ArrayLike,
    tau: ArrayLike,
    method: str = "articulated",
    tip_wrench: ArrayLike | None = None,
) -> Array:
    """Accelerations q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR, shape (n,) [rad/s²], or (b, n) for b states at once.

    A joint whose motion is prescribed keeps its rate here, q̈ = 0, whatever `tau` says.

    Parameters
    ----------
    chain
        The chain; with (b, n) states also b chains of one layout (`Chain.same_layout`), such as an arm with b payloads.
    q, qd, tau
        Angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,), or all (b, n): "articulated" then takes
        eight states side by side.
    method
        "articulated": articulated bodies (Featherstone 1983), O(n), of plane motion where `chain.is_planar`;
        "lu": LU decomposition of M, the paper's; "cholesky": M = L Lᵀ.
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Raises
    ------
    ArgumentError
        An argument has a wrong shape, is not real or finite, unknown method, chains of different layout, q̈ overflows.
    SingularMassError
        A joint moves no inertia of its own here; to "lu" and "cholesky" next to gimbal lock of a passive group, too.
    """
    if not isinstance(chain, Chain) or dimensions(q) == 2:
        chains = _of_one_layout(chain)
        solver = solver_for(chains[0], method)
        return _forward_dynamics_of_many(chains, solver, q, qd, tau, wrench_vector(tip_wrench))
    n, solver = chain.n, solver_for(chain, method)
    q, qd, tau = vector("q", q, n), vector("qd", qd, n), vector("tau", tau, n)
    wrench = wrench_vector(tip_wrench)
    qdd: Array = solver.accelerations(chain.arrays, wrench, q, qd, tau)
    if is_finite(qdd):
        return qdd
    raise no_acceleration(chain, solver, wrench, q, qd, tau)


def _of_one_layout(chain: Chain | Sequence[Chain]) -> Sequence[Chain]:
    chains = [chain] if isinstance(chain, Chain) else all_given("chain", chain, Chain)
    if not chains:
        raise ArgumentError("chain: no chain given; expected one, or one per state")
    for k, other in enumerate(chains):
        if not chains[0].same_layout(other):
            raise ArgumentError(f"chain[{k}]: differs from chain[0] in more than numbers; expected one layout")
    return chains


def _forward_dynamics_of_many(
    chains: Sequence[Chain], solver: forward.Solver, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, wrench: Array
) -> Array:
    if dimensions(q) != 2:
        raise ArgumentError(f"q has {dimensions(q)} dimensions; many chains take 2, of shape (b, {chains[0].n})")
    shape = b, _ = np.shape(q)[0], chains[0].n
    states = [matrix(name, value, shape) for name, value in (("q", q), ("qd", qd), ("tau", tau))]
    if len(chains) not in {1, b}:
        raise ArgumentError(f"chain: {len(chains)} chains; expected one, or one per state, {b}")
    if b == 0:
        return np.zeros(shape)
    qdd = _side_by_side(chains, solver, wrench, states)
    if not is_finite(qdd.reshape(-1)):
        state = int(np.argmin(np.isfinite(qdd).all(axis=1)))
        error = no_acceleration(chains[state % len(chains)], solver, wrench, *(part[state] for part in states))
        raise type(error)(f"state {state}: {error}")
    return qdd


def _side_by_side(chains: Sequence[Chain], solver: forward.Solver, wrench: Array, states: Sequence[Array]) -> Array:
    if solver.lanes_workspace is None:
        singles = zip(itertools.cycle(chains), zip(*states, strict=True), strict=False)
        return np.array([solver.accelerations(chain.arrays, wrench, *state) for chain, state in singles])
    b = len(states[0])
    size = b if len(chains) == 1 else LANES  # states that one scratch serves
    parts = [slice(start, start + size) for start in range(0, b, size)]
    works = (lanes_workspace(solver, chains[part]) for part in parts)
    many = forward.accelerations_of_many
    qdd = [many(work, wrench, *(s[part] for s in states)) for part, work in zip(parts, works, strict=True)]
    return np.concatenate(qdd)


def lanes_workspace(solver: forward.Solver, chains: Sequence[Chain]) -> Any:
    """Scratch of eight chains of one layout side by side; the last one given fills up the eight."""
    if solver.lanes_workspace is None:
        raise ArgumentError("method: only 'articulated' takes chains side by side")
    eight = [chains[min(lane, len(chains) - 1)] for lane in range(LANES)]
    return solver.lanes_workspace(
        np.array([c.bodies for c in eight]), np.array([c.hinges for c in eight]), np.array([c.gravity for c in eight])
    )


def solver_for(chain: Chain, method: str) -> forward.Solver:
    """The solver that `method` means for this chain.

    Raises
    ------
    ArgumentError
        The method is unknown.
    """
    solver = choice("method", method, SOLVERS)
    return forward.PLANAR if solver is forward.ARTICULATED and chain.is_planar else solver


def energy(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Energy:
    """Kinetic ½ q̇ᵀMq̇, gravity −Σ m g·p and elastic Σ ½ k (θ − θ₀)² energy [J].

    Raises
    ------
    ArgumentError
        `q` or `qd` has the wrong shape, is not real or not finite, or an energy is beyond float64.
    """
    n = given("chain", chain, Chain).n
    q, qd = vector("q", q, n), vector("qd", qd, n)
    found = Energy(*energies(chain.arrays, q, qd))
    if not math.isfinite(found.total):
        name = next((name for name, value in found._asdict().items() if not math.isfinite(value)), "total")
        raise beyond_float64(f"the {name} energy", q=q, qd=qd, gravity=chain.gravity)
    return found


def frames(chain: Chain, q: ArrayLike) -> Frames:
    """Rotation and origin of every body frame in frame 0; the last one is the tip frame.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    """
    bodies = len(given("chain", chain, Chain).bodies)
    placed = Frames(np.empty((bodies, 3, 3)), np.empty((bodies, 3)))
    kinematics(chain.arrays, vector("q", q, chain.n), placed.rotations, placed.points, np.empty((chain.n, 3)))
    return placed


def tip_position(chain: Chain, q: ArrayLike) -> Array:
    """Origin of the tip frame in frame 0, shape (3,) [m]; errors as in `frames`."""
    tip: Array = frames(chain, q).points[-1]
    return tip
