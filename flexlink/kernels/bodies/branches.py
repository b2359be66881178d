"""Where a recursion keeps what branches of a tree go on from, and adds up what they bring: a row for every fork.

Row 0 is that of the base; a body's is its `fork`, and of one with which a branch begins its `slot` (`layout`).
"""

from flexlink.kernels.tools.compiler import kernel


@kernel
def rows_of_forks(bodies):
    """How many rows there are, that of the base included; none of a chain without branches."""
    rows = 0
    for i in range(len(bodies)):
        if bodies[i].begins:
            rows = max(rows, 1 + bodies[i].slot)
    return rows
