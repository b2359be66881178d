"""Checks of numbers that annotations cannot say."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array


def require_increasing(name: str, times: Sequence[float]) -> None:
    """Check that the times of a table's rows increase.

    Raises
    ------
    SceneError
        There is none, or one does not; the message names the row.
    """
    if not times:
        raise SceneError(f"{name} = (): a table has one row or more", id="file-empty")
    for k, (before, time) in enumerate(itertools.pairwise(times), 1):
        if not time > before:
            raise SceneError(
                f"{name}[{k}] = {time!r}: must be greater than {name}[{k - 1}] = {before!r}; times increase",
                id="times-not-increasing",
            )


def require_positive(name: str, number: float, why: str = "") -> None:
    """Check a number that must be positive because of what stands beside it; `why` ends the message.

    Raises
    ------
    SceneError
        It is not.
    """
    if not number > 0:
        raise SceneError(f"{name} = {number!r}: expected float > 0.0{why}", id="out-of-range")


def numbers(name: str, value: ArrayLike, wanted: str = "real numbers") -> Array:
    """`value` as a float64 array of its own, row by row.

    Raises
    ------
    ArgumentError
        It is no array, holds what is no number, or an integer beyond float64; the message says what is `wanted`.
    """
    try:
        array = np.array(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: not an array: {error}; expected {wanted}", id="wrong-type") from None
    if array.dtype.kind not in "fiu":
        beyond = " (no integers that overflow float64)" if array.dtype.kind == "O" else ""
        raise ArgumentError(f"{name} has dtype {array.dtype}; expected {wanted}{beyond}", id="wrong-type")
    return np.array(array, np.float64, order="C")
