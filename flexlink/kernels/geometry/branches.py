"""Rows in which a recursion stores the state at the forks of a tree and adds up the contributions of the branches.

Row 0 belongs to the base. A body with branches uses row `fork`; the first body of a branch uses the row of its parent,
`slot` (see `layout`).
"""

import numpy as np

from flexlink.kernels.tools.compiler import allocating, kernel
from flexlink.kernels.tools.lanes import empty_lanes


@allocating
def rows_of_forks(bodies):
    """Number of rows, including the row of the base; zero for a chain without branches."""
    rows = 0
    for i in range(len(bodies)):
        if bodies[i].begins:
            rows = max(rows, 1 + bodies[i].slot)
    return rows


@allocating
def fork_rows(chain, *shape):
    """Return an array of zeros with a row of this shape per fork; None for a plain chain."""
    return None if chain.rare is None else np.zeros((rows_of_forks(chain.bodies), *shape))


@allocating
def fork_lanes(chain, size):
    """`fork_rows` for eight states side by side."""
    return None if chain.rare is None else empty_lanes((rows_of_forks(chain.bodies), size))


@kernel
def loaded_body(bodies):
    """Index of the body on which the tip wrench acts."""
    found = len(bodies) - 1
    for i in range(len(bodies)):
        if bodies[i].loaded:
            found = i
    return found


@kernel
def path_to(bodies, last):
    """Indices of the bodies on the path from the base to body `last`, inclusive."""
    path, number = np.full(len(bodies), -1), last + 1
    first = len(path)
    while number > 0:
        first -= 1
        path[first] = number - 1
        number = bodies[number - 1].parent
    return path[first:].copy()
