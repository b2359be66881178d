"""Forward dynamics: q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR.

The type of the workspace selects the algorithm, so only the one in use is compiled.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.mass import CompositeWork, composite, composite_workspace
from flexlink.kernels.bodies.plane import PlanarWork, planar_lanes_workspace, planar_workspace
from flexlink.kernels.bodies.rne import RneWork, rne, rne_workspace
from flexlink.kernels.forces.elements import add_torques, forces_of
from flexlink.kernels.forces.joint_torques import elastic, friction
from flexlink.kernels.forward.articulated import articulated
from flexlink.kernels.forward.articulated_rows import (
    ArticulatedWork,
    articulated_lanes_workspace,
    articulated_workspace,
)
from flexlink.kernels.forward.known_motion import power_of, take_torques
from flexlink.kernels.forward.planar import planar
from flexlink.kernels.forward.shaped import ShapedWork, shaped
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.tools.address import bind, records
from flexlink.kernels.tools.compiler import by_type, inlined, kernel, subroutine
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import LANES, empty_lanes, keep_lanes, put_lanes
from flexlink.kernels.tools.solve import solve_cholesky, solve_lu
from flexlink.kernels.tools.vec3 import vector


class DenseWork(NamedTuple):
    """Scratch arrays of `dense`, with its chain."""

    chain: Any
    by_lu: Any
    rne: RneWork
    forces: Any  # force elements; None for a plain chain
    composite: CompositeWork
    M: Any
    known: Any
    bias: Any
    probe: Any


@kernel
def dense_workspace(chain, by_lu):
    """Allocate the workspace of `dense`, which solves by LU if `by_lu`, otherwise by Cholesky decomposition."""
    n = len(chain.hinges)
    return DenseWork(
        chain, by_lu, rne_workspace(chain), forces_of(chain), composite_workspace(chain), np.empty((n, n)), np.empty(n),
        np.empty(n), np.empty((3, n)),
    )  # fmt: skip


@subroutine
def dense(wrench, q, qd, tau, qdd, work):
    """Set up M and the right-hand side, remove the rows of prescribed joints, and solve; see `forward_dynamics`."""
    chain, M, known, bias = work.chain, work.M, work.known, work.bias
    for k in range(len(qdd)):
        known[k] = qdd[k] if chain.hinges[k].prescribed else 0.0
    rne(chain, vector(chain.gravity), wrench, q, qd, known, bias, work.rne)
    lost = 0.0
    if work.forces is not None:
        lost += add_torques(work.forces.elements, q, qd, bias)
    composite(chain, q, M, work.composite)
    for k in range(len(qdd)):
        if chain.hinges[k].prescribed:
            M[k, :] = 0.0
            M[:, k] = 0.0
            M[k, k] = 1.0
        else:
            qdd[k] = tau[k] - bias[k] - elastic(chain.hinges[k], q[k]) - friction(chain.hinges[k], qd[k])
    if work.by_lu:
        solve_lu(M, qdd, work.probe)
    else:
        solve_cholesky(M, qdd, work.probe)
    take_torques(chain, wrench, q, qd, qdd, tau, bias, work.rne, work.forces)
    return power_of(chain, wrench, qd, tau, known, work.composite.placed.axes) - lost


@by_type({PlanarWork: planar, ArticulatedWork: articulated, DenseWork: dense, ShapedWork: shaped})
def forward_dynamics(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,), and the tip wrench (6,); return a power [W].

    The workspace contains the constants of the chain, or of eight chains side by side (`lanes`): the arrays are then of
    shape (n, 8).

    Hybrid dynamics: at prescribed hinges `qdd` is given, and the required drive torque is written to `tau`
    (Featherstone 2008, section 9.2).

    The power is q̇·(T_EX − T_FR) + m·ω, the power of all torques and forces without a potential. (Springs, gravity and a
    constant force on the tip have a potential.) Its integral is the work that changes the energy.
    """


@inlined
def forward_under(inputs, t, middle, q, qd, tau, qdd, work):
    """`forward_dynamics` with the tip wrench at time t; `middle` is the midpoint of the step that contains t.

    Returns the power of all forces without a potential [W], including a tip force that is not constant.
    """
    if inputs.loads is None:
        return forward_dynamics(inputs.wrench, q, qd, tau, qdd, work)
    power = put_wrench(inputs.loads, t, middle, q, qd, inputs.wrench)
    return power + forward_dynamics(inputs.wrench, q, qd, tau, qdd, work)


def accelerations(address, wrench, q, qd, tau, qdd):
    """Write q̈; return whether the state has n finite values each and q̈ is finite. Records: workspace, spare (n,)."""
    work, torque = records(address)
    n = len(torque)
    if not (len(q) == n and len(qd) == n and len(tau) == n):
        return False
    for k in range(n):
        torque[k], qdd[k] = tau[k], 0.0
    forward_dynamics(wrench, q, qd, torque, qdd, work)
    return is_finite(q) and is_finite(qd) and is_finite(tau) and is_finite(qdd)


class Solver(NamedTuple):
    """An algorithm in the form that the argument-checking functions call."""

    workspace: Callable[..., Any]  # (chain) -> scratch
    lanes_workspace: Callable[..., Any] | None = None  # (eight chains, arrays (8, …)) -> scratch

    def bound(self, chain: Any) -> Callable[..., bool]:
        """`accelerations` for this chain, a function of (wrench, q, qd, tau, qdd)."""
        spare = np.zeros((4, len(chain.hinges)))
        return bind(accelerations, (self.workspace(chain), np.zeros(len(chain.hinges))), np.zeros(6), *spare)

    def accelerations(self, chain: Any, wrench: Any, q: Any, qd: Any, tau: Any) -> Any:
        """q̈ in a new array, finite or not."""
        qdd = np.full(len(q), np.nan)
        self.bound(chain)(*map(np.ascontiguousarray, (wrench, q, qd, tau)), qdd)
        return qdd


@kernel
def _lu_work(chain):
    return dense_workspace(chain, True)


@kernel
def _cholesky_work(chain):
    return dense_workspace(chain, False)


@kernel
def accelerations_of_many(work, wrench, q, qd, tau):
    """q̈ of many states (b, n) with wrenches (b, 6) for the chains of a workspace, eight states side by side."""
    b, n = q.shape
    qdd = np.zeros((b, n))
    state, acting = empty_lanes((4, n)), empty_lanes((6,))
    state[3, :] = 0.0
    for start in range(0, b, LANES):
        put_lanes(wrench, start, acting)
        put_lanes(q, start, state[0])
        put_lanes(qd, start, state[1])
        put_lanes(tau, start, state[2])
        forward_dynamics(acting, state[0], state[1], state[2], state[3], work)
        keep_lanes(state[3], start, qdd)
    return qdd


LU, CHOLESKY = Solver(_lu_work), Solver(_cholesky_work)
ARTICULATED = Solver(articulated_workspace, articulated_lanes_workspace)
PLANAR = Solver(planar_workspace, planar_lanes_workspace)
