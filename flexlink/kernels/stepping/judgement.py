"""Check of new samples of a run: energy balance, bending, joint limits, and how far the joints have turned.

The check of a sample uses only this sample and earlier ones, so the result does not depend on the time of the check.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω        r = E(t) − E(0) − W(t)

X, the energy exchanged, is the largest T + |ΔV_g| + |ΔV_e| + |W| up to the sample. ε is the limit of rounding errors:
the largest limit for one step, 4 eps (|T| + |V_g| + |V_e| + |W| + m g · size · max(1, |q|)), times the number of steps.
A sample is garbage if |r| > share · X + ε + the error that the tolerance explains.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.kernels.tools.compiler import entry, recursion
from flexlink.kernels.tools.finite import is_finite, largest
from flexlink.kernels.tools.numbered import numbered

EPS = 2.0**-52

SEEN = numbered(
    "start:3",  # T, V_g and V_e at the start [J]
    "low:3 high:3",  # corners of the box around the path of the tip [m]
    "exchanged rounded",  # X, and the largest rounding limit of one step so far [J]
    "unbalanced excused",  # largest so far: |r| minus the explained imbalance, and |r| minus ε [J]
    "travelled",  # path of all driven joints in both directions, from their rates [rad]
    "garbage imbalance available",  # first garbage row, −1: none; its r and X [J]
    "last",  # r of the last row [J]
    "bent beyond",  # 1 if a hinge has bent too far; 1 if a joint has passed its limits
)
"""Results of the check of all samples so far."""

WRONG = numbered("nothing balance kinetic finite")
"""Faults of a sample: the energy does not balance, the kinetic energy is negative, a number is not finite."""


class Allowance(NamedTuple):
    """Imbalance explained by a tolerance δ: δ (weight + momentum √T), with T the kinetic energy."""

    least: float = 0.0  # smallest δ [m]
    part: float = 0.0  # δ as a fraction of the largest deflection so far, if larger
    weight: float = 0.0  # factor of δ at any sample [N]
    momentum: float = 0.0  # factor of δ √T [√J/m]
    share: float = math.inf  # limit: share · X · δ / extent of the motion so far
    damped: bool = False  # every loss is explained: an implicit method damps fast vibrations
    compared: bool = False  # no sample counts as garbage: comparison with a second run decides


class Bounds(NamedTuple):
    """Limits for the samples, and the joints that are checked."""

    force: Any  # (3,) constant force on the tip, whose work is not integrated [N]
    weight: float  # m g · size [J]
    share: float  # fraction of the energy exchanged; a larger imbalance is garbage
    insisted: bool  # garbage is reported, and the run continues
    bend: float  # largest angle of a hinge [rad]
    near: float  # margin past a joint limit within which an angle counts as at the limit [rad]
    bending: Any  # indices of the joints that bend
    limited: Any  # indices of the joints with limits
    travelling: Any  # indices of the driven joints whose motion is not prescribed


@entry
def look_at(first, stop, samples, hinges, bounds, allowance, seen):
    """Check samples `first` … `stop` − 1 up to the first wrong one; returns its row (or `stop`) and its `WRONG`.

    `samples`: t (rows,), q, q̇, τ (rows, n), tip (rows, 3), energies (3, rows), W (rows,) without the constant force,
    and the record of the steps so far (rows, SO_FAR.size). `seen` (SEEN.size,) is updated.
    """
    t, q, qd, tau, tip, energy, works, so_far = samples
    for row in range(first, stop):
        W, square = works[row], 0.0
        for i in range(3):
            W += (tip[row, i] - tip[0, i]) * bounds.force[i]
            seen[SEEN.low + i] = min(seen[SEEN.low + i], tip[row, i])
            seen[SEEN.high + i] = max(seen[SEEN.high + i], tip[row, i])
            square += (seen[SEEN.high + i] - seen[SEEN.low + i]) ** 2  # diagonal of the box around the path of the tip
        T, V_g, V_e = energy[0, row], energy[1, row], energy[2, row]
        ΔV_g, ΔV_e = V_g - seen[SEEN.start + 1], V_e - seen[SEEN.start + 2]
        r = T - seen[SEEN.start] + ΔV_g + ΔV_e - W
        X = max(seen[SEEN.exchanged], T + abs(ΔV_g) + abs(ΔV_e) + abs(W))
        seen[SEEN.last] = r
        if not (math.isfinite(r) and math.isfinite(X) and is_finite(tau[row])):
            return row, WRONG.finite
        size = abs(T) + abs(V_g) + abs(V_e) + abs(W) + bounds.weight * max(1.0, largest(q[row]))
        seen[SEEN.exchanged], seen[SEEN.rounded] = X, max(seen[SEEN.rounded], 4.0 * EPS * size)
        ε = seen[SEEN.rounded] * (1.0 + so_far[row, SO_FAR.steps])
        δ = max(allowance.least, allowance.part * so_far[row, SO_FAR.deflection])
        explained = ε + explained_by(allowance, δ, math.sqrt(square), r, X, T)
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
    """Record in `seen` a hinge bent too far, a joint past its limits, and the path of joints since the last row."""
    for k in bounds.bending:
        if abs(q[row, k]) > bounds.bend:
            seen[SEEN.bent] = 1.0
    for k in bounds.limited:
        if max(hinges[k].lower - q[row, k], q[row, k] - hinges[k].upper) > bounds.near:
            seen[SEEN.beyond] = 1.0
    if row > 0:
        for k in bounds.travelling:
            seen[SEEN.travelled] += (abs(qd[row, k]) + abs(qd[row - 1, k])) / 2.0 * (t[row] - t[row - 1])


@entry
def explained_by(allowance, δ, moved, r, X, T):
    """Imbalance [J] that a tolerance δ [m] explains; inf for a loss, r < 0, by a method that damps.

    `moved` is the extent of the tip's path so far [m], r the imbalance, X the energy exchanged, T the kinetic energy.
    """
    if allowance.damped and r < 0.0:
        return math.inf
    energy = δ * (allowance.weight + allowance.momentum * math.sqrt(abs(T)))
    if allowance.share < math.inf and moved > 0.0:
        return min(energy, allowance.share * δ / moved * X)
    return energy
