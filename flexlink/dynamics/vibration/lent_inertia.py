"""The inertia that cells lend to the last segment of a link, and how much of it modes under tension can bear.

The last segment of a beam with cells has its mass at its hinge, and would have no inertia: M would be singular. The
segment before lends it J (`Cells.tip`). In plain bending the frequency √(k/J)/2π of this segment on its spring k is far
above those of the arm. A tension N that straightens segments of length l more than k does, N l > k, raises all other
frequencies but not this one, as N vanishes at the free end: it would be among those of the arm, and shift them. With

    J k / (N l)        if N l > k, with the largest N of the link

it stays above them, as in plain bending. The exact value is 0, so that the modes of the arm become more accurate.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Kind
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.loads import internal_loads
from flexlink.dynamics.placement import hinge_bodies


def relieved(chain: Chain, q: Array, qd: Array, wrench: Array, frame: Frame) -> tuple[Chain, Array]:
    """Return the chain with less lent inertia under tension, and the lent inertia about each hinge axis [kg m²], (n,).

    The tension is that of a steady motion, at angles q and rates qd, (n,), with a tip wrench as in `internal_loads`.
    """
    on, axis = hinge_bodies(chain), chain.hinges["axis"]
    lent = np.where((axis == 1) | (axis == 2), chain.described["lent"][on], 0.0)
    hinges = np.flatnonzero(lent)
    if not len(hinges):
        return chain, lent
    tension = internal_loads(chain, q, qd, np.zeros(chain.n), tip_wrench=wrench, frame=frame).N
    bodies, links = chain.bodies.copy(), np.array([c.link if c.kind is Kind.HINGE else 0 for c in chain.coordinates])
    for k in hinges.tolist():
        i, a, pull = on[k], axis[k], tension[on[links == links[k]]].max()
        held = pull * np.linalg.norm(bodies["translation"][i])
        freed = lent[k] * (1 - min(1.0, chain.stiffness[k] / held)) if held > 0 else 0.0
        lent[k] -= freed
        bodies["inertia"][i, a, a] -= freed
        bodies["inertia"][bodies["parent"][i] - 1, a, a] += freed
    return chain.with_numbers(bodies=bodies), lent
