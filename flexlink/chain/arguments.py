"""Checks of arguments of public functions. Messages contain the name, the value and what is expected."""

import functools
import inspect
import sys
from collections.abc import Callable, Mapping
from typing import Any, NoReturn, ParamSpec

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, T
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.expected import words
from flexlink.describe.numbers import numbers
from flexlink.describe.spec import to_builtin
from flexlink.kernels.tools.finite import is_finite

FLOAT64 = np.dtype(np.float64)
Given = ParamSpec("Given")
NO_WRENCH = np.zeros(6)


def vector(
    name: str, value: ArrayLike, size: int, *, many: bool = False, finite: bool = True, meaning: str = ""
) -> Array:
    """Return `value` as a finite float64 array of shape (size,), or refuse it; with `many`, messages add (b, size).

    `meaning` ends these messages; by default, of names such as q, that there is one number per joint and hinge.
    `finite=False` skips the check for finite values, which takes 0.2 µs; use it if a kernel checks the values anyway.
    """
    if type(value) is not np.ndarray or value.dtype is not FLOAT64 or not value.flags.carray or value.shape != (size,):
        meant: Callable[[], str] = lambda: meaning or words()["of_joints"].get(name, "")  # noqa: E731
        value = real_array(name, value, (size,), meant)
        if value.shape != (size,):
            also = f", or (b, {size}) for b states" if many else ""
            also += f": give one row, such as {name}[-1]" if value.shape[1:] == (size,) else meant()
            raise ArgumentError(f"{name} has shape {value.shape}; expected ({size},){also}", id="wrong-shape")
    if finite and not is_finite(value):
        k = int(np.argmin(np.isfinite(value)))
        raise ArgumentError(f"{name}[{k}] = {value[k]} is not finite; expected {size} finite numbers", id="not-finite")
    return value


def state(name: str, value: tuple[ArrayLike, ArrayLike], n: int) -> tuple[Array, Array]:
    """Return q and q̇, shape (n,) each, or refuse them; errors as in `vector`."""
    expected = "q and qd, as from fl.initial_state(scene, chain)"
    if len(both := sequence(name, value, f"vector: {expected}")) != 2:
        raise ArgumentError(f"{name} has {len(both)} items: expected {expected}", id="wrong-shape")
    return vector(f"{name}[0]", both[0], n), vector(f"{name}[1]", both[1], n)


def real_array(name: str, value: ArrayLike, shape: tuple[int, ...], meaning: Callable[[], str] = str) -> Array:
    """Return a writable, contiguous float64 copy, because kernels would be compiled again for read-only arrays."""
    return np.atleast_1d(numbers(name, value, lambda: f"real numbers, shape {shape}{meaning()}"))


def dimensions(value: ArrayLike) -> int:
    """Number of dimensions; 1 if `value` is not an array, which `vector` then reports."""
    try:
        return np.ndim(value)
    except ValueError:
        return 1


def require_one_of(name: str, value: object, allowed: Mapping[Any, T], what: str = "unknown") -> T:
    """Return the entry of `allowed` with the name `value`, or refuse it; `what` states what else it may be."""
    if not isinstance(value, str) or value not in allowed:
        names = ", ".join(allowed) if len(allowed) < 100 else short_list(list(allowed))
        text = f"{what}; allowed are {names}{did_you_mean(value, allowed)}"
        raise ArgumentError(f"{name} = {truncated(value)}: {text}", id="unknown-name")
    return allowed[value]


def require_type(name: str, value: object, kind: type[T]) -> T:
    """Return `value` if it is a `kind`, or refuse it; its message shows how to convert it, if known."""
    if not isinstance(value, kind):
        given = type(value).__name__
        remedy = words()["conversion"].get(kind.__name__, {}).get(given, "")
        text = f"expected a {kind.__name__}, got {given}{'; use ' if remedy else ''}{remedy}"
        raise ArgumentError(f"{name} = {truncated(value)}: {text}", id="wrong-type")
    return value


def explained(function: Callable[Given, T]) -> Callable[Given, T]:
    """The function, which refuses a call that does not fit it in words, instead of by Python's TypeError."""

    @functools.wraps(function)
    def called(*given: Given.args, **named: Given.kwargs) -> T:
        try:
            return function(*given, **named)
        except TypeError:
            known = inspect.signature(function)
            try:
                known.bind(*given, **named)
            except TypeError as wrong:
                refuse_call(function, str(wrong), dict(zip(known.parameters, given, strict=False)) | named)
            raise

    called.__module__ = "flexlink"  # where pickles look for it
    return called


