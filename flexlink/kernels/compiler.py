"""The decorators of all kernels: compiled by numba, kept on disk (`machine_code`)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import numba
from numba.core import event

from flexlink.kernels.machine_code import BORROWS, keep_on_disk


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
    """Call `started` when something is about to be compiled, which takes seconds, and `ended` afterwards."""
    with event.install_listener("numba:compile", _Watch(started, ended)):
        yield


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` on its first call and keep the machine code on disk.

    `error_model="numpy"` makes a division by zero inf or nan instead of a branch to raise: no check in kernels.
    """
    return _compile(function)


# `contract` lets a·b + c be one instruction with one rounding; nothing is reordered.
ARITHMETIC: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
INLINED = {"forceinline": True, **BORROWS, **ARITHMETIC}  # of overloads


def recursion(function: Callable[..., Any]) -> Any:
    """A kernel that makes no arrays, only borrows those of its caller: it does not count references to them."""
    return _compile(function, **BORROWS)


def inlined(function: Callable[..., Any]) -> Any:
    """A formula: makes no arrays, and is expanded where it is called, so that loops can become vector instructions."""
    return _compile(function, forceinline=True, **BORROWS)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    compiled = numba.njit(nogil=True, **ARITHMETIC, **options)(function)
    if not numba.config.DISABLE_JIT:
        keep_on_disk(compiled, function)
    return compiled
