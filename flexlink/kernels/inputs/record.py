"""Record of all that acts on a run from outside: drive, prescribed motions, tip wrench."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.kernels.bodies.rigid_model import RigidModel
from flexlink.kernels.inputs.tip_wrench import put_given, wrenches
from flexlink.kernels.layout import ChainArrays


class PiecewisePolynomial(NamedTuple):
    """Σ_j c_j x^j of d joints, x = t − the last knot; the last piece goes on for ever.

    Before the first knot stands its value, with its rate and acceleration: let it lie at or before the start of the
    run, or its piece be a constant one.
    """

    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, d) [rad / s^j] or [N m / s^j]


class Drive(NamedTuple):
    """The drive of d joints by any law (`laws`); what a law does not use is empty or zero.

    One type for all laws: stepping loops are compiled once, whatever drives the arm.
    """

    law: int  # its number in `laws`
    rate: float  # how often it is sampled, its torques held in between [Hz]; 0: asked at every stage
    joints: Indices  # (d,)
    effort: Array  # (d,) largest torque [N m]
    limits: Array  # (2, d) least and largest torque [N m]: ± effort, or what a step takes them for (`saturation`)
    reference: PiecewisePolynomial  # r [rad / s^j]
    feedforward: PiecewisePolynomial  # g [N m / s^j]
    kp: Array  # (d,) [N m/rad], of computed torque [1/s²]
    kd: Array  # (d,) [N m s/rad], of computed torque [1/s]
    model: RigidModel | None  # of the laws that need one; None in loops for plain chains
    held: Array  # (m, d) what a sampled law gave at its last m instants [N m]
    next_instant: Indices  # (1,) number of the instant of a sampled law that comes next


class MotionTable(NamedTuple):
    """θ = Σ_j c_j x^j of every prescribed joint; its pieces are first[m] … first[m + 1] − 1."""

    joints: Indices  # (r,)
    first: Indices  # (r + 1,)
    knots: Array  # (pieces,) [s]
    coefficients: Array  # (pieces, 6) [rad / s^j]


class Loads(NamedTuple):
    """The tip wrench where it changes, or its work has to be found, at every stage.

    F = Σ_j c_j x^j, x = time since the last knot, in axes of frame 0 or, if it follows, of the tip.
    """

    varies: bool  # False: the constant wrench of the inputs acts on the arm's tip, and nothing is to find
    follows: bool
    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, 6) [N / s^j, N m / s^j]
    chain: ChainArrays  # at whose tip it acts
    path: Indices  # bodies from the base to that tip

    def holding(self, wrench: Array, chain: ChainArrays) -> Loads:
        """The same with a constant wrench (6,) in frame 0, on a chain that may say otherwise where a base is."""
        return self._replace(follows=False, knots=np.zeros(1), coefficients=wrench.reshape(1, 1, 6).copy(), chain=chain)


class GivenWrench(NamedTuple):
    """What `analysis` takes of a wrench that does not change with time, as `solve_static` and `modes`."""

    tip_wrench: Array  # (6,)
    follower: bool  # it is in axes of the tip frame


def given_at(loads: Loads, t: float) -> GivenWrench:
    """Their wrench at time t [s]."""
    given = np.empty(6)
    put_given(loads, t, t, given)
    return GivenWrench(given, loads.follows)


class Inputs(NamedTuple):
    """All that acts on a run from outside."""

    drive: Drive
    motion: MotionTable
    wrench: Array  # (6,) [N, N m] on the tip, frame 0; constant, or what every stage writes there from
    loads: Loads | None  # None in loops for plain chains

    @property
    def changing(self) -> Loads | None:
        """Those of a tip wrench that has to be found at every stage."""
        return self.loads if self.loads is not None and self.loads.varies else None

    def given_wrench(self, t: float) -> GivenWrench:
        """The wrench at time t [s], in the axes that it is given in."""
        return given_at(self.changing, t) if self.changing else GivenWrench(self.wrench, False)

    @property
    def potential_force(self) -> Array:
        """A constant force, which has a potential and whose work runs do not integrate, shape (3,); else zero."""
        return np.zeros(3) if self.changing else self.wrench[:3]

    def tip_wrenches(self, t: Array, q: Array, qd: Array) -> Array:
        """Force and moment in frame 0 at samples (rows,) with states (rows, n), shape (rows, 6)."""
        found = np.empty((len(t), 6))
        found[:] = self.wrench
        if self.changing:
            wrenches(self.loads, t, q, qd, found)
        return found
