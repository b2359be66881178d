"""Forward dynamics: q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR, by the solver that a number names."""

import numpy as np

from flexlink.kernels.articulated import articulated, articulated_workspace
from flexlink.kernels.compiler import kernel
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.mass import mass_composite
from flexlink.kernels.planar import planar, planar_workspace
from flexlink.kernels.rne import rne, rne_workspace
from flexlink.kernels.solve import solve_cholesky, solve_lu
from flexlink.kernels.vec3 import vector

LU, CHOLESKY, ARTICULATED, PLANAR = 0, 1, 2, 3


@kernel
def forward_workspace(chain, solver):
    """Scratch of `forward_dynamics` with this solver; that of the others stays empty."""
    bodies, hinges = chain.bodies, chain.hinges
    n = len(hinges)
    n_dense = n if solver in (LU, CHOLESKY) else 0
    dense = rne_workspace(chain), np.empty((n_dense, n_dense)), np.zeros(n_dense)
    spatial = solver == ARTICULATED
    flat = solver == PLANAR
    return (
        dense,
        articulated_workspace(bodies[: len(bodies) * spatial], hinges[: n * spatial]),
        planar_workspace(bodies[: len(bodies) * flat], hinges[: n * flat]),
    )


@kernel
def accelerations(chain, solver, wrench, q, qd, tau):
    """q̈ in a new array (n,)."""
    qdd = np.empty(len(q))
    forward_dynamics(chain, solver, wrench, q, qd, tau, qdd, forward_workspace(chain, solver))
    return qdd


@kernel
def forward_dynamics(chain, solver, wrench, q, qd, tau, qdd, work):
    """Write q̈ (n,) for drive torques `tau` (n,) and tip wrench (6,)."""
    dense, spatial, flat = work
    if solver == PLANAR:
        planar(chain, wrench, q, qd, tau, qdd, flat)
    elif solver == ARTICULATED:
        articulated(chain, wrench, q, qd, tau, qdd, spatial)
    else:
        solve_dense(chain, solver, wrench, q, qd, tau, qdd, dense)


@kernel
def solve_dense(chain, solver, wrench, q, qd, tau, qdd, work):
    """Set up M and the right-hand side, and solve."""
    rne_work, M, rest = work
    rne(chain, vector(chain.gravity), wrench, q, qd, rest, qdd, rne_work)
    for k in range(len(qdd)):
        qdd[k] = tau[k] - qdd[k] - elastic(chain.hinges[k], q[k]) - friction(chain.hinges[k], qd[k])
    mass_composite(chain, q, M)
    if solver == LU:
        solve_lu(M, qdd)
    else:
        solve_cholesky(M, qdd)
