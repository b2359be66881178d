"""Kernels that read their records from one address."""

from typing import Any

import numpy as np
import pytest

from flexlink.kernels.tools.address import bind, records


def read(address: int, x: Any) -> float:
    """A sum in which every record has another weight."""
    (flat, table, rows), scale, count, nothing, flag = records(address)
    total: float = scale * x[0] + 10 * count + 1000 * flat[1] + 1e5 * table[1, 0] + 1e7 * rows[1, 2]
    return total if flag and nothing is None else -1.0


def test_records_of_every_kind_arrive_and_are_shared() -> None:
    flat, table = np.array([1.0, 2.0]), np.asfortranarray([[1, 2], [3, 4]])
    given = (flat, table, np.arange(24.0).reshape(4, 6)[::2, ::2]), 0.5, -7, None, True
    call = bind(read, given, np.zeros(1))
    assert call(np.array([4.0])) == 2.0 - 70 + 2000 + 3e5 + 16e7
    flat[1] = 3.0  # the function reads the array itself, not a copy
    assert call(np.array([4.0])) == 2.0 - 70 + 3000 + 3e5 + 16e7


@pytest.mark.parametrize("other", [[4.0], np.float32([4.0]), np.zeros(6)[::2], np.zeros((2, 2)), None, "x"])
def test_other_types_are_not_compiled(other: Any) -> None:
    call = bind(read, ((np.ones(2), np.ones((2, 2)), np.ones((2, 3))), 0.5, 1, None, True), np.zeros(1))
    assert call(other) is False
