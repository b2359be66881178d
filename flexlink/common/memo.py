"""Memoize results by object identity, for the last few calls, or by owner."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from threading import Lock
from typing import Any, TypeVar, cast

import numpy as np

from flexlink.common.types import T

Function = TypeVar("Function", bound=Callable[..., Any])


class Memo:
    """Cache of the last results of a function, keyed by an object's identity and a hashable key.

    The object may be unhashable, but must not change. It is referenced as long as its result is kept, so no other
    object can get its `id`. Threads may share a memo; if two ask for a result at once, both compute it.
    """

    def __init__(self, size: int) -> None:
        self._size, self._lock = size, Lock()
        self._results = OrderedDict[tuple[int, Hashable], tuple[object, Any]]()

    def __call__(self, of: object, key: Hashable, find: Callable[[], T]) -> T:
        """Return the result kept for `of` and `key`; if there is none, call `find` and keep its result."""
        slot = id(of), key
        with self._lock:
            if slot in self._results:
                self._results.move_to_end(slot)
                kept: T = self._results[slot][1]
                return kept
        result = find()
        with self._lock:
            self._results[slot] = of, result
            while len(self._results) > self._size:
                self._results.popitem(last=False)
        return result


def keep_last(size: int) -> Callable[[Function], Function]:
    """Keep the last results of a function, keyed by the first argument's identity and the `contents` of all others."""

    def with_memo(find: Function) -> Function:
        memo = Memo(size)

        @wraps(find)
        def found(of: object, *given: object) -> Any:
            return memo(of, contents(given), lambda: find(of, *given))

        return cast("Function", found)

    return with_memo


def contents(given: object) -> Hashable:
    """Return a hashable key that differs if numbers, strings, arrays, or tuples of these differ.

    >>> contents((np.zeros(2), "a")) == contents((np.zeros(2), "a"))
    True
    """
    if isinstance(given, np.ndarray):
        return given.dtype.str, given.shape, given.tobytes()
    return tuple(map(contents, given)) if isinstance(given, tuple) else (type(given), given)


class Kept:
    """Cache of the last result of each name, for one owner that only one thread uses at a time."""

    def __init__(self) -> None:
        self.types = b""  # of all arguments of a call, if only the owner can change its arrays; empty: may be shared
        self._found: dict[Hashable, tuple[Hashable, Any]] = {}

    def __call__(self, name: Hashable, key: Hashable, find: Callable[[], T]) -> T:
        """Return the last result of this name if its key is the same; if not, call `find` and keep its result."""
        last = self._found.get(name)
        if last is None or last[0] != key:
            self._found[name] = last = key, find()
        found: T = last[1]
        return found
