"""Record of all that acts on a run from outside: drive, prescribed motions, tip wrench."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.kernels.inputs.tip_wrench import put_given, wrenches
from flexlink.kernels.layout import ChainArrays

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class MotionTable(NamedTuple):
    """θ = Σ_j c_j x^j of every prescribed joint; its pieces are first[m] … first[m + 1] − 1."""

    joints: Indices  # (r,)
    first: Indices  # (r + 1,)
    knots: Array  # (pieces,) [s]
    coefficients: Array  # (pieces, 6) [rad / s^j]


class WrenchTable(NamedTuple):
    """F = Σ_j c_j x^j, x = time since the last knot, in axes of frame 0 or, if it follows, of the tip."""

    follows: bool
    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, 6) [N / s^j, N m / s^j]
    chain: ChainArrays  # at whose tip it acts


class GivenWrench(NamedTuple):
    """What `analysis` takes of a wrench that does not change with time, as `solve_static` and `modes`."""

    tip_wrench: Array  # (6,)
    follower: bool  # it is in axes of the tip frame


def given_at(table: WrenchTable, t: float) -> GivenWrench:
    """The wrench of a table at time t [s]."""
    given = np.empty(6)
    put_given(table, t, t, given)
    return GivenWrench(given, table.follows)


class Inputs(NamedTuple):
    """All that acts on a run from outside."""

    drive: Any
    motion: MotionTable
    wrench: Array  # (6,) [N, N m] on the tip, frame 0; constant, or what every stage writes there from
    table: WrenchTable | None

    def given_wrench(self, t: float) -> GivenWrench:
        """The wrench at time t [s], in the axes that it is given in."""
        return GivenWrench(self.wrench, False) if self.table is None else given_at(self.table, t)

    @property
    def potential_force(self) -> Array:
        """A constant force, which has a potential and whose work runs do not integrate, shape (3,); else zero."""
        return self.wrench[:3] if self.table is None else np.zeros(3)

    def tip_wrenches(self, t: Array, q: Array, qd: Array) -> Array:
        """Force and moment in frame 0 at samples (rows,) with states (rows, n), shape (rows, 6)."""
        found = np.array(np.broadcast_to(self.wrench, (len(t), 6)))
        wrenches(self.table, t, q, qd, found)
        return found
