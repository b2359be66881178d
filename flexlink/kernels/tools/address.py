"""Calls from a loop in Python: a kernel reads constants and scratch from one address instead of many arguments.

To unpack a tuple of sixty arrays, a call needs longer than a recursion, and the code for it is as long. A kernel that
takes an `address` obtains them by `records(address)`; `bind` compiles it for their type and returns it as a function of
the other arguments. The numbers at the address are those of Numba's arrays and tuples: words of 8 bytes.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from flexlink.kernels.tools.compiler import entry_under_lock
from flexlink.kernels.tools.machine_code import size_of, types_of


def records(address: int) -> Any:
    """Constants and scratch of a kernel at `address`."""
    raise NotImplementedError(f"{address}: only functions returned by `bind` have records")


def bind(kernel: Callable[..., Any], given: tuple[Any, ...], *example: Any) -> Callable[..., Any]:
    """Return a kernel, a function of an `address` and of further arguments, as a function of the latter.

    Parameters
    ----------
    kernel
        Function of an address and further arguments, which calls `records(address)`.
    given
        The records: tuples of arrays, numbers and None. The function keeps them and refers to their memory.
    example
        Further arguments, for which the kernel is compiled and which it may overwrite. With arguments of other types
        the function returns False.

    The function holds Python's lock, so that threads cannot use the same scratch at once. Its attribute `quick` is the
    same function, a tenth of a microsecond faster, which raises a ValueError for an empty list.
    """
    if numba.config.DISABLE_JIT:
        interpreted = functools.partial(_with_records(kernel, lambda address: given, ""), 0)
        interpreted.quick = interpreted  # type: ignore[attr-defined]
        return interpreted
    key = kernel, types_of(given), types_of(example)
    memory = np.array([*words(given)], np.int64)
    address = memory.ctypes.data
    if key not in _BOUND:
        _BOUND[key] = _compiled(kernel, numba.typeof(given), memory, example)
    compiled = _BOUND[key]

    def call(*arguments: Any) -> Any:
        try:
            return compiled(address, *arguments)
        except ValueError:  # there is no type of an empty list
            return False

    call.quick = functools.partial(compiled, address)  # type: ignore[attr-defined]
    call.kept = call.quick.kept = given, memory  # type: ignore[attr-defined]
    return call


_BOUND: dict[tuple[Callable[..., Any], bytes, bytes], Callable[..., Any]] = {}


def words(given: Any) -> Iterator[int]:
    """Numba's representation of an array, number, None, or tuple of these, in words of 8 bytes."""
    if isinstance(given, tuple):
        for each in given:
            yield from words(each)
    elif isinstance(given, np.ndarray):  # no reference count, no owner, size, bytes of an item, place, …
        yield from (0, 0, given.size, given.itemsize, given.ctypes.data, *given.shape, *given.strides)
    elif isinstance(given, float):
        yield int(np.float64(given).view(np.int64))
    else:
        yield 0 if given is None else int(given)


def _compiled(kernel: Callable[..., Any], given: types.Type, memory: Any, example: tuple[Any, ...]) -> Any:
    """Compile a kernel for records of this type, which are in `memory`; with other arguments it returns False."""
    if size_of(given) != memory.nbytes:
        raise TypeError(f"{kernel.__name__}: its records do not consist of words of 8 bytes")
    name = f"{kernel.__qualname__}-{hashlib.sha256(str(given).encode()).hexdigest()[:16]}"
    compiled = entry_under_lock(_with_records(kernel, _load(given), name))
    compiled(memory.ctypes.data, *example)
    compiled._compile_for_args = lambda *arguments: _refused
    return compiled


def _refused(*arguments: Any) -> bool:
    return False


def _with_records(kernel: Callable[..., Any], load: Callable[[int], Any], name: str) -> Callable[..., Any]:
    """Copy of a function that obtains its records by `load`."""
    copy = FunctionType(kernel.__code__, {**kernel.__globals__, "records": load}, kernel.__name__)
    copy.__module__, copy.__qualname__ = kernel.__module__, name
    return copy


def _load(given: types.Type) -> Callable[[int], Any]:
    """A function for kernels that returns the records of this type at an address."""

    @intrinsic
    def load(context, address):
        def code(context, builder, signature, arguments):
            pointer = context.get_value_type(given).as_pointer()
            return builder.load(builder.inttoptr(arguments[0], pointer))

        return given(address), code

    return load  # type: ignore[no-any-return]
