"""Results that are found once and kept: by object, while it lives on in the last few calls, or by owner."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from threading import Lock
from typing import Any, TypeVar, cast

import numpy as np

from flexlink.common.types import T

Function = TypeVar("Function", bound=Callable[..., Any])


class Memo:
    """The last results of a function by the identity of an object, which need not be hashable, and by a key.

    An object that changes must not be given. It is referred to as long as its result is kept, so that no other one
    takes its identity. Threads may share it: two that ask at once both find the result, and one of them is kept.
    """

    def __init__(self, size: int) -> None:
        self._size, self._lock = size, Lock()
        self._results = OrderedDict[tuple[int, Hashable], tuple[object, Any]]()

    def kept(self, of: object, key: Hashable) -> Any:
        """The result kept for `of` and `key`; None: there is none."""
        place = id(of), key
        with self._lock:
            if place not in self._results:
                return None
            self._results.move_to_end(place)
            return self._results[place][1]

    def __call__(self, of: object, key: Hashable, find: Callable[[], T]) -> T:
        """The result kept for `of` and `key`, or what `find` returns, which is then kept."""
        place = id(of), key
        with self._lock:
            if place in self._results:
                self._results.move_to_end(place)
                kept: T = self._results[place][1]
                return kept
        result = find()
        with self._lock:
            self._results[place] = of, result
            while len(self._results) > self._size:
                self._results.popitem(last=False)
        return result

    def calling(self, find: Callable[..., T], of: object, *given: object) -> T:
        """What `find(of, *given)` returns, kept by the contents of all that it is given: nothing can be left out."""
        return self(of, (find, contents(given)), lambda: find(of, *given))


def keep_last(size: int) -> Callable[[Function], Function]:
    """Keep the last results of a function by the identity of its first argument, and by the others, as `Memo` does."""

    def with_memo(find: Function) -> Function:
        memo = Memo(size)

        @wraps(find)
        def found(of: object, *given: Hashable) -> Any:
            return memo(of, given, lambda: find(of, *given))

        return cast("Function", found)

    return with_memo


def contents(given: object) -> Hashable:
    """A key that differs wherever numbers, texts, arrays, or tuples of these differ.

    >>> contents((np.zeros(2), "a")) == contents((np.zeros(2), "a"))
    True
    """
    if isinstance(given, np.ndarray):
        return given.dtype.str, given.shape, given.tobytes()
    return tuple(map(contents, given)) if isinstance(given, tuple) else (type(given), given)


class Kept:
    """The last result of each name, for one owner, who is not asked by two threads at once.

    Attributes
    ----------
    types
        Types of all that an owner whose arrays are its own takes from others; empty: its arrays may be anybody's.
    """

    def __init__(self) -> None:
        self.types = b""
        self._found: dict[Hashable, tuple[Hashable, Any]] = {}

    def __call__(self, name: Hashable, key: Hashable, find: Callable[[], Any]) -> Any:
        """The last result of this name, if it is of the same key, or what `find` returns, which is then kept."""
        last = self._found.get(name)
        if last is None or last[0] != key:
            self._found[name] = last = key, find()
        return last[1]
