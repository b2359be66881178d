"""Products of small matrices and vectors that come out the same on every CPU, to the last bit.

`@` hands them to a BLAS, whose kernels, one for each family of CPUs, add in orders of their own and round once or
twice. What is kept of a chain, and what is written to files, is multiplied here.
"""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array


def product(first: Array, *others: Array) -> Array:
    """A B C … from left to right, the last one a matrix or a vector; sums in the order of their terms."""
    for other in others:
        if other.ndim == 1:
            return np.asarray(np.add.reduce(first[:, :, None] * other[:, None], axis=1)[:, 0])
        first = np.add.reduce(first[:, :, None] * other, axis=1)
    return first


def dot(a: Array, b: Array) -> float:
    """a · b."""
    return float(np.add.reduce(a * b))


def cross(a: Array, b: Array) -> Array:
    """a × b along the last axes, as `np.cross`, which takes 20 µs to find out about its axes; this takes 3 to 6."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    first = y * w - z * v
    found = np.empty((*first.shape, 3), first.dtype)
    found[..., 0], found[..., 1], found[..., 2] = first, z * u - x * w, x * v - y * u
    return found
