"""q and q̇ at a part x of the step that was just taken: the polynomial of the stages, or of both ends.

A step of an explicit method ends at its samples. Where else it has to be looked at, q is the quintic polynomial with q,
q̇ and q̈ of both ends, and q̇ its slope.
"""

import math

from flexlink.kernels.stepping.embedded import EmbeddedWork
from flexlink.kernels.stepping.implicit import between_stages
from flexlink.kernels.stepping.implicit_layout import ImplicitWork
from flexlink.kernels.tools.compiler import by_type, recursion


@recursion
def between_ends(x, h, state, angles, rates, work):
    """Write q and q̇ at a part x of the step, by both of its ends; W is not known there: nan."""
    q, qd, qdd, new = state[0], state[1], state[2], work.new
    for k in range(len(q)):
        v, a = h * qd[k], h * h * qdd[k]
        off = new[0, k] - (q[k] + v + 0.5 * a)  # what the end has more than q + v x + a x² / 2
        off_v, off_a = h * new[1, k] - (v + a), h * h * new[2, k] - a
        c3 = 10.0 * off - 4.0 * off_v + 0.5 * off_a
        c4 = -15.0 * off + 7.0 * off_v - off_a
        c5 = 6.0 * off - 3.0 * off_v + 0.5 * off_a
        angles[k] = q[k] + x * (v + x * (0.5 * a + x * (c3 + x * (c4 + x * c5))))
        rates[k] = (v + x * (a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h
    return math.nan


@by_type({ImplicitWork: between_stages, EmbeddedWork: between_ends})
def between(x, h, state, angles, rates, work):
    """Write q and q̇ at a part x of the step that was just taken from `state`; returns W there."""
