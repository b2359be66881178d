"""What slopes tell before a fit does not depend on rounding in them, nor on the basis that SVD happens to give."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.problem import Use
from flexlink.identification.remarks import warnings

NAMES = ["a", "b", "c", "d", "e"]


def known(effects: list[float], mix: np.ndarray | None = None) -> np.ndarray:
    """Slopes J = Q diag(effects) mix of 40 residuals, Q of orthonormal columns."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(40, len(effects))))[0]
    return Q @ np.diag(effects) @ (np.eye(len(effects)) if mix is None else mix)


def told(check: Check) -> list[str]:
    return [one.text for one in check.directions]


@pytest.mark.parametrize("rest", [0.0, 1e-16, 2.2e-8, 1e-3])
@pytest.mark.parametrize("error", [0.0, 1.5e-9, 1e-6])
def test_what_rounding_leaves_of_slopes_is_no_effect(rest: float, error: float) -> None:
    """2.2e-8 of slopes known to 1.5e-9 were "too weak an effect, ± 9.1e+09 %"."""
    assert told(checked(known([50.0, rest]), error, NAMES[:2])) == ["b has no effect on the data"]


@pytest.mark.parametrize("effect", [0.06, 0.5, 0.9])
def test_a_weak_effect_is_told_as_a_percentage_below_ten_thousand(effect: float) -> None:
    (sentence,) = told(checked(known([50.0, effect]), 1e-9, NAMES[:2]))
    assert sentence == f"b has too weak an effect on the data: expected ± {196 / effect:.2g} % (95 %)"
    assert "e+0" not in sentence.replace("e+02", "").replace("e+03", "")


def test_an_effect_no_larger_than_the_error_of_its_slope_is_none() -> None:
    assert told(checked(known([50.0, 0.5]), 0.1, NAMES[:2])) == ["b has no effect on the data"]


def test_numbers_with_equal_parts_stand_in_the_problem_s_order() -> None:
    """Of a and b only the product counts: rounding decided which was named first."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        column = 50 * rng.normal(size=(40, 1))
        J = np.hstack([column, column, 30 * rng.normal(size=(40, 1))]) * (1 + 1e-12 * rng.normal(size=(40, 3)))
        (one,) = checked(J, 1e-9, NAMES[:3]).directions
        assert one.names == ("a", "b")
        assert one.parts == pytest.approx((np.sqrt(0.5), -np.sqrt(0.5)), abs=1e-9)


def test_several_lost_directions_do_not_depend_on_the_basis_that_spans_them(rng: np.random.Generator) -> None:
    """a − b, c − d and e − c cancel: three equal singular values, of any three directions in their space."""
    mix = np.array([[1.0, 1.0, 0, 0, 0], [0, 0, 1.0, 1.0, 1.0]])
    first = checked(known([60.0, 40.0], mix), 1e-9, NAMES)
    assert [one.names for one in first.directions] == [("a", "b"), ("c", "e"), ("d", "e")]
    for _ in range(20):
        Q = np.linalg.qr(rng.normal(size=(40, 40)))[0]
        other = checked(Q @ known([60.0, 40.0], mix) * (1 + 1e-13 * rng.normal(size=(40, 5))), 1e-9, NAMES)
        assert told(other) == told(first)


def test_weak_numbers_of_equal_effect_are_not_mixed(rng: np.random.Generator) -> None:
    """Two numbers apart from each other, each held to ± 39 %: any two directions between them have the same effect."""
    for _ in range(20):
        Q = np.linalg.qr(rng.normal(size=(40, 40)))[0]
        check = checked(Q @ known([50.0, 5.0, 5.0]) * (1 + 1e-12 * rng.normal(size=(40, 3))), 1e-9, NAMES[:3])
        assert told(check) == [f"{name} is hardly held by the data: expected ± 39 % (95 %)" for name in "bc"]
        assert check.passed


def column(use: Use, after: float, before: float = 0.0) -> FittedColumn:
    """A column of numbers up to 1, off by so much."""
    y, nan = np.sin(np.arange(50.0)), float("nan")
    return FittedColumn(
        source=use, name="tip y [m]", use=use, t=np.arange(50.0), measured=y, before=y + before, after=y + after,
        linear=None, gain=1.0, bias=0.0, noise=after or 1e-16, stated=False, times_noise=1.0, whiteness=nan,
    )  # fmt: skip


def test_of_exact_data_rounding_decides_neither_what_is_better_nor_what_is_worse_than_fitted() -> None:
    def better(*columns: FittedColumn) -> bool:
        judged = Fitted.judged.fget(SimpleNamespace(columns=columns))
        return Fitted.better.fget(SimpleNamespace(judged=judged))

    def told(*columns: FittedColumn) -> list[str]:
        every = warnings((), (), checked(known([50.0]), 0.0, "a"), (), columns, ())
        return [one for one in every if "fitted runs" in one]

    assert better(column("fit", after=3e-16, before=1e-16))
    assert not better(column("fit", after=3e-6, before=1e-6))
    assert told(column("fit", after=1e-16), column("check", after=9e-16)) == []
    assert len(told(column("fit", after=1e-6), column("check", after=9e-6))) == 1
