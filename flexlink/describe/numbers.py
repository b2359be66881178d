"""Checks of numbers that annotations cannot express: tables over time, times that are whole numbers of steps."""

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import plural


def require_increasing(name: str, times: Sequence[float], *, from_zero: bool = False) -> None:
    """Check that the times of a table increase, and on request that the first is 0."""
    if not times:
        raise SceneError(f"{name} = (): a table needs at least one row", id="file-empty")
    if from_zero and times[0] != 0:
        raise SceneError(f"{name}[0] = {times[0]!r}: must be 0", id="first-time")
    for k, (before, time) in enumerate(itertools.pairwise(times), 1):
        if not time > before:
            text = f"{name}[{k}] = {time!r}: must be greater than {name}[{k - 1}] = {before!r}; times must increase"
            raise SceneError(text, id="times-not-increasing")


def require_positive(name: str, number: float, why: str = "") -> None:
    """Check a number that must be positive in its context; `why` ends the message."""
    if not number > 0:
        raise SceneError(f"{name} = {number!r}: must be > 0{why}", id="out-of-range")


def numbers(name: str, value: ArrayLike, wanted: Callable[[], str] = lambda: "real numbers") -> Array:
    """Return `value` as a new, contiguous float64 array."""
    try:
        array = np.array(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: not an array: {error}; expected {wanted()}", id="wrong-type") from None
    if array.dtype.kind not in "fiu":
        given = f"is a {type(value).__name__}" if array.ndim == 0 else f"has dtype {array.dtype}"
        given += f"; give its {name}, .{name}" * (array.ndim == 0 and hasattr(value, name))
        beyond = " (integers must not overflow float64)" if array.dtype.kind == "O" and array.ndim else ""
        raise ArgumentError(f"{name} {given}; expected {wanted()}{beyond}", id="wrong-type")
    return np.array(array, np.float64, order="C")


def check_table(
    times: tuple[float, ...] | None, tables: Mapping[str, Sequence[object] | None], *, smooth: bool, hold: bool
) -> None:
    """Check that times increase, that every table has one row per time, and that the interpolation is possible."""
    if times is not None:
        require_increasing("times", times)
    if smooth and len(times or ()) < 2:
        raise SceneError(f"smooth = {smooth}: needs a table with at least 2 times", id="needs-another-key")
    if hold and (smooth or times is None):
        needs = f"a table, times and {' or '.join(tables)}" if times is None else "smooth = False"
        raise SceneError(f"hold = {hold}: needs {needs}", id="needs-another-key")
    for name, rows in tables.items():
        if times is not None and rows is not None and len(rows) != len(times):
            raise SceneError(f"{name}: {plural(len(rows), 'row')}, but {len(times)} times", id="one-per-time")


def multiples(start: float, between: float, count: int) -> Array:
    """Return equally spaced times [s] from a start; if it is an integer multiple of the spacing, so are all others."""
    return (parts(start, between) + np.arange(count, dtype=np.float64)) * between


def within(times: Array, first: float, last: float = np.inf) -> NDArray[np.bool_]:
    """Which of these increasing times [s] lie from `first` to `last`, up to the rounding of decimal input."""
    rounding = 1e-9 * (times[-1:] - times[:1]) / max(len(times), 1) + 8 * np.finfo(float).eps * np.abs(times)
    return (times + rounding >= first) & (times - rounding <= last)


def parts(value: float, unit: float) -> float:
    """Number of `unit`s in a value; rounded if it is an integer up to the rounding of decimal input."""
    ratio = value / unit
    return round(ratio) if is_whole(ratio) else ratio


def is_whole(ratio: float) -> bool:
    """Whether a ratio of two decimal numbers is an integer, up to their rounding; true for 0."""
    return abs(ratio - round(ratio)) <= 1e-9 * max(1.0, ratio)


def whole(name: str, value: float, unit_name: str, unit: float, error: type[FlexlinkError] = SceneError) -> int:
    """Number of `unit`s in `value`, which must be an integer up to the rounding of decimal input."""
    if not value / unit < 2**53:
        raise error(f"{name} = {value!r}: must be less than 2**53 times {unit_name} = {unit!r}", id="not-a-multiple")
    number = parts(value, unit)
    if number != round(number) or (value > 0 and number == 0):
        longer = ", which is longer" if 0 < number < 1 else ""
        raise error(f"{name} = {value!r}: must be a multiple of {unit_name} = {unit!r}{longer}", id="not-a-multiple")
    return round(number)
