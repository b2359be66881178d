"""Checks of new samples of a run: power balance, bending angles, joint limits, and the angle travelled.

A sample is checked against earlier samples only, so the result does not depend on when samples are read.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω        r = E(t) − E(0) − W(t)

X is the largest T + |ΔV_g| + |ΔV_e| + |W| up to the sample, the energy exchanged. ε is the effect of rounding: the
largest of one step, 4 eps (|T| + |V_g| + |V_e| + |W| + m g · size · max(1, |q|)), times the number of steps. A sample
is garbage if |r| > share · X + ε + the effect of the tolerance.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.kernels.tools.compiler import entry, recursion
from flexlink.kernels.tools.numbered import numbered

EPS = 2.0**-52

SEEN = numbered(
    "start:3",  # T, V_g and V_e at the start [J]
    "low:3 high:3",  # corners of the box around the path of the tip [m]
    "exchanged rounded",  # X, and the rounding error of one step, largest so far [J]
    "unbalanced excused",  # |r| minus the effect of the tolerance, and minus that of rounding, largest so far [J]
    "travelled",  # angle of all free joints, back and forth, from their rates [rad]
    "garbage imbalance available",  # row of the first garbage sample, −1: none; its r and X [J]
    "last",  # r of the last row [J]
    "bent beyond",  # whether a hinge is bent too far; whether a joint is past its limits
)
"""Results of the checks so far."""

WRONG = numbered("nothing balance kinetic finite")
"""Faults of a sample: its energy does not balance, its kinetic energy is negative, a number is not finite."""


class Allowance(NamedTuple):
    """Imbalance that a tolerance δ may cause: δ (weight + momentum √T), T the kinetic energy."""

    least: float = 0.0  # δ [m], at least:
    part: float = 0.0  # of the largest deflection so far
    weight: float = 0.0  # at any sample [N]
    momentum: float = 0.0  # of a moving sample [√J/m]
    share: float = math.inf  # upper limit, relative to the energy exchanged: share · δ / extent of the motion so far
    damped: bool = False  # whether losses are allowed: an implicit method damps fast vibrations
    compared: bool = False  # whether a second run checks instead, so no sample is garbage


class Bounds(NamedTuple):
    """Limits of the checks, and the joints to which they apply."""

    force: Any  # (3,) a constant force on the tip, whose work is not integrated [N]
    weight: float  # m g · size [J]
    share: float  # imbalance relative to the energy exchanged from which a sample is garbage
    insisted: bool  # whether the run continues after a warning of garbage
    bend: float  # angle of a hinge [rad]
    near: float  # tolerance of a joint limit [rad]
    bending: Any  # indices of the joints that bend,
    limited: Any  # of those with limits,
    travelling: Any  # of the driven ones that are not prescribed


@entry
def look_at(first, stop, samples, hinges, bounds, allowance, seen):
    """Check the samples `first` … `stop` − 1 up to the first fault; return its row (`stop`: none) and the fault.

    `samples`: t (rows,), q, q̇, τ (rows, n), tip (rows, 3), energies (3, rows), W (rows,) without that of a constant
    force, and counters of the steps so far (rows, SO_FAR.size). `seen` (SEEN.size,) is updated.
    """
    t, q, qd, tau, tip, energy, works, so_far = samples
    for row in range(first, stop):
        W = works[row]
        for i in range(3):
            W += (tip[row, i] - tip[0, i]) * bounds.force[i]
            seen[SEEN.low + i] = min(seen[SEEN.low + i], tip[row, i])
            seen[SEEN.high + i] = max(seen[SEEN.high + i], tip[row, i])
        T, V_g, V_e = energy[0, row], energy[1, row], energy[2, row]
        ΔV_g, ΔV_e = V_g - seen[SEEN.start + 1], V_e - seen[SEEN.start + 2]
        r = T - seen[SEEN.start] + ΔV_g + ΔV_e - W
        X = max(seen[SEEN.exchanged], T + abs(ΔV_g) + abs(ΔV_e) + abs(W))
        seen[SEEN.last] = r
        if not (math.isfinite(r) and math.isfinite(X) and finite(tau[row])):
            return row, WRONG.finite
        size = abs(T) + abs(V_g) + abs(V_e) + abs(W) + bounds.weight * max(1.0, largest(q[row]))
        seen[SEEN.exchanged], seen[SEEN.rounded] = X, max(seen[SEEN.rounded], 4.0 * EPS * size)
        ε = seen[SEEN.rounded] * (1.0 + so_far[row, SO_FAR.steps])
        δ = max(allowance.least, allowance.part * so_far[row, SO_FAR.deflection])
        explained = ε + explained_by(allowance, δ, extent(seen), r, X, T)
        garbage = abs(r) > bounds.share * X + explained and not allowance.compared
        if garbage and seen[SEEN.garbage] < 0.0:
            seen[SEEN.garbage], seen[SEEN.imbalance], seen[SEEN.available] = row, r, X
        if -ε > T:
            return row, WRONG.kinetic
        if garbage and not bounds.insisted:
            return row, WRONG.balance
        if not garbage:
            seen[SEEN.unbalanced] = max(seen[SEEN.unbalanced], abs(r) - explained)
            seen[SEEN.excused] = max(seen[SEEN.excused], abs(r) - ε)
        look_at_joints(row, t, q, qd, hinges, bounds, seen)
    return stop, WRONG.nothing


@recursion
def look_at_joints(row, t, q, qd, hinges, bounds, seen):
    """Check bending angles and joint limits, and add the angle travelled since the last row."""
    for k in bounds.bending:
        if abs(q[row, k]) > bounds.bend:
            seen[SEEN.bent] = 1.0
    for k in bounds.limited:
        if max(hinges[k].lower - q[row, k], q[row, k] - hinges[k].upper) > bounds.near:
            seen[SEEN.beyond] = 1.0
    if row > 0:
        for k in bounds.travelling:
            seen[SEEN.travelled] += (abs(qd[row, k]) + abs(qd[row - 1, k])) / 2.0 * (t[row] - t[row - 1])


@recursion
def extent(seen):
    """Diagonal of the box around the path of the tip so far [m]."""
    square = 0.0
    for i in range(3):
        square += (seen[SEEN.high + i] - seen[SEEN.low + i]) ** 2
    return math.sqrt(square)


@entry
def explained_by(allowance, δ, moved, r, X, T):
    """Part [J] of an imbalance r that a tolerance δ may cause, after the tip has moved by `moved` [m].

    X is the energy exchanged, T the kinetic energy.
    """
    if allowance.damped and r < 0.0:
        return math.inf
    energy = δ * (allowance.weight + allowance.momentum * math.sqrt(abs(T)))
    if allowance.share < math.inf and moved > 0.0:
        return min(energy, allowance.share * δ / moved * X)
    return energy


@recursion
def largest(a):
    """The largest |a_k|; 0 for an empty array."""
    size = 0.0
    for k in range(len(a)):
        size = max(size, abs(a[k]))
    return size


@recursion
def finite(a):
    """Whether no a_k is nan or infinite."""
    rest = 0.0
    for k in range(len(a)):
        rest += a[k] - a[k]
    return rest == 0.0
