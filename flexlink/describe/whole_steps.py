"""Numbers of equal steps in a length of time, given as decimal numbers: whole ones, up to the rounding of these."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import FlexlinkError, SceneError
from flexlink.common.types import Array


def multiples(start: float, between: float, count: int) -> Array:
    """Times [s] from a start, so far apart: whole multiples of the time between them, if the start is one."""
    return (parts(start, between) + np.arange(count, dtype=np.float64)) * between


def parts(value: float, unit: float) -> float:
    """How many `unit`s a value is: a whole number, if it is one up to the rounding of decimal input."""
    ratio = value / unit
    return round(ratio) if is_whole(ratio) else ratio


def is_whole(ratio: float) -> bool:
    """Whether a ratio of two decimal numbers is a whole number, up to their rounding; 0 is."""
    return abs(ratio - round(ratio)) <= 1e-9 * max(1.0, ratio)


def whole(name: str, value: float, unit_name: str, unit: float, error: type[FlexlinkError] = SceneError) -> int:
    """How many `unit`s `value` is, which must be a whole number, up to the rounding of decimal input.

    Raises
    ------
    SceneError
        It is not, or the number is beyond the integers of float64; in its place `error`.
    """
    if not value / unit < 2**53:
        raise error(f"{name} = {value!r}: must be less than 2**53 times {unit_name} = {unit!r}", id="not-a-multiple")
    number = parts(value, unit)
    if number != round(number) or (value > 0 and number == 0):
        raise error(f"{name} = {value!r}: must be a multiple of {unit_name} = {unit!r}", id="not-a-multiple")
    return round(number)
