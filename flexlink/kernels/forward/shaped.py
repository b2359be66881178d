"""Forward dynamics of a chain whose hinges move by shapes, q̇ = Φ ż: the equations of motion in the range of Φ.

    Φᵀ M Φ z̈ = Φᵀ (T_EX − T_GC − T_FL − T_FR)        q̈ = Φ z̈

Nothing is linearised: M and T_GC are those of the bent chain. T_GC follows by recursive Newton-Euler, Φᵀ M Φ by
`weigh`, so an evaluation takes O(hinges · shapes) and one dense solution of the size of z.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.bodies.shaped_mass import ShapedMass, Shapes, add_rotors, shaped_mass_workspace
from flexlink.kernels.forces.elements import add_torques, forces_of
from flexlink.kernels.forces.joint_torques import elastic, friction
from flexlink.kernels.forward.known_motion import take_torques
from flexlink.kernels.forward.mass_plus import weigh
from flexlink.kernels.tools.compiler import kernel, subroutine
from flexlink.kernels.tools.solve import solve_cholesky


class ShapedWork(NamedTuple):
    """Scratch of `shaped`, with its chain and shapes."""

    chain: Any
    shapes: Shapes
    inverse: Any  # scratch of inverse dynamics, which selects the recursion for a plane or for space
    forces: Any  # force elements; None for a plain chain
    mass: ShapedMass
    M: Any  # (m, m)
    z: Any  # (m,)
    probe: Any  # (3, m)
    known: Any  # (n,)
    bias: Any  # (n,)


@kernel
def shaped_workspace(chain, shapes, inverse):
    """Scratch of `shaped`; `inverse` is that of inverse dynamics."""
    n, m = shapes.matrix.shape
    return ShapedWork(
        chain, shapes, inverse, forces_of(chain), shaped_mass_workspace(chain, shapes), np.empty((m, m)), np.empty(m),
        np.empty((3, m)), np.empty(n), np.empty(n),
    )  # fmt: skip


@subroutine
def shaped(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,), and the tip wrench (6,); see `forward_dynamics`."""
    chain, Φ, first, stop = work.chain, work.shapes.matrix, work.shapes.first, work.shapes.stop
    M, z, known, bias = work.M, work.z, work.known, work.bias
    for k in range(len(q)):
        known[k] = qdd[k] if chain.hinges[k].prescribed else 0.0
    power = inverse_dynamics_into(chain, wrench, q, qd, known, bias, work.inverse)
    if work.forces is not None:
        power -= add_torques(work.forces.elements, q, qd, bias)
    weigh(q, work, work.inverse)
    add_rotors(chain, work.shapes, M)
    z[:] = 0.0
    for k in range(len(q)):
        torque = tau[k] - bias[k] - elastic(chain.hinges[k], q[k]) - friction(chain.hinges[k], qd[k])
        for j in range(first[k], stop[k]):
            z[j] += Φ[k, j] * torque
    for k in range(len(q)):
        if chain.hinges[k].prescribed:
            j = first[k]  # z̈_j = 0 for the shape that moves one prescribed joint: the torques contain its motion
            z[j] = 0.0
            M[j, :] = 0.0
            M[:, j] = 0.0
            M[j, j] = 1.0
    solve_cholesky(M, z, work.probe)
    for k in range(len(q)):
        if not chain.hinges[k].prescribed:
            qdd[k] = 0.0
            for j in range(first[k], stop[k]):
                qdd[k] += Φ[k, j] * z[j]
    take_torques(chain, wrench, q, qd, qdd, tau, bias, work.inverse, work.forces)
    for k in range(len(q)):
        power += qd[k] * (tau[k] - friction(chain.hinges[k], qd[k]))
    return power