def refuse_call(function: Callable[..., object], why: str, given: Mapping[str, object]) -> NoReturn:
    """Refuse a call that does not fit a function: what it takes in order and by name, and an example if known."""
    known = inspect.signature(function).parameters
    by_name = ", ".join(f"{each.name}=" for each in known.values() if each.kind is each.KEYWORD_ONLY)
    in_order = [name for name, each in known.items() if each.kind is each.POSITIONAL_OR_KEYWORD and name != "self"]
    near = next((did_you_mean(name, known) for name in given if name not in known), "")
    example = words()["call"].get(function.__name__, "")
    by_name = f"{'and ' * bool(in_order)}by name {by_name}" if by_name else ""
    text = f"{function.__name__}: {why}{near}; it takes {', '.join(filter(None, (*in_order, by_name)))}"
    for name, value in given.items():
        remedy = words()["conversion"].get(name.capitalize(), {}).get(type(value).__name__, "")
        text += f"; for {name} use {remedy}, not a {type(value).__name__}" * bool(remedy)
    raise ArgumentError(f"{text}{'; such as ' if example else ''}{example}", id="wrong-arguments") from None


def require_each(name: str, values: object, kind: type[T]) -> list[T]:
    """Return `values` as a list after checking that each is a `kind`; errors as in `require_type`."""
    return [require_type(f"{name}[{k}]", value, kind) for k, value in enumerate(sequence(name, values, kind.__name__))]


def sequence(name: str, values: object, item: str) -> list[Any]:
    """Return `values` as a list; refuses anything else, such as a string, with `item` in the message."""
    try:
        if not isinstance(values, str | bytes):
            return list(values)  # type: ignore[call-overload, no-any-return]
    except TypeError:  # also for 0-d arrays, which have an __iter__
        pass
    one = f"; for one, give [{truncated(values)}]" if isinstance(values, str) else ""
    raise ArgumentError(f"{name} = {truncated(values)}: expected a sequence, each item a {item}{one}", id="wrong-type")


def integer(name: str, value: object, least: int, most: int | None = None) -> int:
    """Return `value` as an int from `least` to `most`, or refuse it."""
    number = number_of(value)
    if type(number) is not int:
        remedy = words()["integer"].get(name, "")
        text = f"{name} = {truncated(value)}: must be an integer, got {type(value).__name__}{remedy}"
        raise ArgumentError(text, id="not-an-integer")
    if number < least or (most is not None and number > most):
        allowed = f"at least {least}" if most is None else f"{least} … {most}"
        raise ArgumentError(f"{name} = {truncated(number)}: must be {allowed}", id="out-of-range")
    return number


def positive(name: str, value: object) -> float:
    """Return `value` as a finite float > 0; errors as in `integer`."""
    number = number_of(value)
    if type(number) not in {int, float} or not 0 < number <= sys.float_info.max:  # type: ignore[operator]
        raise ArgumentError(f"{name} = {truncated(value)}: must be a finite number > 0", id="out-of-range")
    return float(number)  # type: ignore[arg-type]


def real(name: str, value: object, wanted: str) -> float:
    """Return a number or string as a float, finite or not, or refuse it; `wanted` describes it in the message."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{name} = {truncated(value)}: expected {wanted}", id="wrong-type") from None


def number_of(value: object) -> object:
    """Convert a NumPy scalar or 0-d array to Python's number; return anything else unchanged."""
    return to_builtin(value) if isinstance(value, np.generic | np.ndarray) else value


def require_bool(name: str, value: object) -> bool:
    """Return `value` after checking that it is True or False; a string such as "no" would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name} = {truncated(value)}: must be True or False", id="wrong-type")
    return bool(value)


def require_callable(name: str, value: object) -> None:
    """Check, before a computation that would call `value`, that it is callable or None."""
    if value is not None and not callable(value):
        raise ArgumentError(f"{name} = {truncated(value)}: expected a function, or None", id="wrong-type")


def beyond_float64(what: str, **arguments: ArrayLike) -> ArgumentError:
    """Return the error for a result beyond float64; it names the largest value among the arguments."""
    flat = ((name, k, abs(float(v))) for name, a in arguments.items() for k, v in enumerate(np.ravel(a)))
    name, k, size = max(flat, key=lambda entry: entry[2])
    return ArgumentError(f"{what} overflows float64; the largest argument is |{name}[{k}]| = {size:.3g}", id="overflow")


def wrench_vector(tip_wrench: ArrayLike | None) -> Array:
    """Return the tip wrench, shape (6,), zero by default; errors as in `vector`."""
    return NO_WRENCH if tip_wrench is None else vector("tip_wrench", tip_wrench, 6)
