"""Checks of what public functions are given: every message names the argument, what it got and what is expected."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, T
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.numbers import numbers
from flexlink.describe.spec import to_builtin
from flexlink.kernels.tools.finite import is_finite

FLOAT64 = np.dtype(np.float64)
NO_WRENCH = np.zeros(6)


def vector(name: str, value: ArrayLike, size: int, *, many: bool = False, finite: bool = True) -> Array:
    """`value` as a finite float64 array of shape (size,); `many` says that the function would also take (b, size).

    Not `finite` leaves out the last check, 0.2 µs, where a kernel is about to make it.

    Raises
    ------
    ArgumentError
        The message names the argument, the shape got and the shape expected.
    """
    if type(value) is not np.ndarray or value.dtype is not FLOAT64 or not value.flags.carray:
        value = real_array(name, value, (size,))
    if value.shape != (size,):
        also = f", or (b, {size}) for b states" if many else ""
        raise ArgumentError(f"{name} has shape {value.shape}; expected ({size},){also}", id="wrong-shape")
    if finite and not is_finite(value):
        k = int(np.argmin(np.isfinite(value)))
        raise ArgumentError(f"{name}[{k}] = {value[k]} is not finite; expected {size} finite numbers", id="not-finite")
    return value


def real_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A writable, contiguous float64 copy: a read-only array is another type to the compiler, and compiles anew."""
    return np.atleast_1d(numbers(name, value, f"real numbers, shape {shape}"))


def dimensions(value: ArrayLike) -> int:
    """Number of dimensions; 1 for what is no array, which `vector` then refuses."""
    try:
        return np.ndim(value)
    except ValueError:
        return 1


def require_one_of(name: str, value: str, allowed: Mapping[Any, T]) -> T:
    """The entry of `allowed` that `value` names.

    Raises
    ------
    ArgumentError
        There is none; the message lists what is allowed.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ArgumentError(
            f"{name} = {truncated(value)}: unknown; allowed are {', '.join(allowed)}{did_you_mean(value, allowed)}",
            id="unknown-name",
        )
    return allowed[value]


def require_type(name: str, value: object, kind: type[T]) -> T:
    """`value`, which must be a `kind`.

    Raises
    ------
    ArgumentError
        It is none; the message says what it is.
    """
    if not isinstance(value, kind):
        raise ArgumentError(
            f"{name} = {truncated(value)}: expected a {kind.__name__}, got {type(value).__name__}", id="wrong-type"
        )
    return value


def require_each(name: str, values: object, kind: type[T]) -> list[T]:
    """`values` as a list, every one of which must be a `kind`; errors as in `require_type`."""
    return [require_type(f"{name}[{k}]", value, kind) for k, value in enumerate(sequence(name, values, kind.__name__))]


def sequence(name: str, values: object, item: str) -> list[Any]:
    """`values` as a list; `item` says of what, in the message that refuses anything else, such as a text."""
    try:
        if not isinstance(values, str | bytes):
            return list(values)  # type: ignore[call-overload, no-any-return]
    except TypeError:  # of a 0-d array, too, which has an __iter__
        pass
    raise ArgumentError(f"{name} = {truncated(values)}: expected a sequence, each item a {item}", id="wrong-type")


def integer(name: str, value: object, least: int, most: int | None = None) -> int:
    """`value` as an int from `least` to `most`.

    Raises
    ------
    ArgumentError
        It is no whole number, or out of range; the message names the range.
    """
    number = number_of(value)
    if type(number) is not int:
        raise ArgumentError(
            f"{name} = {truncated(value)}: must be a whole number, got {type(value).__name__}", id="not-an-integer"
        )
    if number < least or (most is not None and number > most):
        allowed = f"at least {least}" if most is None else f"{least} … {most}"
        raise ArgumentError(f"{name} = {truncated(number)}: must be {allowed}", id="out-of-range")
    return number


def positive(name: str, value: object) -> float:
    """`value` as a finite float > 0; errors as in `integer`."""
    number = number_of(value)
    if type(number) not in {int, float} or not 0 < number <= sys.float_info.max:  # type: ignore[operator]
        raise ArgumentError(f"{name} = {truncated(value)}: must be a finite number > 0", id="out-of-range")
    return float(number)  # type: ignore[arg-type]


def real(name: str, value: object, wanted: str) -> float:
    """`value` as a float, finite or not, which a text may hold, too; the message of an error says what is `wanted`.

    Raises
    ------
    ArgumentError
        It is no number, or an integer beyond float64.
    """
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{name} = {truncated(value)}: expected {wanted}", id="wrong-type") from None


def number_of(value: object) -> object:
    """Python's number for a NumPy scalar or an array of no dimension; anything else as it is."""
    return to_builtin(value) if isinstance(value, np.generic | np.ndarray) else value


def require_bool(name: str, value: object) -> bool:
    """`value`, which must be True or False: the text "no" would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name} = {truncated(value)}: must be True or False", id="wrong-type")
    return bool(value)


def require_callable(name: str, value: object) -> None:
    """Refuse a `value` that is neither None nor can be called, before the work that it is called from."""
    if value is not None and not callable(value):
        raise ArgumentError(f"{name} = {truncated(value)}: expected a function, or None", id="wrong-type")


def beyond_float64(what: str, **arguments: ArrayLike) -> ArgumentError:
    """The error of a result that float64 cannot hold; it names the largest number among the arguments."""
    flat = ((name, k, abs(float(v))) for name, a in arguments.items() for k, v in enumerate(np.ravel(a)))
    name, k, size = max(flat, key=lambda entry: entry[2])
    return ArgumentError(f"{what} overflows float64; the arguments go up to |{name}[{k}]| = {size:.3g}", id="overflow")


def wrench_vector(tip_wrench: ArrayLike | None) -> Array:
    """The tip wrench, shape (6,), zero if there is none; errors as in `vector`."""
    return NO_WRENCH if tip_wrench is None else vector("tip_wrench", tip_wrench, 6)
