"""Postures in a row at which a chain rests, its driven joints held: what a static feed-forward goes through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.equilibrium import known_decimals, solve_static
from flexlink.dynamics.tangent import unlocked
from flexlink.kernels.derivatives.static_continuation import follow_equilibria

DENSE = 100
"""Joints up to which a posture is found from the one before with a matrix that is kept."""


def static_postures(chain: Chain, held: NDArray[np.intp], angles: Array) -> Array:
    """Postures (rows, n) at which a chain rests under gravity, its joints `held` at angles (rows, held) [rad].

    Each as `solve_static` finds it from the one before: where Newton's method gets there at once, by that alone.

    Raises
    ------
    ConvergenceError
        At a row the arm has no equilibrium.
    """
    free, q, postures = unlocked(chain, held.tolist()), np.zeros(chain.n), np.zeros((len(angles), chain.n))
    found = 0
    while found < len(angles):
        q[held] = angles[found]
        q = postures[found] = solve_static(chain, q, locked=held.tolist()).q
        found += 1
        if chain.n <= DENSE:
            rest = angles[found:], q.copy(), postures[found:]
            found += follow_equilibria(chain.arrays, held, free, *rest)
            q = postures[found - 1].copy()
    for i, decimals in known_decimals(chain, free, np.zeros(chain.n), np.zeros(6)):
        postures[:, i] = chain.rest[i] + _rounded(postures[:, i] - chain.rest[i], decimals)
    return postures


def _rounded(x: Array, decimals: int) -> Array:
    """`round` of every number (m,), half to even, by an exact product with the power of ten (Dekker 1971)."""
    exact = 22  # decimals whose power of ten is a float64
    scale, split = 10.0 ** max(decimals, 0), 2.0**27 + 1.0
    y = x * scale
    if not 0 <= decimals <= exact or np.abs(y).max(initial=0.0) >= 2.0**52:
        return np.array([round(each, decimals) for each in x.tolist()])
    (a, b), (c, d) = ((high, z - high) for z in (x, scale) for high in (split * z - (split * z - z),))
    left = ((a * c - y) + a * d + b * c) + b * d  # of the product beyond its rounding y
    whole = np.rint(y)
    above, below = 0.5 - (y - whole), -0.5 - (y - whole)  # what may be left, for `whole` to be the nearest
    up = (left > above) | ((left == above) & (whole % 2 == 1))
    down = (left < below) | ((left == below) & (whole % 2 == 1))
    return np.asarray((whole + up - down.astype(float)) / scale)
