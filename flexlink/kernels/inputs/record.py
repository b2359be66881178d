"""Record of all inputs of a run: drive, prescribed motions, tip wrench."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.kernels.inputs.tip_wrench import put_given, wrenches
from flexlink.kernels.layout import ChainArrays


class PiecewisePolynomial(NamedTuple):
    """Σ_j c_j x^j of d joints, with x = t minus the last knot before t; the last piece continues without end.

    Before the first knot, the value, rate and acceleration at the knot apply. The first knot must therefore be at or
    before the start of the run, or the first piece must be constant.
    """

    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, d) [rad / s^j] or [N m / s^j]


class Drive(NamedTuple):
    """The drive of d joints by any law (`laws`); entries that a law does not use are empty or zero.

    All laws share one type, so stepping loops are compiled once.
    """

    law: int  # number of the law in `laws`
    rate: float  # sampling rate; torques are constant between samples [Hz]; 0: evaluated at every stage
    delay: float  # from a sampling instant until its torques act [s]
    joints: Indices  # (d,)
    effort: Array  # (d,) largest torque [N m]
    limits: Array  # (2, d) smallest and largest torque [N m]: ± effort, or as assumed in a step (`saturation`)
    reference: PiecewisePolynomial  # r [rad / s^j]
    feedforward: PiecewisePolynomial  # g [N m / s^j]
    kp: Array  # (d,) [N m/rad]; computed torque: [1/s²]
    kd: Array  # (d,) [N m s/rad]; computed torque: [1/s]
    servo: Array  # (d, 4) of a cascade: integral gain, rate limit, rate feedforward, inertia (`cascade`)
    filters: Array  # (d, f + 1, f + 3) of a cascade: filters of the torques (`cascade`)
    model: Any  # `RigidModel` for laws that need one, side by side a tuple of eight; None in loops for plain chains
    held: Array  # (m, d + …) torques of a sampled law at its last m instants [N m], and then its memory (`cascade`)
    next_instant: Indices  # (1,) number of the next instant of a sampled law

    def delayed(self, t: float) -> Array:
        """Torques of instants before t [s] that act at t or later, (m, 1 + d): time from which they act [s], torques.

        The drive is a sampled law, or torques held by a table (of a law in Python). Rows of a law with memory continue
        with this memory, and include the last instant.
        """
        memory = self.rate > 0 and self.held.shape[1] > len(self.joints)
        if not self.delay and not memory:
            return np.empty((0, 1 + len(self.joints)))
        near = 1e-9 * (self.delay or 1.0 / self.rate)
        if self.rate:
            first = math.floor((t - self.delay) * self.rate - 1.0)
            numbers = np.arange(first, math.ceil(t * self.rate) + 1)
            acting, torques = numbers / self.rate + self.delay, self.held[numbers % len(self.held)]
        else:
            acting, torques = self.feedforward.knots, self.feedforward.coefficients[:, 0]
        stop = int(np.searchsorted(acting, t + self.delay - near))
        start = max(0, int(np.searchsorted(acting, t + near)) - 1)
        if memory:
            start = min(start, stop - 1)
        return np.column_stack([acting, torques])[start:stop]


class MotionTable(NamedTuple):
    """θ = Σ_j c_j x^j of every prescribed joint; joint m has pieces first[m] … first[m + 1] − 1."""

    joints: Indices  # (r,)
    first: Indices  # (r + 1,)
    knots: Array  # (pieces,) [s]
    coefficients: Array  # (pieces, 6) [rad / s^j]


@functools.cache
def no_motion() -> MotionTable:
    """Motion table without joints. All runs share it, since it is never written to."""
    return MotionTable(np.empty(0, np.int64), np.zeros(1, np.int64), np.empty(0), np.empty((0, 6)))


class Loads(NamedTuple):
    """Tip wrench that changes with time, or whose work must be integrated; evaluated at every stage.

    F = Σ_j c_j x^j, with x = time since the last knot, in axes of frame 0 or, for a follower, of the tip.
    """

    varies: bool  # False: the constant wrench of the inputs acts on the tip, nothing is evaluated
    follows: bool
    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, 6) [N / s^j, N m / s^j]
    chain: ChainArrays  # the chain with the loaded tip
    path: Indices  # indices of the bodies from the base to that tip

    def holding(self, wrench: Array, chain: ChainArrays) -> Loads:
        """Return a copy with a constant wrench (6,) in frame 0, on `chain`, whose base may be elsewhere."""
        return self._replace(follows=False, knots=np.zeros(1), coefficients=wrench.reshape(1, 1, 6).copy(), chain=chain)


class GivenWrench(NamedTuple):
    """A constant wrench in the form that `solve_static` and `modes` accept."""

    tip_wrench: Array  # (6,)
    follower: bool  # whether it is in axes of the tip frame


def given_at(loads: Loads, t: float) -> GivenWrench:
    """Return the wrench at time t [s]."""
    given = np.empty(6)
    put_given(loads, t, t, given)
    return GivenWrench(given, loads.follows)


class Inputs(NamedTuple):
    """All inputs of a run."""

    drive: Drive
    motion: MotionTable
    wrench: Array  # (6,) [N, N m] on the tip, frame 0; constant, or overwritten at every stage
    loads: Loads | None  # None in loops for plain chains

    @property
    def changing(self) -> Loads | None:
        """Loads that must be evaluated at every stage; None if the wrench is constant."""
        return self.loads if self.loads is not None and self.loads.varies else None

    def given_wrench(self, t: float) -> GivenWrench:
        """Return the wrench at time t [s], in the axes in which it was specified."""
        return given_at(self.changing, t) if self.changing else GivenWrench(self.wrench, False)

    @property
    def potential_force(self) -> Array:
        """Tip force (3,) if constant, else zero. A constant force has a potential: its work is not integrated."""
        return np.zeros(3) if self.changing else self.wrench[:3]

    def tip_wrenches(self, t: Array, q: Array, qd: Array) -> Array:
        """Force and moment in frame 0, (rows, 6), at the times (rows,) and states (rows, n) of samples."""
        found = np.empty((len(t), 6))
        found[:] = self.wrench
        if self.changing:
            wrenches(self.loads, t, q, qd, found)
        return found
