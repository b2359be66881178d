"""One look at new samples of a run: their power balance, bends, limits, and how far the joints have turned.

A sample is judged by what was before it, so that it does not matter when somebody looks.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω        r = E(t) − E(0) − W(t)

Up to each sample X is the largest T + |ΔV_g| + |ΔV_e| + |W|, the energy exchanged, and ε what rounding explains: the
largest of one step's, 4 eps (|T| + |V_g| + |V_e| + |W| + m g · size · max(1, |q|)), times all steps. A sample is
garbage where |r| > share · X + ε + what the tolerance explains.
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
    """What a tolerance δ explains of an imbalance: δ (weight + momentum √T), T the kinetic energy."""

    least: float = 0.0  # δ [m], or more:
    part: float = 0.0  # of the largest deflection so far
    weight: float = 0.0  # at any sample [N]
    momentum: float = 0.0  # of one that moves [√J/m]
    share: float = math.inf  # times δ over the extent of the motion so far: of the energy exchanged, at most
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
def look_at(first, stop, samples, hinges, bounds, allowance, seen):
    """Look at the samples `first` … `stop` − 1, up to one that is wrong; returns its row (`stop`: none is) and why.

    `samples`: t (rows,), q, q̇, τ (rows, n), tip (rows, 3), energies (3, rows), W (rows,) without a constant force's,
    and what is noted of the steps so far (rows, SO_FAR.size). `seen` (SEEN.size,) is carried on.
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


@recursion
def extent(seen):
    """Diagonal of the box around the path of the tip so far [m]."""
    square = 0.0
    for i in range(3):
        square += (seen[SEEN.high + i] - seen[SEEN.low + i]) ** 2
    return math.sqrt(square)


@entry
def explained_by(allowance, δ, moved, r, X, T):
    """What a tolerance δ explains [J] of an imbalance r where the tip has moved so far [m], X is exchanged, T is there.

    T is the kinetic energy.
    """
    if allowance.damped and r < 0.0:
        return math.inf
    energy = δ * (allowance.weight + allowance.momentum * math.sqrt(abs(T)))
    if allowance.share < math.inf and moved > 0.0:
        return min(energy, allowance.share * δ / moved * X)
    return energy


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
