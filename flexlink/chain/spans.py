"""Bodies in a row, one hanging on the other: the branches of an arm, and sums along them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array


class Branch(NamedTuple):
    """Bodies that hang one on the other, from 0, and what the first one hangs on."""

    parent: int  # number from 0, −1: the base
    first: int
    stop: int


def spans_of(bodies: NDArray[np.void]) -> list[Branch]:
    """All branches of an arm by its bodies, its base's own joints included; each hangs on a body of one before it."""
    edges = [0, *np.flatnonzero(bodies["begins"]).tolist(), len(bodies)]
    return [Branch(int(bodies["parent"][first]) - 1, first, stop) for first, stop in pairwise(edges)]


def sums_outward(spans: list[Branch], terms: Array) -> Array:
    """Of terms of the bodies, (bodies, …), the sum of all from the base up to each body."""
    sums = np.empty_like(terms)
    for parent, first, stop in spans:
        start = sums[parent] if parent >= 0 else np.zeros(terms.shape[1:])
        sums[first:stop] = np.cumsum(np.concatenate([start[None], terms[first:stop]]), axis=0)[1:]
    return sums


def sums_inward(spans: list[Branch], terms: Array) -> Array:
    """Of terms of the bodies, (bodies, …), the sum of each and of all that hang on it."""
    sums = terms.copy()
    for parent, first, stop in reversed(spans):
        sums[first:stop] = np.cumsum(sums[first:stop][::-1], axis=0)[::-1]
        if parent >= 0:
            sums[parent] += sums[first]
    return sums
