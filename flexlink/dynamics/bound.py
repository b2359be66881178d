"""Compiled functions bound to a chain: its constants and their scratch are prepared once, at the first call."""

from __future__ import annotations

import functools
from collections.abc import Callable

from flexlink.chain.chain import Chain

Bound = Callable[..., bool]
"""Function of arrays, which it fills; returns False for arrays of another type or length, or if a value is not finite.
Only then does the caller check what is wrong."""


def bound(make: Callable[[Chain], Bound]) -> Callable[[Chain], Bound]:
    """Decorate a function that binds a kernel to a chain, so that each chain keeps the result."""
    name = f"bound {make.__name__}"

    @functools.wraps(make)
    def kept(chain: Chain) -> Bound:
        known = chain.__dict__
        if name not in known:
            known[name] = make(chain)
        found: Bound = known[name]
        return found

    return kept


def same(given: object, name: str) -> bool:
    """Whether an argument that may be of any type is this name."""
    return given is name or (type(given) is str and given == name)
