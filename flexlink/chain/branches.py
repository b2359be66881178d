"""Branches of an arm: parents of bodies, and lines from body to body for drawing."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.layout import spans_of
from flexlink.common.types import Array


def base_body(chain: Chain) -> int:
    """Number, from 1, of the body that is the base; 0 if the base is fixed in frame 0."""
    return 2 if chain.has_free_base else 0


def of_parents(chain: Chain, values: Array, of_base: Array) -> Array:
    """Values of each body's parent, shape (bodies, …); `of_base` is used for bodies attached to the base."""
    return np.asarray(np.concatenate([of_base[None], values])[chain.bodies["parent"]])


def branches_of(chain: Chain) -> list[list[int]]:
    """Numbers, from 1, of the bodies of every branch; a branch comes after its parent's branch; 0 is the fixed base.

    An unbranched arm is one branch from 0 to its tip frame; with a floating base it begins at that base.
    """
    base = base_body(chain)
    spans = [span._replace(first=max(base, span.first)) for span in spans_of(chain.bodies) if span.stop > base]
    return [[int(chain.bodies["parent"][first]), *range(first + 1, stop + 1)] for _, first, stop in spans]


def unslid(chain: Chain, rotations: Array, points: Array) -> Array:
    """Origins that the bodies would have if all sliding joints were at zero, (bodies, 3), from poses in frame 0."""
    R, p = of_parents(chain, rotations, np.eye(3)), of_parents(chain, points, np.zeros(3))
    return np.asarray(p + np.einsum("bij,bj->bi", R, chain.bodies["translation"]))


def sliding_bodies(chain: Chain) -> list[int]:
    """Indices, from 0, of bodies that slide on their parents, except a floating base."""
    first = chain.bodies["first"]
    some = np.flatnonzero(first < chain.bodies["stop"]).tolist()
    return [k for k in some if k >= base_body(chain) and chain.slides[first[k]]]


def as_lines(chain: Chain, points: Array, *, base: bool = True, rails: Array | None = None) -> Array:
    """Origins of the bodies (…, bodies, 3) as lines along the branches, (…, m, 3), separated by nan.

    Lines start at a fixed base, the origin of frame 0, or, without `base`, at the bodies attached to it. Lines to
    sliding bodies pass through their positions at zero, `rails`, which are returned by `unslid`.
    """
    before, count = np.zeros((*points.shape[:-2], 1, 3)), points.shape[-2] + 1
    every = np.concatenate([before, points, np.full_like(before, np.nan), points if rails is None else rails], axis=-2)
    slide = set() if rails is None else {k + 1 for k in sliding_bodies(chain)}
    order: list[int] = []
    for branch in branches_of(chain):
        order += [count] if order else []
        for b in branch[0 if base or branch[0] else 1 :]:
            order += [count + b, b] if b in slide and b != branch[0] else [b]
    return np.asarray(every[..., order, :])
