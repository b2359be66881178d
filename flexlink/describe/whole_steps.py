"""Whether a time, given as a decimal number, is an integer number of equal steps, up to rounding."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import FlexlinkError, SceneError
from flexlink.common.types import Array


def multiples(start: float, between: float, count: int) -> Array:
    """Return equally spaced times [s] from a start; if it is an integer multiple of the spacing, so are all others."""
    return (parts(start, between) + np.arange(count, dtype=np.float64)) * between


def parts(value: float, unit: float) -> float:
    """Number of `unit`s in a value; rounded if it is an integer up to the rounding of decimal input."""
    ratio = value / unit
    return round(ratio) if is_whole(ratio) else ratio


def is_whole(ratio: float) -> bool:
    """Whether a ratio of two decimal numbers is an integer, up to their rounding; true for 0."""
    return abs(ratio - round(ratio)) <= 1e-9 * max(1.0, ratio)


def whole(name: str, value: float, unit_name: str, unit: float, error: type[FlexlinkError] = SceneError) -> int:
    """Number of `unit`s in `value`, which must be an integer up to the rounding of decimal input.

    Raises
    ------
    SceneError
        The number is not an integer, or too large for exact integers in float64; raised as `error` if given.
    """
    if not value / unit < 2**53:
        raise error(f"{name} = {value!r}: must be less than 2**53 times {unit_name} = {unit!r}", id="not-a-multiple")
    number = parts(value, unit)
    if number != round(number) or (value > 0 and number == 0):
        raise error(f"{name} = {value!r}: must be a multiple of {unit_name} = {unit!r}", id="not-a-multiple")
    return round(number)
