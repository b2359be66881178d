"""Closed-form eigenvalues of a chain of n equal cells (Hencky 1920), for twist and buckling.

`paper` is the paper's layout, n segments and n − 1 hinges; `midpoint` and `hencky` have n hinges and equal eigenvalues.
"""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array


def half_angles(rule: str, n: int) -> Array:
    """Half the phase [rad] by which each eigenvector advances from cell to cell, as used in `twist` and `buckling`."""
    if rule == "paper":
        return np.asarray((2 * np.arange(1, n) - 1) * np.pi / (2 * (2 * n - 1)))
    return np.asarray((2 * np.arange(1, n + 1) - 1) * np.pi / (4 * n))


def twist(rule: str, n: int) -> Array:
    """Twist frequencies ω of a clamped bar with GJ = ρ I_p = L = 1, lumped into n cells."""
    return np.asarray(2 * n * np.sin(half_angles(rule, n)))


def buckling(rule: str, n: int) -> Array:
    """Axial buckling loads of a clamped column with EI = L = 1, lumped into n cells."""
    return np.asarray(4 * n**2 * np.sin(half_angles(rule, n)) ** 2)
