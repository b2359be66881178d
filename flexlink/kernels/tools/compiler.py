"""Decorators of all kernels: compiled by Numba, cached on disk (`machine_code`)."""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import event
from numba.extending import overload

from flexlink.kernels.tools.absent import KernelCompiler
from flexlink.kernels.tools.machine_code import (
    BORROWS,
    NO_C,
    ONLY_KERNELS,
    as_dtype,
    choose,
    keep_on_disk,
    refuse_python,
    share,
)


class _Watch(event.Listener):
    def __init__(self, started: Callable[[], None], ended: Callable[[], None]) -> None:
        self.started, self.ended, self.depth = started, ended, 0

    def on_start(self, event: Any) -> None:
        self.depth += 1
        if self.depth == 1:
            self.started()

    def on_end(self, event: Any) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.ended()


@contextlib.contextmanager
def watched(started: Callable[[], None], ended: Callable[[], None]) -> Iterator[None]:
    """Call `started` before a function is compiled, which takes seconds, and `ended` afterwards."""
    with event.install_listener("numba:compile", _Watch(started, ended)):
        yield


_THRESHOLD = gc.get_threshold()
# While compiling, the garbage collector runs rarely, and never a full collection: this saves an eighth of the time.
event.register(
    "numba:compile", _Watch(lambda: gc.set_threshold(50_000, 20, 1000), lambda: gc.set_threshold(*_THRESHOLD))
)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` on its first call and cache the machine code on disk.

    With `error_model="numpy"` a division by zero gives inf or nan instead of an exception: kernels have no checks.
    """
    return _compile(function)


def unfused(function: Callable[..., Any]) -> Any:
    """A `kernel` without fused multiply-add, whose results are those of the same formulas in NumPy, bit for bit."""
    return _compile(function, fastmath=False)


# `contract` allows fused multiply-add for a·b + c; nothing is reordered.
ARITHMETIC: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
RECURSION = {**BORROWS, **ONLY_KERNELS, **ARITHMETIC}  # for overloads
INLINED = {"forceinline": True, **RECURSION}


def recursion(function: Callable[..., Any]) -> Any:
    """A function only for kernels that allocates no arrays and counts no references to its caller's arrays."""
    return _compile(function, **BORROWS, **ONLY_KERNELS)


def allocating(function: Callable[..., Any]) -> Any:
    """A function for kernels that allocates arrays, such as a workspace. It cannot be called from Python."""
    return _compile(function, **ONLY_KERNELS)


def subroutine(function: Callable[..., Any]) -> Any:
    """A long recursion that kernels call by its symbol: they do not inline it, so it is compiled only once.

    It is not used for forward dynamics, which loops call so often that steps take 4 to 20 % longer without inlining.
    """
    return shared(recursion(function))


def shared(compiled: Any) -> Any:
    """Turn a function that Python also calls into a `subroutine` of kernels."""
    if not numba.config.DISABLE_JIT:
        share(compiled)
    return compiled


def entry(function: Callable[..., Any]) -> Any:
    """A recursion that Python also calls."""
    return _compile(function, **BORROWS)


def entry_under_lock(function: Callable[..., Any]) -> Any:
    """An `entry` that holds Python's lock during the call, so that threads can share its scratch."""
    return _compile(function, nogil=False, **BORROWS)


def inlined(function: Callable[..., Any]) -> Any:
    """A short recursion, such as a formula, that is always inlined, so that loops can be vectorized."""
    return _compile(function, forceinline=True, **BORROWS, **ONLY_KERNELS)


def by_type(algorithms: dict[type, Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Replace a function by one of several algorithms, selected by the type of its last argument, a workspace.

    A compiled kernel calls the selected function directly; the others are not compiled.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(*arguments: Any) -> Any:
            return algorithms[type(arguments[-1])](*arguments)

        choose(call, algorithms)
        call.algorithms = algorithms  # type: ignore[attr-defined]  # for the test of the rehearsal
        return call

    return decorate


def of_each(
    functions: dict[Any, Any], *, summed: bool = True, optional: bool = False
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Define a function of a tuple of records that calls the function for each record's type and sums the results.

    A record may be a structured array; its dtype then replaces its type. In a compiled kernel the loop is unrolled.
    `optional`: types without a function are skipped.
    """

    def of(kinds: list[Any]) -> dict[int, Any]:
        return {k: functions[kind] for k, kind in enumerate(kinds) if kind in functions or not optional}

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(elements: Any, *arguments: Any) -> Any:
            kinds = [element.dtype if isinstance(element, np.ndarray) else type(element) for element in elements]
            found = [each(elements[k], *arguments) for k, each in of(kinds).items()]
            return sum(found) if summed else None

        @overload(call, jit_options=INLINED)
        def unroll(elements, *arguments):
            each = of([as_dtype(e.dtype) if isinstance(e, types.Array) else e.instance_class for e in elements])
            names = {f"f{k}": function for k, function in each.items()}
            calls = [f"f{k}(elements[{k}], *arguments)" for k in each]
            lines = calls if not summed else ["return " + " + ".join(calls)]
            exec("def unrolled(elements, *arguments):\n    " + "\n    ".join(lines), names)
            return names["unrolled"]

        return call

    return decorate


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    options = {"nogil": True, "forceinline": False, **ARITHMETIC, **NO_C, **options}
    compiled = numba.njit(pipeline_class=KernelCompiler, **options)(function)
    if not numba.config.DISABLE_JIT:
        keep_on_disk(compiled)
        if options.keys() >= ONLY_KERNELS.keys():
            refuse_python(compiled)
    return compiled
