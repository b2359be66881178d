"""Rules of coupled springs under axial load and in large bending: errors, orders, and what one spring a hinge leaves.

EI = ρA = L = 1. Of lobatto p statics are of order 2p; motion is of order 4, which the kink of the mass kernel leaves.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from beams import cantilever, thin_arm, thin_link
from scipy import integrate, linalg, optimize

import flexlink as fl
from flexlink.dynamics.tangent import stiffness_matrix

Error = Callable[[str, int], float]
EULER, PINNED, BECK = np.pi**2 / 4, np.pi**2, 20.05095361897376122  # critical loads, the last by its double root
FORCE = 10.0  # across the tip


def order(error: Error, rule: str, sizes: Sequence[int]) -> float:
    """The slope of a line through the errors of so many hinges, logarithms of both."""
    errors = np.array([error(rule, n) for n in sizes])
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def ritz(γ: float = 0.0, Ω: float = 0.0) -> float:
    """Lowest frequency of a clamped beam under its weight γ along it, or of its flapping at Ω, w = x² P_k(x)."""
    t, weights = np.polynomial.legendre.leggauss(60)
    x, P, square = (1 + t) / 2, np.polynomial.Legendre, np.polynomial.Legendre.fit([0, 0.5, 1], [0, 0.25, 1], 2, [0, 1])
    shapes = [square * P.basis(k, domain=[0, 1]) for k in range(24)]
    w, slope, bend = (np.array([shape.deriv(d)(x) if d else shape(x) for shape in shapes]) for d in range(3))
    tension = γ * (1 - x) + Ω**2 * (1 - x**2) / 2
    K, M = (bend * weights) @ bend.T + (slope * weights * tension) @ slope.T, (w * weights) @ w.T
    scale = np.sqrt(np.outer(np.diag(K), np.diag(K)))
    return float(1 / np.sqrt(linalg.eigh(M / scale, K / scale, eigvals_only=True)[-1]))


def heavy(γ: float) -> Error:
    """First frequency of a hanging column, ρAgL³/EI = γ."""
    exact = ritz(γ=γ)
    return lambda rule, n: abs(fl.natural_frequencies(cantilever(rule, n, gravity=(γ, 0, 0)))[0] / exact - 1)


def spinning(Ω: float, flap: bool) -> Error:
    """First frequency of flapping of a beam that turns at Ω, or of lagging, ω² = ω_flap² − Ω²."""
    exact = ritz(Ω=Ω) if flap else np.sqrt(ritz(Ω=Ω) ** 2 - Ω**2)

    def error(rule: str, n: int) -> float:
        chain = thin_arm(thin_link(rule, n, flex="yz", free=True))
        rates = np.where(np.arange(chain.n) == 0, Ω, 0.0)
        held = [k for k, hinge in enumerate(chain.coordinates) if hinge.axis != (2 if flap else 3)]
        return float(abs(fl.natural_frequencies(chain, qd=rates, locked=held)[0] / exact - 1))

    return error


def euler(rule: str, n: int) -> float:
    """A clamped column."""
    return float(abs(fl.buckling_loads(cantilever(rule, n), tip_wrench=[-1.0, 0, 0, 0, 0, 0])[0] / EULER - 1))


def pinned(rule: str, n: int) -> float:
    """A column on two pins: K φ = P S φ for small angles φ that leave its tip on the axis."""
    chain = thin_arm(thin_link(rule, n, free=True, armature=1.0))
    zero, push, K = np.zeros(chain.n), np.array([-1.0, 0, 0, 0, 0, 0]), chain.matrix("stiffness")
    S = K - stiffness_matrix(chain, zero, zero, push)
    free = linalg.null_space(fl.jacobian(chain, zero).linear[1:2])
    return float(abs(1 / linalg.eigh(free.T @ S @ free, free.T @ K @ free, eigvals_only=True)[-1] / PINNED - 1))


def beck(rule: str, n: int) -> float:
    """A follower load along the tip: two frequencies meet where (μ₁ − μ₂)², smooth in the load, is 0."""
    chain = cantilever(rule, n)

    def apart(load: float) -> float:
        λ = fl.modes(chain, tip_wrench=[-load, 0, 0, 0, 0, 0], frame="tip").eigenvalues
        μ = λ[np.argsort(np.abs(λ))][:2] ** 2
        return float(((μ[0] - μ[1]) ** 2).real)

    return abs(optimize.brentq(apart, 12.0, 26.0, xtol=1e-13) / BECK - 1)


def tip(rule: str, n: int, wrench: Sequence[float], frame: str = "world") -> np.ndarray:
    """Where the tip of a clamped beam comes to rest, (2,)."""
    chain = cantilever(rule, n)
    return fl.tip_position(chain, fl.solve_static(chain, tip_wrench=wrench, frame=frame).q)[:2]


def shot(curvature: float, bends: Callable[[float], float]) -> np.ndarray:
    """Angle, curvature and place at the far end of θ'' = bends(θ), from θ = 0 on, (4,)."""

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], bends(y[0]), np.cos(y[0]), np.sin(y[0])]

    start, exactly = [0.0, curvature, 0.0, 0.0], {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    return np.asarray(integrate.solve_ivp(slope, (0.0, 1.0), start, **exactly).y[:, -1])


@functools.cache
def elastica() -> np.ndarray:
    """Tip under a force across it that keeps its direction: no moment there, so that θ'(1) = 0."""

    def bends(θ: float) -> float:
        return -FORCE * float(np.cos(θ))

    root = optimize.brentq(lambda κ: shot(κ, bends)[1], 0.0, 9.0, xtol=1e-15)
    return shot(root, bends)[2:]


