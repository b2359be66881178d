"""Forward dynamics, M q̈ = T_EX − T_GC − T_FL − T_FR − T_DRAG, for one state, many states, or chains of one layout."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import NO_WRENCH, require_each, require_one_of, vector
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import BASE_AXES
from flexlink.common.errors import ArgumentError, FlexlinkError, SingularMassError
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.describe.run_settings import ForwardSolver
from flexlink.dynamics.batches import about_state, each, is_batch, rows
from flexlink.dynamics.bound import Bound, bound
from flexlink.dynamics.forces import all_torques, world_wrench, world_wrenches
from flexlink.kernels.bodies.plane import planar_workspace
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.forward import solvers
from flexlink.kernels.forward.shaped import shaped_workspace
from flexlink.kernels.layout import ChainArrays, Rare
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import LANES

SOLVERS: dict[ForwardSolver, solvers.Solver] = {
    "articulated": solvers.ARTICULATED, "lu": solvers.LU, "cholesky": solvers.CHOLESKY,
}  # fmt: skip


PITCH = BASE_AXES.index(1)  # index of the free base's rotation about Y among the coordinates


def forward_dynamics(
    chain: Chain | Sequence[Chain], q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *,
    tip_wrench: ArrayLike | None = None, frame: Frame = "world", solver: str = "articulated",
) -> Array:  # fmt: skip
    """Accelerations q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR − T_DRAG.

    Pinocchio calls it `aba`, MuJoCo `mj_forward`. A joint with prescribed motion has a constant rate here, q̈ = 0, for
    any `tau`.

    Parameters
    ----------
    chain
        The chain; or, for b states, b chains of the same layout (`Chain.same_layout`), such as an arm with b payloads.
    q, qd, tau
        Angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,), or (b, n) for b states; arrays of shape
        (n,) apply to all states. "articulated" computes eight states at a time.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], or one row per state, (b, 6), in axes of frame 0, "world", or
        of the "tip" frame.
    solver
        "articulated": articulated-body algorithm (Featherstone 1983), O(n), in a planar version if `chain.is_planar`;
        "lu": LU decomposition of M, as in the paper; "cholesky": M = L Lᵀ.

    Returns
    -------
    Array
        q̈, shape (n,), or (b, n) [rad/s²].

    Raises
    ------
    ArgumentError
        An argument has a wrong shape, is not real or finite; the solver is unknown; the chains differ in layout; or q̈
        overflows.
    SingularMassError
        A joint has no inertia attached in this configuration, or a free base's angle about Y is 90°. "lu" and
        "cholesky" also fail close to gimbal lock of a passive group.

    Examples
    --------
    >>> free = fl.forward_dynamics(chain, q, qd, tau)
    >>> held = fl.forward_dynamics(chain, q, qd, tau=fl.gravity_torque(chain, q) + fl.elastic_torque(chain, q))
    >>> print(free[0].round(2), abs(held).max() < 1e-9)  # rad/s²
    -151.15 True
    """
    usual = type(solver) is str and solver == "articulated"
    if usual and type(chain) is Chain and tip_wrench is None and type(frame) is str and frame == "world":
        qdd = np.empty(chain.n)
        if accelerations(chain)(NO_WRENCH, q, qd, tau, qdd):
            return qdd
    if not isinstance(chain, Chain) or is_batch(q, qd, tau):
        return _forward_dynamics_of_many(chain, solver, tip_wrench, frame, q, qd, tau)
    n, kernel = chain.n, solver_for(chain, solver)
    q, qd, tau = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("tau", tau, n, many=True)
    wrench = world_wrench(chain, q, tip_wrench, frame)
    if error := base_without_rates(chain, q):
        raise error
    qdd = np.empty(n)
    by_solver = accelerations(chain) if usual else accelerations(chain, solver)
    if by_solver(wrench, q, qd, tau, qdd):
        return qdd
    raise _no_acceleration(chain, kernel, wrench, q, qd, tau)


@bound
def accelerations(chain: Chain, solver: str = "articulated") -> Bound:
    """Forward dynamics of a chain by a solver, a function of (wrench, q, qd, tau, qdd); False in gimbal lock."""
    found = solver_for(chain, solver).bound(chain.arrays)
    if not chain.has_free_base:
        return found

    def of_free_base(wrench: Array, q: Array, qd: Array, tau: Array, qdd: Array) -> bool:
        return found(wrench, q, qd, tau, qdd) and not base_without_rates(chain, q)

    of_free_base.quick = of_free_base  # type: ignore[attr-defined]
    return of_free_base


def released(chain: Chain) -> Chain:
    """The chain with prescribed joints that move by forces."""
    hinges = chain.hinges.copy()
    hinges["prescribed"] = 0
    return dataclasses.replace(chain, hinges=hinges)


def accelerations_under(tau: Array, chain: Chain, q: Array, qd: Array, wrench: Array) -> Array:
    """q̈ (samples, n) under torques that include those of prescribed motions, and tip wrenches (samples, 6)."""
    # state by state: the batched function takes seconds to compile, and its results are identical bit for bit
    return each(forward_dynamics, released(chain), {"q": q, "qd": qd, "tau": tau}, tip_wrench=wrench)


def base_without_rates(chain: Chain, q: ArrayLike) -> FlexlinkError | None:
    """Return the error for a free base in gimbal lock: its angle about Y is within 3e-8 rad of 90°.

    The other two angles then turn about the same axis. A pivot of M is proportional to cos² of the angle about Y, and
    is then below its rounding error.
    """
    if not chain.has_free_base or np.cos(np.asarray(q)[PITCH]) ** 2 >= 4 * np.finfo(float).eps:
        return None
    pitch = f"{chain.joint_name(PITCH)} = {chain.place_in_words(PITCH, float(np.asarray(q)[PITCH]))}"
    remedy = "set another reference attitude, initial.base.rpy_deg, as simulations do automatically"
    why = f"mass matrix of {chain.name!r} is singular: at {pitch} the base's angles are in gimbal lock; {remedy}"
    return SingularMassError(why, id="attitude-singular")


def _no_acceleration(chain: Chain, *state: Any) -> FlexlinkError:
    """The error for a state whose q̈ is not finite."""
    from flexlink.dynamics.singularity import no_acceleration  # noqa: PLC0415  explains what rarely happens

    return no_acceleration(chain, *state)


def _forward_dynamics_of_many(
    chain: Chain | Sequence[Chain], solver: str, tip_wrench: ArrayLike | None, frame: Frame, *state: ArrayLike
) -> Array:
    chains = [chain] if isinstance(chain, Chain) else require_each("chain", chain, Chain)
    if not chains:
        raise ArgumentError("chain: no chain given; expected one, or one per state", id="wrong-shape")
    for k, other in enumerate(chains):
        if not chains[0].same_layout(other):
            why = f"chain[{k}]: joints or bodies differ from chain[0]; only their values may differ"
            raise ArgumentError(why, id="chains-differ")
    n, kernel = chains[0].n, solver_for(chains[0], solver)
    if not is_batch(*state):
        why = f"q, qd, tau: a list of chains needs one state per chain; give at least one of them as (b, {n})"
        raise ArgumentError(why, id="wrong-shape")
    states = rows(n, dict(zip(("q", "qd", "tau"), state, strict=True)))
    b = len(states[0])
    if len(chains) not in {1, b}:
        raise ArgumentError(f"chain: {len(chains)} chains; expected one, or one per state, {b}", id="wrong-shape")
    if b == 0:
        return np.zeros((b, n))
    wrenches = world_wrenches(chains, states[0], tip_wrench, frame)
    if any(each.forces for each in chains):
        q, qd, tau = states
        one = len(chains) == 1
        states[2] = tau - (all_torques(chains[0], q, qd) if one else np.array([*map(all_torques, chains, q, qd)]))
        chains = [each.without_forces() for each in chains]
    for k, q in enumerate(states[0] if chains[0].has_free_base else ()):
        if error := base_without_rates(chains[k % len(chains)], q):
            raise about_state(k, error)
    qdd = _side_by_side(chains, kernel, [wrenches, *states])
    if not is_finite(qdd.reshape(-1)):
        k = int(np.argmin(np.isfinite(qdd).all(axis=1)))
        culprit = chains[k % len(chains)]
        raise about_state(k, _no_acceleration(culprit, kernel, wrenches[k], *(part[k] for part in states)))
    return qdd


def _side_by_side(chains: Sequence[Chain], solver: solvers.Solver, states: Sequence[Array]) -> Array:
    """Return q̈, shape (b, n), for b wrenches (b, 6), and angles, rates and torques (b, n)."""
    if solver.lanes_workspace is None:
        own = [(chain, solver if chain.shapes is None else _shaped_solver(chain)) for chain in chains]
        found, each = np.full(states[1].shape, np.nan), [kernel.bound(chain.arrays) for chain, kernel in own]
        for k, state in enumerate(zip(*map(np.ascontiguousarray, states), strict=True)):
            each[k % len(each)](*state, found[k])
        return found
    b = len(states[0])
    size = b if len(chains) == 1 else LANES  # number of states per workspace
    parts = [slice(start, start + size) for start in range(0, b, size)]
    works = (lanes_workspace(solver, chains[part]) for part in parts)
    many = solvers.accelerations_of_many
    qdd = [many(work, *(s[part] for s in states)) for part, work in zip(parts, works, strict=True)]
    return qdd[0] if len(qdd) == 1 else np.concatenate(qdd)


def lanes_workspace(solver: solvers.Solver, chains: Sequence[Chain]) -> Any:
    """Workspace for up to eight chains of one layout without `forces`; the last chain is repeated to fill all lanes."""
    if any(chain.forces for chain in chains):
        forces = ", ".join(chains[0].forces)
        raise ArgumentError(f"{chains[0].name}: {forces} require chains one by one", id="chains-differ")
    if solver.lanes_workspace is None:
        raise ArgumentError("solver: several chains at once require solver 'articulated'", id="needs-another-argument")
    eight = [chains[min(lane, len(chains) - 1)] for lane in range(LANES)]
    bodies, hinges = _stacked([c.bodies for c in eight]), _stacked([c.hinges for c in eight])
    rare = None
    if any(c.arrays.rare is not None for c in eight):
        rare = Rare(*(_stacked([c.force(name) for c in eight]) for name in Rare._fields))
    return solver.lanes_workspace(ChainArrays(bodies, hinges, _stacked([c.gravity for c in eight]), rare))


def _stacked(records: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Stack records as bytes (`np.stack` takes ten times as long), read-only like the arrays of a chain."""
    whole = b"".join([record.tobytes() for record in records])
    return np.frombuffer(whole, records[0].dtype).reshape(len(records), len(records[0]))


def solver_for(chain: Chain, solver: str) -> solvers.Solver:
    """Return the compiled solver of this name for this chain, or refuse the name."""
    kernel = require_one_of("solver", solver, SOLVERS)
    if chain.shapes is not None:
        return _shaped_solver(chain)
    return solvers.PLANAR if kernel is solvers.ARTICULATED and chain.is_planar else kernel


def _shaped_solver(chain: Chain) -> solvers.Solver:
    """The solver of a chain whose hinges move by shapes; it ignores the name of the solver, as Φᵀ M Φ is small."""
    shapes = chain.shapes

    def workspace(arrays: ChainArrays) -> Any:
        return shaped_workspace(arrays, shapes, planar_workspace(arrays) if chain.is_planar else rne_workspace(arrays))

    return solvers.Solver(workspace)
