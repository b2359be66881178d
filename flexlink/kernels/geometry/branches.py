"""Where a recursion keeps what branches of a tree go on from, and adds up what they bring: a row for every fork.

Row 0 is that of the base; a body's is its `fork`, and of one with which a branch begins its `slot` (`layout`).
"""

import numpy as np

from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.lanes import empty_lanes


@kernel
def rows_of_forks(bodies):
    """How many rows there are, that of the base included; none of a chain without branches."""
    rows = 0
    for i in range(len(bodies)):
        if bodies[i].begins:
            rows = max(rows, 1 + bodies[i].slot)
    return rows


@kernel
def fork_rows(chain, size):
    """As many rows of `size` numbers; None of a plain chain."""
    if chain.rare is None:
        return None
    return np.zeros((rows_of_forks(chain.bodies), size))


@kernel
def fork_lanes(chain, size):
    """The same for eight states side by side."""
    if chain.rare is None:
        return None
    return empty_lanes((rows_of_forks(chain.bodies), size))


@kernel
def loaded_body(bodies):
    """Number of the one on which the tip wrench acts."""
    found = len(bodies) - 1
    for i in range(len(bodies)):
        if bodies[i].loaded:
            found = i
    return found


@kernel
def path_to(bodies, last):
    """Numbers of the bodies on the path from the base to one, itself included."""
    path, number = np.full(len(bodies), -1), last + 1
    first = len(path)
    while number > 0:
        first -= 1
        path[first] = number - 1
        number = bodies[number - 1].parent
    return path[first:].copy()
