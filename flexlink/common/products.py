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
