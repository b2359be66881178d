"""Find q and q̇ at a fraction x of the step just taken, by the polynomial through the stages or through both ends.

Samples inside a step are computed by its dense output (`implicit`, `embedded`), for which an explicit method evaluates
a few additional stages. The search for the time at which a motor saturates needs many points of a step. In this search,
an explicit method uses the quintic polynomial that matches q, q̇, q̈ at both ends, and its derivative for q̇.
"""

import math

from flexlink.kernels.forward.mass_plus import displacement
from flexlink.kernels.stepping.embedded import EmbeddedWork, more_stages
from flexlink.kernels.stepping.implicit_layout import STAGE, ImplicitWork
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.ties import project
from flexlink.kernels.tools.compiler import by_type, inlined, recursion, subroutine


@recursion
def of_implicit(x, h, state, angles, rates, work):
    """Write q and q̇ at the fraction x of the step just taken from `state`; returns W there."""
    q, qd, done = state[0], state[1], state[3]
    dense, qdd, W = work.method.dense, work.stages[STAGE.qdd], done[0]
    s, n = qdd.shape
    for k in range(n):
        angles[k], rates[k] = q[k] + x * h * qd[k], qd[k]
    for i in range(s):
        β = α = 0.0
        for m in range(s - 1, -1, -1):
            β = β * x + dense[0, i, m]
            α = α * x + dense[1, i, m]
        weight2, weight = h * h * x * x * α, h * x * β
        W += weight * work.power[i]
        for k in range(n):
            angles[k] += weight2 * qdd[i, k]
            rates[k] += weight * qdd[i, k]
    return W


@recursion
def of_explicit(x, h, state, angles, rates, work):
    """Write q and q̇ at the fraction x by the polynomials of `prepare_explicit`, if any; returns W there."""
    q, qd, done = state[0], state[1], state[3]
    once, twice, W = work.inside[0], work.inside[1], 0.0
    for k in range(len(q)):
        angles[k] = rates[k] = 0.0
    for m in range(len(once) - 1, -1, -1):
        W = W * x + work.power_inside[m]
        for k in range(len(q)):
            angles[k] = angles[k] * x + twice[m, k]
            rates[k] = rates[k] * x + once[m, k]
    for k in range(len(q)):
        angles[k] = q[k] + x * (h * qd[k] + x * angles[k])
        rates[k] = qd[k] + x * rates[k]
    return done[0] + x * W


@recursion
def between_ends(x, h, state, angles, rates, work):
    """Write q and q̇ at the fraction x by the quintic through both ends; returns nan, as W is unknown there."""
    q, qd, qdd, new = state[0], state[1], state[2], work.new
    for k in range(len(q)):
        v, a = h * qd[k], h * h * qdd[k]
        off = new[0, k] - (q[k] + v + 0.5 * a)  # end of the step minus q + v x + a x² / 2 at x = 1
        off_v, off_a = h * new[1, k] - (v + a), h * h * new[2, k] - a
        c3 = 10.0 * off - 4.0 * off_v + 0.5 * off_a
        c4 = -15.0 * off + 7.0 * off_v - off_a
        c5 = 6.0 * off - 3.0 * off_v + 0.5 * off_a
        angles[k] = q[k] + x * (v + x * (0.5 * a + x * (c3 + x * (c4 + x * c5))))
        rates[k] = (v + x * (a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h
    return math.nan


@by_type({ImplicitWork: of_implicit, EmbeddedWork: between_ends})
def between(x, h, state, angles, rates, work):
    """Write q and q̇ at the fraction x of the step, without new evaluations; returns W there, nan if unknown."""


@inlined
def is_prepared(t, h, inputs, state, work):
    """Returns 0 and 0: an implicit step needs no preparation, and its error estimate also covers times inside it."""
    return 0.0, 0


@subroutine
def prepare_explicit(t, h, inputs, state, work):
    """Find the polynomials of the dense output; returns their error [m] and the number of additional evaluations.

    The error is a difference at x = ½: angles from the stages' q̈ minus angles from the stages' rates, which are one
    order less accurate.
    """
    off, evaluations, x = 0.0, 0, 0.5
    if work.method.dense is not None:
        evaluations = more_stages(t, h, inputs, state, work)
        add_up_stages(h, work)
        of_explicit(x, h, state, work.Q, work.e[1], work)
        e = work.e[0]
        for k in range(len(e)):
            e[k] = state[0][k] - work.Q[k]
        for i in range(len(work.L)):
            β = 0.0
            for m in range(work.method.dense.shape[2] - 1, -1, -1):
                β = (β + work.method.dense[0, i, m]) * x
            for k in range(len(e)):
                e[k] += h * β * work.L[i, k]
        for k in range(len(e)):
            if work.chain.hinges[k].prescribed:
                e[k] = 0.0
        off = displacement(e, work.posture)
    return off, evaluations


@inlined
def add_up_stages(h, work):
    """Write coefficients of the powers of x: h Σ β_i K_i / x for q̇, h² Σ α_i K_i / x² for q, h Σ β_i P_i / x for W."""
    dense, once, twice = work.method.dense, work.inside[0], work.inside[1]
    for m in range(len(once)):
        work.power_inside[m] = 0.0
        for k in range(once.shape[1]):
            once[m, k] = twice[m, k] = 0.0
        for i in range(len(work.K)):
            β, α = h * dense[0, i, m], h * h * dense[1, i, m]
            if β != 0.0 or α != 0.0:
                work.power_inside[m] += β * work.power[i]
                for k in range(once.shape[1]):
                    once[m, k] += β * work.K[i, k]
                    twice[m, k] += α * work.K[i, k]


@by_type({ImplicitWork: is_prepared, EmbeddedWork: prepare_explicit})
def prepare_inside(t, h, inputs, state, work):
    """Prepare `inside`; returns its error as a body's displacement [m], and the number of additional evaluations."""


@by_type({ImplicitWork: of_implicit, EmbeddedWork: of_explicit})
def by_polynomials(x, h, state, angles, rates, work):
    """Write q and q̇ at the fraction x of the step, after `prepare_inside`; returns W there."""


@inlined
def inside(x, h, state, angles, rates, work):
    """Write q and q̇ of a sample at the fraction x of the step, on the rows of ties; returns W there."""
    W = by_polynomials(x, h, state, angles, rates, work)
    if work.ties is not None:
        project(work.stepper[STEPPER.time] + x * h, angles, rates, work)
        W -= work.ties.stored[1] - work.ties.stored[0]
    return W
