"""A clamped beam with variable EI and ρA: deflection, slope, moment and shear integrated from the root to the tip.

    w' = φ        φ' = M/EI        M' = V        V' = ρA ω² w

Two solutions start with a unit moment and a unit shear force at the root. ω is a natural frequency if a combination of
both has M = V = 0 at the tip, so the determinant of their M and V is 0. EI and ρA vary linearly between the rows of a
table and may jump.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Columns = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
"""x from the root [m], EI [N m²] and ρA [kg/m]."""


@functools.cache
def frequencies(columns: Columns, count: int) -> list[float]:
    """The first frequencies [rad/s]."""
    x, EI, ρA = (np.asarray(column) for column in columns)
    unit = np.sqrt(EI.min() / ρA.max()) / x[-1] ** 2
    found: list[float] = []
    low, before = 0.1 * unit, _determinant(columns, 0.1 * unit)
    while len(found) < count:
        high = 1.15 * low
        value = _determinant(columns, high)
        if before * value < 0:
            found.append(float(brentq(lambda ω: _determinant(columns, ω), low, high, rtol=1e-13)))
        low, before = high, value
    return found


def curvature(columns: Columns, force: float, at: Sequence[float]) -> list[float]:
    """Curvature M/EI of the beam under a small transverse tip force [rad/m]."""
    x, EI, _ = (np.asarray(column) for column in columns)
    return [force * (x[-1] - place) / _linear(x, EI, place) for place in at]


def _linear(x: np.ndarray, column: np.ndarray, at: float) -> float:
    """Interpolate linearly between rows; no row may be exactly at `at`."""
    k = int(np.searchsorted(x, at)) - 1
    return float(column[k] + (column[k + 1] - column[k]) * (at - x[k]) / (x[k + 1] - x[k]))


def _determinant(columns: Columns, ω: float) -> float:
    x, EI, ρA = (np.asarray(column) for column in columns)
    state = np.eye(4)[:, 2:]  # two solutions from a clamped root: unit moment, unit shear force
    for k in range(len(x) - 1):
        if x[k + 1] > x[k]:
            state = _integrated(state, x[k : k + 2], EI[k : k + 2], ρA[k : k + 2], ω)
    return float(np.linalg.det(state[2:]))


def _integrated(state: np.ndarray, x: np.ndarray, EI: np.ndarray, ρA: np.ndarray, ω: float) -> np.ndarray:
    def slope(at: float, flat: np.ndarray) -> np.ndarray:
        w, φ, M, V = flat.reshape(4, -1)
        stiff, heavy = (np.interp(at, x, column) for column in (EI, ρA))
        return np.concatenate([φ, M / stiff, V, heavy * ω**2 * w])

    return np.asarray(
        solve_ivp(slope, tuple(x), state.ravel(), method="DOP853", rtol=1e-10, atol=1e-14).y[:, -1].reshape(4, -1)
    )
