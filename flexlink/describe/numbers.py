"""Checks of numbers that annotations cannot express."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array


def require_increasing(name: str, times: Sequence[float]) -> None:
    """Check that the times of a table increase.

    Raises
    ------
    SceneError
        The table is empty, or a time does not increase; the message names the row.
    """
    if not times:
        raise SceneError(f"{name} = (): a table needs at least one row", id="file-empty")
    for k, (before, time) in enumerate(itertools.pairwise(times), 1):
        if not time > before:
            raise SceneError(
                f"{name}[{k}] = {time!r}: must be greater than {name}[{k - 1}] = {before!r}; times must increase",
                id="times-not-increasing",
            )


def require_positive(name: str, number: float, why: str = "") -> None:
    """Check a number that must be positive in its context; `why` ends the message.

    Raises
    ------
    SceneError
        The number is not positive.
    """
    if not number > 0:
        raise SceneError(f"{name} = {number!r}: must be > 0{why}", id="out-of-range")


def numbers(name: str, value: ArrayLike, wanted: str = "real numbers") -> Array:
    """Return `value` as a new, contiguous float64 array.

    Raises
    ------
    ArgumentError
        `value` is not an array, or contains non-numbers or integers that overflow; the message states what is `wanted`.
    """
    try:
        array = np.array(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: not an array: {error}; expected {wanted}", id="wrong-type") from None
    if array.dtype.kind not in "fiu":
        given = f"is a {type(value).__name__}" if array.ndim == 0 else f"has dtype {array.dtype}"
        beyond = " (integers must not overflow float64)" if array.dtype.kind == "O" and array.ndim else ""
        raise ArgumentError(f"{name} {given}; expected {wanted}{beyond}", id="wrong-type")
    return np.array(array, np.float64, order="C")
