"""Frequencies of a beam under axial load, to 60 digits: it hangs under gravity, or is on a rotating hub.

With EI = ρA = L = 1, x from the root, gravity γ along the beam and a hub of radius zero that rotates at Ω,

    w'''' − (T w')' = λ w        T = γ (1 − x) + Ω² (1 − x²) / 2

λ = ω² for flap, normal to the plane of rotation, and ω² + Ω² for lag, within it. The leading coefficient is constant,
so a power series about the root converges everywhere. The tip is free, w'' = w''' = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mpmath import mp

DIGITS = 60
TERMS = 300  # a term falls as (√T)ᵏ / k!: 1e-160 at T = 1000
GRID = 0.25  # rad/s, search interval for roots, whose distances are about ten times larger


class Beam(NamedTuple):
    """Loads and support of a beam; its root may be `hinged` instead of clamped; `lag` is in the plane of rotation."""

    gravity: float = 0.0
    spin: float = 0.0
    lag: bool = False
    hinged: bool = False


def frequencies(beam: Beam, count: int) -> list[Any]:
    """The first frequencies ω [rad/s] as mpmath numbers."""
    with mp.workdps(DIGITS):
        found: list[Any] = []
        low, value = mp.mpf(GRID) / 8, _free_tip(beam, mp.mpf(GRID) / 8)
        while len(found) < count:
            high = low + GRID
            after = _free_tip(beam, high)
            if value * after < 0:
                found.append(mp.findroot(lambda ω: _free_tip(beam, ω), (low, high), solver="anderson", tol=1e-50))
            low, value = high, after
        return found


def _free_tip(beam: Beam, ω: Any) -> Any:
    """Determinant of w'' and w''' at the tip for the two solutions that satisfy the root's boundary conditions."""
    first, second = ((1, 3) if beam.hinged else (2, 3)), mp.matrix(2)
    for column, power in enumerate(first):
        a = _series(beam, ω, power)
        second[0, column] = mp.fsum(k * (k - 1) * a[k] for k in range(2, TERMS))
        second[1, column] = mp.fsum(k * (k - 1) * (k - 2) * a[k] for k in range(3, TERMS))
    return mp.det(second)


def _series(beam: Beam, ω: Any, power: int) -> list[Any]:
    """Coefficients of the power series that starts at this power of x."""
    γ, Ω2 = mp.mpf(beam.gravity), mp.mpf(beam.spin) ** 2
    T0, λ = γ + Ω2 / 2, ω**2 + (Ω2 if beam.lag else 0)
    a = [mp.mpf(k == power) for k in range(TERMS)]
    for k in range(TERMS - 4):
        pull = T0 * (k + 2) * a[k + 2] - γ * (k + 1) * a[k + 1] - Ω2 / 2 * k * a[k]
        a[k + 4] = ((k + 1) * pull + λ * a[k]) / ((k + 4) * (k + 3) * (k + 2) * (k + 1))
    return a


def rope(gravity: float, count: int) -> list[Any]:
    """The first frequencies of a hanging rope of length 1 without stiffness: j_0k √γ / 2 (Daniel Bernoulli 1732)."""
    with mp.workdps(DIGITS):
        return [mp.besseljzero(0, k) * mp.sqrt(gravity) / 2 for k in range(1, count + 1)]
