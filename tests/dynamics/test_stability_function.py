"""Stability functions: Padé approximations, stability limits, two proofs that Radau IIA and Gauss are A-stable."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from flexlink.describe.schemes.methods import Method, method
from flexlink.dynamics.vibration.stability_function import (
    GROWTH,
    is_stable_everywhere,
    stability_function,
    stability_polynomials,
    stable_half_disc,
    stable_reach,
)

g = float(GROWTH)
FAMILIES = {"Gauss": 0, "Radau IIA": 1}  # degree of Q minus degree of P


def of_family(family: str, stages: int) -> Method:
    return Method(about="-", source="-", order=2 * stages - FAMILIES[family], family=family, stages=stages)


def own(A: list[list[str]], b: list[str], c: list[str]) -> Method:
    return Method(about="-", source="-", order=1, A=A, b=b, c=c)  # type: ignore[arg-type]


THETA = own([["1/3"]], ["1"], ["1/3"])
"""θ-method with θ = 1/3: R = (1 + 2z/3) / (1 − z/3)."""

TRAPEZOID = own([["0", "0"], ["1/2", "1/2"]], ["1/2", "1/2"], ["0", "1"])

BACKWARD = own([["1/6", "-4/3", "7/6"], ["1/6", "2/3", "-1/3"], ["1/6", "2/3", "1/6"]], ["1/6", "2/3", "1/6"],
               ["0", "1/2", "1"])  # fmt: skip
"""Kutta's explicit method of order 3, backward in time: R = 1 / (1 − z + z²/2 − z³/6)."""


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("stages", [1, 2, 3, 5])
def test_the_stability_function_of_a_family_is_the_pade_approximation(family: str, stages: int) -> None:
    """Hairer & Wanner, II, theorem IV.3.12."""
    k, m = stages - FAMILIES[family], stages
    total = factorial(k + m)
    P = [Fraction(factorial(k + m - j) * factorial(k), total * factorial(j) * factorial(k - j)) for j in range(k + 1)]
    Q = [(-1) ** j * Fraction(factorial(k + m - j) * factorial(m), total * factorial(j) * factorial(m - j))
         for j in range(m + 1)]  # fmt: skip
    found = stability_polynomials(of_family(family, stages))
    for mine, exact in zip(found, (P + [Fraction(0)] * FAMILIES[family], Q), strict=True):
        assert max(abs(x - y) for x, y in zip(mine, exact, strict=True)) < Fraction(1, 2**230)


@pytest.mark.parametrize("name", ["Radau5", "Radau9", "Gauss4", "Gauss6"])
def test_radau_and_gauss_are_a_stable_and_algebraically_stable(name: str) -> None:
    """BA + AᵀB − bbᵀ ≥ 0 with b > 0 suffices (Burrage & Butcher 1979), which does not depend on the zeros of E."""
    A, b, _ = method(name).arrays
    M = b[:, None] * A + (b[:, None] * A).T - np.outer(b, b)
    assert np.linalg.eigvalsh(M).min() > -10 * np.finfo(float).eps
    assert b.min() > 0
    assert is_stable_everywhere(method(name))
    assert np.isinf(stable_reach(method(name), np.array([1j, -1.0]))).all()


def test_the_trapezoidal_rule_is_a_stable_and_backward_kutta_is_not() -> None:
    """Both have no pole for Re z < 0; on the imaginary axis, backward Kutta grows between y⁴ = 24 g and y² = 3."""
    assert is_stable_everywhere(TRAPEZOID)
    assert not is_stable_everywhere(BACKWARD)
    assert not is_stable_everywhere(method("RK4"))


def test_the_limit_of_a_method_stable_in_a_wedge_matches_its_expansion() -> None:
    """|Q(iy)|² = 1 − y⁴/12 + y⁶/36, so growth begins at y⁴/12 ≈ 2 g; no growth occurs on the negative real axis."""
    reach = stable_reach(BACKWARD, np.array([1j, -1.0]))
    assert reach[0] == pytest.approx((24 * g) ** 0.25, rel=1e-3)  # the next term changes y by y²/12
    assert reach[1] == np.inf
    assert abs(stability_function(BACKWARD, np.array([reach[0] * 1j]))[0]) == pytest.approx(1 + g, abs=1e-9)


def test_the_stability_limit_of_a_theta_method_matches_its_closed_form() -> None:
    """For θ = 1/3, |R(−x)| = 1 + g gives (1 + g) (1 + x/3) = 2x/3 − 1; |R(iy)| = 1 + g is squared to find y."""
    y = np.sqrt(((1 + g) ** 2 - 1) / (4 / 9 - (1 + g) ** 2 / 9))
    x = (2 + g) / (2 / 3 - (1 + g) / 3)
    np.testing.assert_allclose(stable_reach(THETA, np.array([1j, -1.0])), [y, x], rtol=1e-9)


@pytest.mark.parametrize("name", ["RK2", "RK3", "RK4", "RK10", "DOPRI5", "DOP853"])
def test_the_stable_half_disc_is_stable_and_the_largest_possible(name: str) -> None:
    r = stable_half_disc(method(name))
    directions = np.exp(1j * np.linspace(np.pi / 2, np.pi, 2001))
    inside = np.outer(np.linspace(0, r, 101), directions)
    assert np.abs(stability_function(method(name), inside)).max() <= 1 + 1.01 * g
    beyond = np.abs(stability_function(method(name), 1.001 * r * directions)).max()
    assert beyond > 1 + g
    assert r <= stable_reach(method(name), np.array([1j, -1.0])).min() * (1 + 1e-9), "up to rounding"


def test_radau_is_stable_on_every_half_disc_and_implicit_methods_with_a_limit_on_none() -> None:
    assert stable_half_disc(method("Radau5")) == np.inf
    assert stable_half_disc(THETA) == 0.0


def chebyshev(stages: int) -> Method:
    """R(z) = T_s(1 + z / s²), by Y_i = 1 + z a_i Y_i−1, a_i the ratios of its coefficients."""
    before, r = [Fraction(1)], [Fraction(1), Fraction(1, stages**2)]
    for _ in range(stages - 1):
        twice = [2 * x + 2 * y / stages**2 for x, y in zip([*r, Fraction(0)], [Fraction(0), *r], strict=True)]
        before, r = r, [x - y for x, y in zip(twice, [*before, Fraction(0), Fraction(0)], strict=True)]
    a = ["0", *(str(r[k] / r[k - 1]) for k in range(stages, 1, -1))]
    rows = [["0"] * (i - 1) + [a[i]] if i else [] for i in range(stages)]
    return own(rows, ["0"] * (stages - 1) + ["1"], a)


def test_cancellation_of_large_terms_does_not_affect_the_stability_limit() -> None:
    """At the stability limit, |terms| of T_10² in powers of z add up to (T_10(3))² = 5e14, so rounding is about 0.1."""
    reach = stable_reach(chebyshev(10), np.array([-1.0 + 0j]))[0]
    assert reach == pytest.approx(200.0, rel=2 * g)
