"""Results that are found once of an object and kept while it lives on in the last few calls."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any

from flexlink.common.types import T


class Memo:
    """The last results of a function by the identity of an object, which need not be hashable, and by a key.

    An object that changes must not be given. It is referred to as long as its result is kept, so that no other one
    takes its identity. Threads may share it: two that ask at once both find the result, and one of them is kept.
    """

    def __init__(self, size: int) -> None:
        self._size, self._lock = size, Lock()
        self._results = OrderedDict[tuple[int, Hashable], tuple[object, Any]]()

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
