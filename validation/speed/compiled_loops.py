"""Compiled loops over the kernels, without Python between two calls."""

from typing import Any

import numpy as np

from flexlink.kernels.bodies.mass import composite, composite_workspace, mass_columns, mass_lower, mass_upper
from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.vec3 import vector


@kernel
def forward_dynamics_loop(work: Any, q: Any, qd: Any, tau: Any, calls: int) -> Any:
    """Compute q̈ `calls` times, cycling through the states (s, n)."""
    wrench, qdd = np.zeros(6), np.zeros(q.shape[1])
    for i in range(calls):
        s = i % len(q)
        forward_dynamics(wrench, q[s], qd[s], tau[s], qdd, work)
    return qdd


@kernel
def rne_loop(chain: Any, q: Any, qd: Any, qdd: Any, calls: int) -> Any:
    """Compute τ = M q̈ + T_GC `calls` times, cycling through the states (s, n)."""
    wrench, tau, work = np.zeros(6), np.zeros(q.shape[1]), rne_workspace(chain)
    for i in range(calls):
        s = i % len(q)
        rne(chain, vector(chain.gravity), wrench, q[s], qd[s], qdd[s], tau, work)
    return tau


@kernel
def mass_loop(chain: Any, q: Any, calls: int) -> Any:
    """Compute M `calls` times, cycling through the angles (s, n)."""
    n = q.shape[1]
    M, work = np.zeros((n, n)), composite_workspace(chain)
    for i in range(calls):
        composite(chain, q[i % len(q)], M, work)
    return M


@kernel
def mass_columns_loop(chain: Any, q: Any, calls: int) -> Any:
    """M by method 1 of Walker and Orin, in a loop like `mass_loop`."""
    M = np.zeros((q.shape[1], q.shape[1]))
    for i in range(calls):
        mass_columns(chain, q[i % len(q)], M)
    return M


@kernel
def mass_lower_loop(chain: Any, q: Any, calls: int) -> Any:
    """M by method 2 of Walker and Orin, in a loop like `mass_loop`."""
    M = np.zeros((q.shape[1], q.shape[1]))
    for i in range(calls):
        mass_lower(chain, q[i % len(q)], M)
    return M


@kernel
def mass_upper_loop(chain: Any, q: Any, calls: int) -> Any:
    """M by method 3 of Walker and Orin, in a loop like `mass_loop`."""
    M = np.zeros((q.shape[1], q.shape[1]))
    for i in range(calls):
        mass_upper(chain, q[i % len(q)], M)
    return M
