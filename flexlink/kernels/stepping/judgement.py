"""One look at new samples of a run: their power balance, bends, limits, and how far the joints have turned.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω        r = E(t) − E(0) − W(t)

Up to each sample X is the largest T + |ΔV_g| + |ΔV_e| + |W|, the energy exchanged, and ε what rounding explains: the
largest of one step's, 4 eps (|T| + |V_g| + |V_e| + |W| + m g · size · max(1, |q|)), times all steps. A sample is
garbage where |r| > share · X + ε + what the tolerance explains.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.tools.compiler import entry, recursion
from flexlink.kernels.tools.numbered import numbered

EPS = 2.0**-52

SEEN = numbered(
    "start:3",  # T, V_g and V_e at the start [J]
    "exchanged rounded",  # X, and what one step may round, largest so far [J]
    "unbalanced excused",  # |r| less what is explained, and less what rounding explains, largest so far [J]
    "travelled",  # angle by all free joints, forth and back, by their rates [rad]
    "garbage imbalance available",  # the first row that is garbage, −1: none; its r and X [J]
    "last",  # r of the last row [J]
    "bent beyond",  # whether a hinge is bent too far, a joint past its limits
)
"""What is known of the samples so far."""

WRONG = numbered("nothing balance kinetic finite")
"""Of a sample: its energy does not balance, its kinetic energy is negative, a number is not finite."""


class Allowance(NamedTuple):
    """What a tolerance explains of an imbalance."""

    weight: float = 0.0  # at any sample [J]
    momentum: float = 0.0  # and, of its kinetic energy T, times √T [√J]
    share: float = math.inf  # of the energy exchanged, at most
    damped: bool = False  # losses are explained: an implicit method damps fast vibrations
    compared: bool = False  # no sample is garbage: a second run judges


class Bounds(NamedTuple):
    """What no sample may pass, and the joints that are looked at."""

    force: Any  # (3,) a constant one on the tip, whose work is not integrated [N]
    weight: float  # m g · size [J]
    share: float  # of the energy exchanged, from which an imbalance is garbage
    insisted: bool  # garbage is told, and the run goes on
    bend: float  # angle of a hinge [rad]
    near: float  # how far past a limit an angle still counts as at it [rad]
    bending: Any  # numbers of the joints that bend,
    limited: Any  # of those with limits,
    travelling: Any  # of the driven ones whose motion is not prescribed


@entry
def look_at(first, stop, samples, hinges, bounds, steps, allowance, seen):
    """Look at the samples `first` … `stop` − 1, up to one that is wrong; returns its row (`stop`: none is) and why.

    `samples`: t (rows,), q, q̇, τ (rows, n), tip (rows, 3), energies (3, rows), W (rows,) without a constant force's.
    `steps`: taken before row 0, and from row to row. `seen` (SEEN.size,) is carried on.
    """
    t, q, qd, tau, tip, energy, works = samples
    for row in range(first, stop):
        W = works[row]
        for i in range(3):
            W += (tip[row, i] - tip[0, i]) * bounds.force[i]
        T, V_g, V_e = energy[0, row], energy[1, row], energy[2, row]
        ΔV_g, ΔV_e = V_g - seen[SEEN.start + 1], V_e - seen[SEEN.start + 2]
        r = T - seen[SEEN.start] + ΔV_g + ΔV_e - W
        X = max(seen[SEEN.exchanged], T + abs(ΔV_g) + abs(ΔV_e) + abs(W))
        seen[SEEN.last] = r
        if not (math.isfinite(r) and math.isfinite(X) and finite(tau[row])):
            return row, WRONG.finite
        size = abs(T) + abs(V_g) + abs(V_e) + abs(W) + bounds.weight * max(1.0, largest(q[row]))
        seen[SEEN.exchanged], seen[SEEN.rounded] = X, max(seen[SEEN.rounded], 4.0 * EPS * size)
        ε = seen[SEEN.rounded] * (1.0 + steps[0] + row * steps[1])
        explained = ε + explained_by(allowance, r, X, T)
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
    """Whether a hinge is bent too far, or a joint past its limits, and how far joints turned since the last row."""
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
def explained_by(allowance, r, X, T):
    """What a tolerance explains [J] of an imbalance r where X is exchanged and the kinetic energy is T."""
    if allowance.damped and r < 0.0:
        return math.inf
    energy = allowance.weight + allowance.momentum * math.sqrt(abs(T))
    return min(energy, allowance.share * X) if allowance.share < math.inf else energy


@recursion
def largest(a):
    """The largest |a_k|; 0 of none."""
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
