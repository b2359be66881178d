"""Products with what springs and dampers between two hinges add to a matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array


def add_products(product: Array, couplings: NDArray[np.void], value: Array, φ: Array) -> None:
    """Add `value` φ_j to hinge i of each coupling (couplings,), and `value` φ_i to hinge j; (n,) or (b, n)."""
    inner, outer = couplings["inner"], couplings["outer"]
    np.add.at(product.T, inner, (value * φ[..., outer]).T)
    np.add.at(product.T, outer, (value * φ[..., inner]).T)
