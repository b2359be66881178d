"""Bending frequencies of a clamped chain of thin rods to 40 digits, from the positions and weights of its hinges only.

With EI = ρA = L = 1 and hinges at x_i with compliance w_i, M_ij = ∫ (ξ − x_i)₊ (ξ − x_j)₊ dξ and K = diag(1/w); with
W = K⁻¹, the eigenvalues of √W M √W are 1/ω².
"""

from __future__ import annotations

import itertools

import mpmath
import numpy as np

from flexlink.common.types import Array


def frequencies(nodes: Array, weights: Array) -> Array:
    """All natural angular frequencies, slowest first."""
    with mpmath.workdps(40):
        x, w = [mpmath.mpf(float(v)) for v in nodes], [mpmath.mpf(float(v)) for v in weights]
        S = mpmath.matrix(len(x))
        for i, j in itertools.product(range(len(x)), repeat=2):
            a, d = 1 - max(x[i], x[j]), abs(x[i] - x[j])
            S[i, j] = mpmath.sqrt(w[i] * w[j]) * (a**3 / 3 + d * a**2 / 2)
        return np.array(sorted(float(1 / mpmath.sqrt(v)) for v in mpmath.eigsy(S, eigvals_only=True)))
