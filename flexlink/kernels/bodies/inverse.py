"""Inverse dynamics: τ = M q̈ + T_GC.

The type of the scratch arrays `work` selects the recursion, as in forward dynamics.
"""

from flexlink.kernels.bodies.planar_rne import planar_rne
from flexlink.kernels.bodies.plane import PlanarWork
from flexlink.kernels.bodies.rne import RneWork, rne
from flexlink.kernels.tools.compiler import by_type, entry
from flexlink.kernels.tools.vec3 import vector


@entry
def in_space(chain, wrench, q, qd, qdd, tau, work):
    """Run `rne` under the chain's gravity."""
    return rne(chain, vector(chain.gravity), wrench, q, qd, qdd, tau, work)


@entry
def in_plane(chain, wrench, q, qd, qdd, tau, work):
    """Run `planar_rne`, whose scratch contains the chain's constants and gravity."""
    return planar_rne(wrench, q, qd, qdd, tau, work)


@by_type({PlanarWork: in_plane, RneWork: in_space})
def inverse_dynamics_into(chain, wrench, q, qd, qdd, tau, work):
    """Write the torques `tau` (n,) for q̈ under gravity and the tip wrench (6,); returns its power m·ω [W]."""
