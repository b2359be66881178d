"""Rooted trees confirm the order that each Runge-Kutta tableau claims."""

import math

import msgspec
import pytest

from flexlink.describe.data_files import names
from flexlink.describe.schemes import methods
from validation.oracles.rooted_trees import coefficients, density, residuals, trees

ORDERS = {
    "RK2": 2, "RK3": 3, "RK4": 4, "DOPRI5": 5, "DOP853": 8, "RK10": 10, "Radau5": 5, "Radau9": 9, "Gauss4": 4,
    "Gauss6": 6,
}  # fmt: skip

DIGITS = {"DOP853": 28}
"""Number of published digits of the coefficients; other methods have 75 digits or more."""


def test_every_built_in_method_is_tested_here():
    assert set(names("methods")) == set(ORDERS)


def test_the_number_of_different_rooted_trees_is_the_published_one():
    counts = [len({_canonical(tree) for tree in trees(order)}) for order in range(1, 11)]
    assert counts == [len(trees(order)) for order in range(1, 11)] == [1, 1, 2, 4, 9, 20, 48, 115, 286, 719]  # A000081


def _canonical(tree):
    return tuple(sorted(map(_canonical, tree)))


@pytest.mark.parametrize("order", range(2, 8))
def test_density_is_the_order_for_a_bushy_tree_and_its_factorial_for_a_tall_tree(order):
    bush, stalk = ((),) * (order - 1), ()
    for _ in range(order - 1):
        stalk = (stalk,)
    assert density(bush) == order
    assert density(stalk) == math.factorial(order)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "order"), ORDERS.items())
def test_every_order_condition_is_met_to_all_stored_digits(name, order):
    method = methods.method(name)
    exact = coefficients(method)
    assert method.order == order
    assert max(max(residuals(exact, k)) for k in range(1, order + 1)) <= 10.0 ** -DIGITS.get(name, 40)
    assert max(residuals(exact, order + 1)) > 1e-7, "the method has no higher order"


def test_a_wrong_digit_in_one_coefficient_is_caught():
    good = methods.method("RK4")
    bad = msgspec.structs.replace(good, b=("1/6", "1/3", "0.33333333333333333", "1/6"))
    assert max(residuals(coefficients(bad), 1)) > 1e-18
