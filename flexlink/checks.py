"""Checks of what public functions are given: every message names the argument, what it got and what is expected."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.errors import ArgumentError
from flexlink.kernels.finite import is_finite

Array = NDArray[np.float64]
T = TypeVar("T")
FLOAT64 = np.dtype(np.float64)
NO_WRENCH = np.zeros(6)


def vector(name: str, value: ArrayLike, size: int) -> Array:
    """`value` as a finite float64 array of shape (size,).

    Raises
    ------
    ArgumentError
        The message names the argument, the shape got and the shape expected.
    """
    if type(value) is not np.ndarray or value.dtype is not FLOAT64 or not value.flags.carray:
        value = real_array(name, value, (size,))
    if value.shape != (size,):
        raise ArgumentError(f"{name} has shape {value.shape}; expected ({size},)")
    if not is_finite(value):
        k = int(np.argmin(np.isfinite(value)))
        raise ArgumentError(f"{name}[{k}] = {value[k]} is not finite; expected {size} finite numbers")
    return value


def matrix(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    """`value` as a finite float64 array of shape (b, n); errors as in `vector`."""
    array = real_array(name, value, shape)
    if array.shape != shape:
        raise ArgumentError(f"{name} has shape {array.shape}; expected {shape}")
    return vector(name, array.reshape(-1), array.size).reshape(shape)


def real_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A writable, contiguous float64 copy: a read-only array is another type to the compiler, and compiles anew."""
    try:
        array = np.array(value)
    except ValueError as error:
        raise ArgumentError(f"{name}: not an array: {error}; expected shape {shape}") from None
    if array.dtype.kind not in "fiu":
        raise ArgumentError(f"{name} has dtype {array.dtype}; expected real numbers, shape {shape}")
    return np.ascontiguousarray(array, np.float64)


def dimensions(value: ArrayLike) -> int:
    """Number of dimensions; 1 for what is no array, which `vector` then refuses."""
    try:
        return np.ndim(value)
    except ValueError:
        return 1


def choice(name: str, value: str, allowed: dict[str, T]) -> T:
    """The entry of `allowed` that `value` names.

    Raises
    ------
    ArgumentError
        There is none; the message lists what is allowed.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ArgumentError(f"{name} = {value!r}: unknown; allowed are {', '.join(allowed)}")
    return allowed[value]


def wrench_vector(tip_wrench: ArrayLike | None) -> Array:
    """The tip wrench, shape (6,), zero if there is none; errors as in `vector`."""
    return NO_WRENCH if tip_wrench is None else vector("tip_wrench", tip_wrench, 6)
