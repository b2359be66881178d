"""Compiled functions bound to a chain: its constants and their scratch are prepared once, at the first call."""

import functools
from collections.abc import Callable

from flexlink.chain.chain import Chain

Bound = Callable[..., bool]
"""Function of arrays, which it fills; returns False for arrays of another type or length, or if a value is not finite.
Only then does the caller check what is wrong."""


def bound(make: Callable[..., Bound]) -> Callable[..., Bound]:
    """Decorate a function that binds a kernel to a chain, so that each chain keeps the result for each name given."""
    name = f"bound {make.__name__}"

    @functools.wraps(make)
    def kept(chain: Chain, *names: str) -> Bound:
        key = " ".join((name, *names)) if names else name
        try:
            found: Bound = chain.__dict__[key]
        except KeyError:
            found = chain.__dict__[key] = make(chain, *names)
        return found

    return kept


def unbind(chain: Chain) -> None:
    """Forget all bound functions of a chain whose numbers change: their scratch contains some of these."""
    for key in [key for key in vars(chain) if key.startswith("bound ")]:
        del vars(chain)[key]
