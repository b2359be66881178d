"""Runge-Kutta methods as data: coefficients to the last bit, derived quantities, and refused input."""

import msgspec
import numpy as np
import pytest
from mpmath import mp
from scipy.integrate._ivp import dop853_coefficients as published

from flexlink import simulate
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.describe.spec import decode
from tests.conftest import flexible, make_scene
from tests.support.words import refused, reviewed
from validation.oracles.collocation import collocation

EPS = np.finfo(float).eps
IMPLICIT = ["Radau5", "Radau9", "Gauss4", "Gauss6"]
TRAPEZOID = {"A": (("0", "0"), ("1/2", "1/2")), "b": ("1/2", "1/2"), "c": ("0", "1")}


def own(**fields: object) -> Method:
    return Method(**({"about": "mine", "source": "-", "order": 2} | fields))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", IMPLICIT)
def test_coefficients_of_a_family_are_correctly_rounded(name: str) -> None:
    with mp.workdps(40):
        wanted = [np.array(x, dtype=float) for x in collocation(str(method(name).family), method(name).stages)]
    for found, exact in zip(method(name).arrays, wanted, strict=True):
        np.testing.assert_array_equal(found, exact)


@pytest.mark.parametrize("name", IMPLICIT)
def test_the_eigendecomposition_reproduces_the_matrix_a(name: str) -> None:
    found, (A, b, _) = method(name).modes, method(name).arrays
    real = found.T_real @ np.diag(found.real) @ found.Tinv_real
    pairs = found.T_complex @ np.diag(found.complex) @ found.Tinv_complex
    s = len(b)
    assert len(found.real) + 2 * len(found.complex) == s
    assert (found.complex.imag > 0).all()
    np.testing.assert_allclose(real + 2 * pairs.real, A, rtol=0, atol=20 * s * EPS)  # rounding of LAPACK's eigenvectors
    np.testing.assert_allclose(found.A2, A @ A, rtol=0, atol=s * EPS)
    np.testing.assert_allclose(found.bA, b @ A, rtol=0, atol=s * EPS)


@pytest.mark.parametrize("name", ["Radau5", "Radau9"])
def test_the_error_estimate_vanishes_for_polynomials_below_its_order(name: str) -> None:
    γ, d = method(name).embedded
    c = method(name).arrays[2]
    for k in range(1, len(c) + 1):
        assert d @ c ** (k - 1) == pytest.approx(-γ if k == 1 else 0.0, abs=4 * EPS)
    assert abs(d @ c ** len(c)) > 1e-5  # not exact for the next degree


def test_methods_with_an_error_estimate_are_marked_as_controlled() -> None:
    explicit = ["RK2", "RK3", "RK4", "RK10", "DOPRI5", "DOP853"]
    names = [*explicit, *IMPLICIT]
    assert [name for name in names if method(name).controlled] == ["DOP853", "Radau5", "Radau9"]
    assert [name for name in names if method(name).explicit] == explicit
    for name in ("RK4", "Gauss6"):
        with refused(ArgumentError, "method-without-error"):
            _ = method(name).embedded


def test_dop853_has_the_published_coefficients() -> None:
    found = method("DOP853")
    for mine, theirs in zip(found.arrays, (published.A[:12, :12], published.B, published.C[:12]), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(found.error, [published.E5, published.E3], rtol=0, atol=EPS)  # b − b̂, rounded


def test_a_user_defined_implicit_tableau_has_an_eigendecomposition() -> None:
    rule = own(**TRAPEZOID)
    assert (rule.explicit, rule.stages, rule.controlled) == (False, 2, False)
    np.testing.assert_allclose(rule.modes.real, [0.5, 0], atol=EPS)
    np.testing.assert_allclose(rule.modes.T_real * rule.modes.real @ rule.modes.Tinv_real, rule.arrays[0], atol=4 * EPS)


def test_a_tableau_with_zeros_on_and_above_the_diagonal_is_explicit() -> None:
    assert own(A=(("0", "0"), ("1", "0")), b=("1/2", "1/2"), c=("0", "1")).explicit


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        ({}, "family, A, b, c"),
        ({"family": "Gauss", "stages": 1, "b": ("1",)}, "family, b"),
        ({"family": "Gauss"}, "stages = 0"),
        ({"family": "Gauss", "stages": 10}, "stages = 10"),
        ({"family": "Radau IIA", "stages": 3}, "order = 2"),
        ({"family": "Lobatto"}, "family = 'Lobatto'"),
        (TRAPEZOID | {"stages": 3}, "stages = 3"),
        ({"A": (("1",) * 10,) * 10, "b": ("1",) * 10, "c": ("1",) * 10}, "10 stages"),
        (TRAPEZOID | {"error": (("1", "-1"),)}, "error: "),
        (TRAPEZOID | {"A": (("0", "0"), ("1/2", "1/3"))}, "A[1] = "),
        ({"A": ((), ("1",)), "b": ("1/2", "1/2"), "c": ("0", "1"), "error": (("1",),)}, "error[0]"),
        ({"A": ((), ("1",)), "b": ("1/2", "1/2"), "c": ("0", "1"), "error": (("1", "1"),)}, "must sum to 0"),
        ({"A": ((), ("1",)), "b": ("1/2", "1/2"), "c": ("0", "1"), "error": (("1", "x"),)}, "error[0]: 'x'"),
        ({"A": (("1/4", "0"), ("1/2", "1/4")), "b": ("1/2", "1/2"), "c": ("1/4", "3/4")}, "A: "),
        ({"A": (("-1",),), "b": ("1",), "c": ("-1",), "order": 1}, "-1"),
        ({"A": ((), ("1/3",)), "b": ("1/2", "1/2"), "c": ("0", "1/3")}, "order = 2"),
        ({"A": ((), ("1",), ("0", "1")), "b": ("1/6", "2/3", "1/6"), "c": ("0", "1", "1"), "order": 3}, "order = 3"),
    ],
)  # fmt: skip
def test_an_invalid_tableau_is_refused_in_one_line(fields: dict, wanted: str) -> None:
    with pytest.raises(SceneError) as caught:
        from_file(fields)
    assert wanted in str(caught.value)
    assert "\n" not in str(caught.value)
    reviewed(f"methods: {caught.value.id}", str(caught.value))


def from_file(fields: dict) -> Method:
    """Method from the text of a file, in which `error` is the key of the rows."""
    return decode(msgspec.to_builtins({"about": "mine", "source": "-", "order": 2} | fields), Method)


def test_a_tolerance_requires_a_method_with_an_error_estimate() -> None:
    with refused(SceneError, "method-without-error"):
        simulate(make_scene(flexible("a"), run=RunSettings(method="Gauss4", tolerance=1e-4)))
