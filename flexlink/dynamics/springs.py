"""Springs and dampers of a chain as matrices and their inverse, couplings included."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.kernels.bodies.couplings import give_way


def damping_slope(chain: Chain) -> Array:
    """Slope of T_FR at rest by each joint's own rate, d + coulomb / coulomb_width, shape (n,)."""
    return np.asarray(chain.damping + _dry(chain))


def damping_matrix(chain: Chain) -> Array:
    """Slope of T_FR at rest, D + diag(coulomb / coulomb_width), shape (n, n)."""
    return np.asarray(chain.matrix("damping") + np.diag(_dry(chain)))


def damping_along(chain: Chain, φ: Array) -> Array:
    """`damping_matrix` times rates φ (n,), in O(n)."""
    if not len(chain.couplings):
        return damping_slope(chain) * φ
    return np.asarray(chain.times("damping", φ) + _dry(chain) * φ)


def _dry(chain: Chain) -> Array:
    return np.asarray(chain.hinges["coulomb"] / chain.hinges["coulomb_width"])


def deflections(chain: Chain, torques: Array) -> Array:
    """Angles K⁻¹ τ [rad] by which springs give way to torques τ (n,) or (rows, n); 0 where there is none."""
    sprung = np.flatnonzero(chain.stiffness > 0)
    angles = np.zeros_like(torques)
    if not len(chain.couplings):
        angles[..., sprung] = torques[..., sprung] / chain.stiffness[sprung]
        return angles
    held = np.ascontiguousarray(np.atleast_2d(torques)[:, sprung])
    give_way(chain.arrays, sprung, held)
    angles[..., sprung] = held.reshape(*torques.shape[:-1], len(sprung))
    return angles