@functools.cache
def followed() -> np.ndarray:
    """Tip under a force across it that turns with it: seen from there a motion that starts at rest, then turned."""
    end = shot(0.0, lambda ψ: -FORCE * float(np.cos(ψ)))  # ψ, θ less that at the tip, from the tip to the root
    ψ, _, x, y = end
    c, s = np.cos(-ψ), np.sin(-ψ)
    return np.array([c * x - s * y, s * x + c * y])


def dead_force(rule: str, n: int) -> float:
    """Tip error under a force across it that keeps its direction."""
    return float(np.linalg.norm(tip(rule, n, [0, FORCE, 0, 0, 0, 0]) - elastica()))


def follower_force(rule: str, n: int) -> float:
    """The same of a force that turns with it."""
    return float(np.linalg.norm(tip(rule, n, [0, FORCE, 0, 0, 0, 0], "tip") - followed()))


def half_roll_up(rule: str, n: int) -> float:
    """Tip error of a beam that a moment bends to half a circle."""
    return float(np.linalg.norm(tip(rule, n, [0, 0, 0, 0, 0, np.pi]) - np.array([0.0, 2 / np.pi])))


STATICS = [euler, pinned, dead_force, follower_force, half_roll_up]
MOTION = {
    **{f"column hanging, γ = {γ}": (heavy, (γ,)) for γ in (1, 10, 100)},
    **{f"{'flap' if flap else 'lag'} at Ω = {Ω}": (spinning, (Ω, flap)) for Ω in (2, 6, 12) for flap in (True, False)},
}
RESOLVED = (48, 64, 96)
"""Hinges from which cells are shorter than the layer of a clamp under tension, √(EI/T) = 0.1, and errors have left the
place, near 16 to 24 hinges with lobatto4, where their sign changes."""


@pytest.mark.parametrize(
    "error, rule, hinges, limit",
    [
        (euler, "lobatto2", 16, 2e-6),
        (euler, "lobatto4", 16, 1e-10),
        (dead_force, "lobatto2", 8, 5e-4),
        (dead_force, "lobatto4", 8, 1e-5),
        (heavy(100), "lobatto2", 16, 3e-4),
        (heavy(100), "lobatto4", 16, 3e-6),
    ],
)
def test_errors_are_below_what_the_rules_promise(error: Error, rule: str, hinges: int, limit: float) -> None:
    """And a third of gauss's at most."""
    assert error(rule, hinges) < min(limit, error("gauss", hinges) / 3)


@pytest.mark.parametrize("error", STATICS)
def test_statics_are_of_order_twice_the_hinges_of_a_cell(error: Error) -> None:
    """One spring a hinge is of order 2, whatever its nodes: its springs bear the axial load as chords do."""
    assert order(error, "gauss", (16, 24, 32)) == pytest.approx(2, abs=0.1)
    assert order(error, "lobatto2", (16, 24, 32)) == pytest.approx(4, abs=0.1)
    assert order(error, "lobatto4", (16, 24, 32) if error in {euler, half_roll_up} else (24, 32, 40)) > 7


@pytest.mark.slow
@pytest.mark.parametrize("case", MOTION)
def test_motion_under_axial_load_is_of_order_four(case: str) -> None:
    kind, numbers = MOTION[case]
    error = kind(*numbers)
    assert order(error, "gauss", RESOLVED) == pytest.approx(2, abs=0.1)
    for rule in ("lobatto2", "lobatto4"):
        assert 3.8 < order(error, rule, RESOLVED) < 4.3


@pytest.mark.slow
def test_becks_column_is_of_order_four_or_more() -> None:
    """lobatto4's error falls with order 7 to 1e-6, and changes its sign near 24 hinges."""
    assert order(beck, "gauss", (24, 32, 48)) == pytest.approx(2, abs=0.1)
    assert order(beck, "lobatto2", (24, 32, 48)) > 3.8
    assert order(beck, "lobatto4", (8, 12, 16)) > 3.8
    assert beck("lobatto4", 16) < 1e-6
