"""Branches of an arm, which are serial chains of bodies, and sums along them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array


class Branch(NamedTuple):
    """Consecutive bodies, indexed from 0, each the parent of the next, and the parent of the first one."""

    parent: int  # number of the first body's parent, from 0; −1 is the base
    first: int
    stop: int


def spans_of(bodies: NDArray[np.void]) -> list[Branch]:
    """All branches of an arm, including the joints of its base; each branch comes after its parent's branch."""
    edges = [0, *np.flatnonzero(bodies["begins"]).tolist(), len(bodies)]
    return [Branch(int(bodies["parent"][first]) - 1, first, stop) for first, stop in pairwise(edges)]


def sums_outward(spans: list[Branch], terms: Array) -> Array:
    """Sums of the terms of all bodies from the base up to each body, shape (bodies, …)."""
    sums = np.empty_like(terms)
    for parent, first, stop in spans:
        start = sums[parent] if parent >= 0 else np.zeros(terms.shape[1:])
        sums[first:stop] = np.cumsum(np.concatenate([start[None], terms[first:stop]]), axis=0)[1:]
    return sums


def sums_inward(spans: list[Branch], terms: Array) -> Array:
    """Sums of the terms of all bodies in the subtree of each body, shape (bodies, …)."""
    sums = terms.copy()
    for parent, first, stop in reversed(spans):
        sums[first:stop] = np.cumsum(sums[first:stop][::-1], axis=0)[::-1]
        if parent >= 0:
            sums[parent] += sums[first]
    return sums
