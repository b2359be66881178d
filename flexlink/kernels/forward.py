"""Forward dynamics: q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR, by the solver that a number names."""

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.mass import mass_composite
from flexlink.kernels.rne import rne, rne_workspace
from flexlink.kernels.solve import solve_cholesky, solve_lu
from flexlink.kernels.vec3 import vector

LU, CHOLESKY = 0, 1


@kernel
def forward_workspace(chain):
    """Scratch of `forward_dynamics`."""
    n = len(chain.hinges)
    return rne_workspace(chain), np.empty((n, n)), np.zeros(n)


@kernel
def accelerations(chain, solver, wrench, q, qd, tau):
    """q̈ in a new array (n,)."""
    qdd = np.empty(len(q))
    forward_dynamics(chain, solver, wrench, q, qd, tau, qdd, forward_workspace(chain))
    return qdd


@kernel
def forward_dynamics(chain, solver, wrench, q, qd, tau, qdd, work):
    """Write q̈ (n,) for drive torques `tau` (n,) and tip wrench (6,)."""
    rne_work, M, rest = work
    rne(chain, vector(chain.gravity), wrench, q, qd, rest, qdd, rne_work)
    for k in range(len(qdd)):
        qdd[k] = tau[k] - qdd[k] - elastic(chain.hinges[k], q[k]) - friction(chain.hinges[k], qd[k])
    mass_composite(chain, q, M)
    if solver == LU:
        solve_lu(M, qdd)
    else:
        solve_cholesky(M, qdd)
