"""Measures of tip travel, and extrapolation of tip paths to their limit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from flexlink.results.convergence import change_of_limit, extrapolated, observed_order
from flexlink.results.tip_motion import centre_of_motion, extent_of_motion, largest_so_far, tip_travel

Array = NDArray[np.float64]
EXACT = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.4]])


def levels(order: float, *hinges: int) -> list[tuple[float, Array]]:
    """Tip paths for these hinge counts, with errors that decrease with this order."""
    return [(n, EXACT + np.array([[0.0], [1e-2]]) / n**order) for n in hinges]


def test_travel_is_measured_from_the_start_and_extent_between_extremes() -> None:
    x = np.array([0.0, 3.0, -1.0])
    tip = np.column_stack([x, 0 * x, 0 * x])
    assert tip_travel(tip) == 3.0
    assert extent_of_motion(tip) == 4.0
    assert centre_of_motion(tip).tolist() == [1.0, 0.0, 0.0]


def test_an_error_that_is_not_finite_stays_infinite() -> None:
    assert largest_so_far(np.array([1.0, 0.5, np.nan, 0.1])).tolist() == [1.0, 1.0, np.inf, np.inf]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_extrapolation_is_exact_for_any_ratio_of_levels(order: float) -> None:
    found = extrapolated(levels(order, 2, 3), order)
    assert found.tip == pytest.approx(EXACT, abs=1e-16)
    assert sum(found.weights) == pytest.approx(1.0)
    assert change_of_limit(levels(order, 2, 3, 5), order) == pytest.approx(0.0, abs=1e-16)
    assert observed_order(levels(order, 2, 4, 8)) == pytest.approx(order)
    assert observed_order(levels(order, 1, 3, 9)) == pytest.approx(order)


def test_the_change_of_a_limit_bounds_its_error_even_for_a_wrong_order() -> None:
    found = levels(1.0, 4, 8, 16)
    assert np.abs(change_of_limit(found)).max() >= 0.999 * np.abs(extrapolated(found).tip - EXACT).max()


def test_the_observed_order_is_infinite_for_equal_levels_or_growing_changes() -> None:
    still, off = EXACT, EXACT + 1.0
    assert observed_order([(1, off), (2, still), (4, still)]) == np.inf
    assert observed_order([(1, still), (2, still), (4, off)]) == -np.inf
