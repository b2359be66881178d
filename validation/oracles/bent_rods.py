"""Tip positions of clamped rods that tip loads bend far, by integration along the rod; L = 1.

A follower force P, normal to the rod at its tip (EI = 1), needs no shooting. With σ the distance from the tip and ψ the
angle of the rod relative to its angle at the tip,

    ψ'' = −P cos ψ        ψ(0) = ψ'(0) = 0        θ_tip = −ψ(1)

A dead force F on a rod in space, with r its axis and R the rotation of its sections (Kirchhoff, Love § 255):
r' = R e_x, R' = R κ̂, κ = (m_x/GJ, m_y/EI_y, m_z/EI_z), m = Rᵀ (r(1) − r) × F. Newton's method finds the end r(1)
while the force grows in steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpmath import mp
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
PRECISE = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
STEPS = 10  # number of load increments
SLOPE = 1e-6  # step of finite differences; inaccurate derivatives cost iterations, but no accuracy


def follower(force: float) -> list[Any]:
    """x, y and angle of the tip under a force normal to the rod at its tip, to 25 digits."""
    with mp.workdps(25):
        P = mp.mpf(force)

        def slopes(_: Any, y: list[Any]) -> list[Any]:
            cosine, sine = mp.cos_sin(y[0])
            return [y[1], -P * cosine, cosine, sine]

        ψ, _, along, across = mp.odefun(slopes, 0, [0, 0, 0, 0])(1)
        return [along * mp.cos(ψ) + across * mp.sin(ψ), across * mp.cos(ψ) - along * mp.sin(ψ), -ψ]


def in_space(force: Array, rigidity: Array, **precision: Any) -> Array:
    """The tip of a rod along x under a dead force; `rigidity` is GJ, EI_y, EI_z."""
    precision = PRECISE | precision
    tip = np.array([1.0, 0.0, 0.0])
    for part in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        for _ in range(30):
            left = _end(tip, part * force, rigidity, precision) - tip
            columns = [
                (_end(tip + e, part * force, rigidity, precision) - tip - e - left) / SLOPE for e in SLOPE * np.eye(3)
            ]
            change = np.linalg.solve(np.transpose(columns), left)
            tip = tip - change
            if np.abs(change).max() < 1e-13:
                break
    return tip


def _end(tip: Array, force: Array, rigidity: Array, precision: dict[str, Any]) -> Array:
    """End of the rod, integrated from its root with the moments that the force causes if it acts at `tip`."""

    def slopes(_: float, y: Array) -> Array:
        R = y[3:].reshape(3, 3)
        κx, κy, κz = R.T @ _cross(tip - y[:3], force) / rigidity
        turn = np.array([[0, -κz, κy], [κz, 0, -κx], [-κy, κx, 0]])
        return np.concatenate([R[:, 0], (R @ turn).ravel()])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    return np.asarray(solve_ivp(slopes, (0.0, 1.0), start, **precision).y[:3, -1])


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors; NumPy's is ten times slower."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
