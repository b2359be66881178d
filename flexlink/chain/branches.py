"""The branches of an arm as lines from body to body, for whatever draws it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array


def base_body(chain: Chain) -> int:
    """Number, from 1, of the body that is the base; 0 where it is fixed in frame 0."""
    return 2 if chain.has_free_base else 0


def branches_of(chain: Chain) -> list[list[int]]:
    """Numbers, from 1, of the bodies of every branch, each after the one that it hangs on; 0 is the fixed base.

    An arm that does not branch is one from 0 to its tip frame; one whose base floats begins with its base.
    """
    edges = [base_body(chain), *np.flatnonzero(chain.bodies["begins"]).tolist(), len(chain.bodies)]
    parents = chain.bodies["parent"].tolist()
    return [[parents[first], *range(first + 1, stop + 1)] for first, stop in pairwise(edges)]


def as_lines(chain: Chain, points: Array, *, base: bool = True) -> Array:
    """Origins of the bodies (…, bodies, 3) as lines along the branches, (…, m, 3), not a number between two of them.

    They go on from a fixed base, at the origin of frame 0, or, without `base`, from what hangs on it.
    """
    before = np.zeros((*points.shape[:-2], 1, 3))
    every = np.concatenate([before, points, np.full_like(before, np.nan)], axis=-2)
    order: list[int] = []
    for branch in branches_of(chain):
        order += [*([every.shape[-2] - 1] if order else []), *branch[0 if base or branch[0] else 1 :]]
    return np.asarray(every[..., order, :])
