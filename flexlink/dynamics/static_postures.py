"""Equilibria of a chain for a sequence of driven-joint angles, as needed for static feed-forward."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.equilibrium import at_rest, known_decimals
from flexlink.dynamics.free_motion import DENSE
from flexlink.dynamics.shaped_load_path import equations_of
from flexlink.dynamics.tangent import LoadedState, unlocked
from flexlink.dynamics.wrench import turns_with_tip
from flexlink.kernels.derivatives.static_continuation import follow_equilibria

POSTURES = Memo(64)
"""Cache of static equilibria, shared by the runs of one scene when they start."""


def static_posture(chain: Chain, q: Array, wrench: Array, frame: Frame) -> Array:
    """Equilibrium (n,) of a chain with its driven joints held at their angles in q; errors as in `solve_static`."""
    return POSTURES.calling(_static_posture, chain, q, wrench, frame).copy()


def _static_posture(chain: Chain, q: Array, wrench: Array, frame: Frame) -> Array:
    free = unlocked(chain, chain.active.tolist())
    state = LoadedState(q.copy(), np.zeros(chain.n), wrench, turns_with_tip(frame), free)
    posture, _ = at_rest(equations_of(chain, state, np.zeros(chain.n)))
    return posture


def static_postures(chain: Chain, angles: Array) -> Array:
    """Equilibria (rows, n) of a chain under gravity with its driven joints held at angles (rows, driven) [rad].

    Newton's method finds each equilibrium from the previous one; if it does not converge, `solve_static` is used.

    Raises
    ------
    ConvergenceError
        The arm has no equilibrium for one of the rows.
    """
    held, q, postures = chain.active, np.zeros(chain.n), np.zeros((len(angles), chain.n))
    free, found = unlocked(chain, held.tolist()), 0
    while found < len(angles):
        q[held] = angles[found]
        q = postures[found] = static_posture(chain, q, np.zeros(6), "world")
        found += 1
        if chain.n <= DENSE and chain.shapes is None:
            rest = angles[found:], q.copy(), postures[found:]
            found += follow_equilibria(chain.arrays, held, free, *rest)
            q = postures[found - 1].copy()
    if chain.shapes is None and (known := known_decimals(chain, q, free, np.zeros(chain.n), np.zeros(6))):
        i, decimals = (list(part) for part in zip(*known, strict=True))
        postures[:, i] = chain.rest[i] + _rounded(postures[:, i] - chain.rest[i], decimals)
    return postures


def _rounded(x: Array, decimals: list[int]) -> Array:
    """Round numbers (m, k) like Python's `round`, half to even, by exact products with powers of ten (Dekker 1971)."""
    exact = 22  # largest power of ten that float64 represents exactly
    scale, split = np.array([10.0 ** max(each, 0) for each in decimals]), 2.0**27 + 1.0
    y = x * scale
    if not all(0 <= each <= exact for each in decimals) or np.abs(y).max(initial=0.0) >= 2.0**52:
        return np.array([[*map(round, row, decimals)] for row in x.tolist()])
    (a, b), (c, d) = ((high, z - high) for z in (x, scale) for high in (split * z - (split * z - z),))
    left = ((a * c - y) + a * d + b * c) + b * d  # rounding error of the product y
    whole = np.rint(y)
    above, below = 0.5 - (y - whole), -0.5 - (y - whole)  # range of this error in which `whole` is the nearest integer
    up = (left > above) | ((left == above) & (whole % 2 == 1))
    down = (left < below) | ((left == below) & (whole % 2 == 1))
    return np.asarray((whole + up - down.astype(float)) / scale)
