"""Recursions store nested tuples of numbers in rows; compiled code and Python give the same numbers."""

import numpy as np
import pytest

from flexlink.kernels.tools import records
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.lanes import LANES, zero_of
from flexlink.kernels.tools.records import added, keep, kept


@kernel
def keep_and_add(rows, m, n, J, first):
    """Store (m, n, J) in row 1 and row 1 + (m, n, J) in row 0; return n as read from row 1."""
    keep(rows, 1, (m, n, J), first)
    keep(rows, 0, added(rows, 1, (m, n, J), first), first)
    _, last, _ = kept(rows, 1, (m, n, J), first)
    return last


@pytest.mark.parametrize("first", [0, 2])
@pytest.mark.parametrize("of", [float, complex])
def test_numbers_of_nested_tuples_are_stored_consecutively(first: int, of: type) -> None:
    rows, values = np.zeros((2, 12), of), (of(1.0), (2.0, 3.0, 4.0), ((5.0, 6.0), (7.0, 8.0)))
    assert keep_and_add(rows, *values, first) == values[1]
    kept_numbers = np.arange(1.0, 9.0)
    assert np.array_equal(rows[1], np.r_[np.zeros(first), kept_numbers, np.zeros(4 - first)])
    assert np.array_equal(rows[0], np.r_[np.zeros(first), 2.0 * kept_numbers, np.zeros(4 - first)])


@kernel
def add_lanes(rows):
    """Add the two 3-vectors of row 0, in reverse order, to those of row 1; all numbers are SIMD lanes."""
    o = zero_of(rows, 0, 0)
    zero = (o, o, o)
    f, n = kept(rows, 0, (zero, zero))
    keep(rows, 1, added(rows, 1, (n, f)))


def test_eight_lanes_are_stored_and_added_like_one_number() -> None:
    rows = np.random.default_rng(3).standard_normal((2, 6, LANES))
    before = rows.copy()
    add_lanes(rows)
    assert np.array_equal(rows[1], before[1] + np.r_[before[0, 3:], before[0, :3]])
    assert np.array_equal(rows[0], before[0])


def test_uncompiled_functions_give_the_same_numbers() -> None:
    rows = np.zeros((2, 8))
    records.keep(rows, 0, (1.0, (2.0, 3.0), ((4.0,),)), 1)
    assert np.array_equal(rows[0], [0, 1, 2, 3, 4, 0, 0, 0])
    assert records.kept(rows, 0, (0.0, (0.0, 0.0), ((0.0,),)), 1) == (1.0, (2.0, 3.0), ((4.0,),))
    assert records.added(rows, 0, (1.0, (0.0, 0.0, 1.0)), 1) == (2.0, (2.0, 3.0, 5.0))
