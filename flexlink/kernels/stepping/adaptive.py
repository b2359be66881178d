"""Steps whose length follows from their error, and samples at any time between them; whole loop compiled.

    h ← 0.9 h (tolerance / error)^(1/p)        p: order of the error in h

and no more than what the last two errors predict (Gustafsson; Hairer & Wanner, Solving Ordinary Differential Equations
II, IV.8). A step ends where an input has a knot, of which no polynomial knows, and is not soon longer than one that
failed. Samples between the ends of an implicit step are its dense output; steps of an explicit method end at samples.

With a tolerance of infinity all steps are as long as the largest, and nothing but the state is remembered past a knot:
who starts from the state there goes on with the same numbers.
"""

import math

import numpy as np
from numba.extending import overload

from flexlink.kernels.forward.mass_plus_diagonal import displacement, place_bodies
from flexlink.kernels.forward.solvers import forward_under
from flexlink.kernels.inputs.drive_torque import drive_torque, follow, sample_law
from flexlink.kernels.stepping.embedded import EmbeddedWork, embedded_step
from flexlink.kernels.stepping.error_norm import bending
from flexlink.kernels.stepping.implicit import ImplicitWork, between_stages, implicit_step
from flexlink.kernels.stepping.step_state import (
    ACCEPTED,
    CEILING,
    CONTRACTION,
    DEFLECTION,
    ERROR,
    FAILED,
    ITERATIONS,
    KNOT,
    LAST,
    NOT_SOLVED,
    PATIENCE,
    POWER,
    REFUSED,
    REJECTED,
    ROUNDING,
    ROW,
    SLOWEST,
    STEP,
    TAKEN,
    TIME,
    TOO_FAR_OFF,
    TURNED,
    WORK,
)
from flexlink.kernels.tools.compiler import RECURSION, entry, inlined, kernel, recursion

GOES_ON, ENDED, STUCK = range(3)  # how `advance` returns
SAFETY, SHRINK, GROW = 0.9, 1 / 8, 5.0
LEAST = 1e-3  # part of the error of a long step that any step may have: the shortest are few, after a jump
NEARLY = 1.01  # steps up to the next knot that are taken in one
AT_THE_END = 1e-9  # part of a step that is no time between its ends

ALGORITHMS = {ImplicitWork: implicit_step, EmbeddedWork: embedded_step}  # by the scratch they work on


def take_step(t, h, inputs, state, allowed, work):
    """One step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new`; returns its error [m] and iterations."""
    return ALGORITHMS[type(work)](t, h, inputs, state, allowed, work)


@overload(take_step, jit_options=RECURSION)
def _take_step(t, h, inputs, state, allowed, work):
    return ALGORITHMS[work.instance_class].py_func  # one function less than one that calls it: a step is long


def between(x, h, state, work, angles, rates):
    """Write q and q̇ at a part x of an implicit step; returns W there."""
    return between_stages(x, h, state, work, angles, rates)


@overload(between, jit_options=RECURSION)
def _between(x, h, state, work, angles, rates):
    if work.instance_class is ImplicitWork:
        return between_stages.py_func
    return lambda x, h, state, work, angles, rates: math.nan  # no sample of an explicit step is between its ends


@kernel
def advance(work, forward, inputs, settings, count, state, knots, samples, most):
    """Take up to `most` steps from `state` q, q̇, q̈ (n,) and W (2,), in place, and fill in the samples on the way.

    `work` is scratch of the method, `forward` of forward dynamics.

    `settings`: error that a long step may have [m], and that as a part of the largest deflection; the length from which
    a step is long [s], a shorter one may have its part of that length of it, so that the errors of many steps add up to
    the same; what the iteration may leave [m], and that as a part of the error; p; smallest and
    largest step [s]. `knots`: times where a step ends, of which the last is the end. `samples`: times (rows,), q and q̇
    (rows, n), W (rows,).
    """
    absolute, part, long, exact, left, p, smallest, largest = settings
    tau, clock = np.zeros(len(state[0])), work.clock
    for _ in range(most):
        t, end = clock[TIME], knots[count[KNOT]]
        ends = t + NEARLY * clock[STEP] >= end
        h = end - t if ends else clock[STEP]
        tolerance = (absolute + part * clock[DEFLECTION]) * min(1.0, max(LEAST, h / long))
        accurate = min(exact, max(left * tolerance, clock[ROUNDING]))
        error, iterations = take_step(t, h, inputs, state, (tolerance, accurate), work)
        count[ITERATIONS] += iterations
        if not error < tolerance:
            refuse(h, error / tolerance, p, clock, count)
            if clock[STEP] <= smallest:
                return STUCK
            if count[FAILED] == count[PATIENCE]:
                return GOES_ON
            continue
        sample(t, h, inputs, state, work, count, samples, tau)
        wanted = following(h, error / tolerance, p, iterations, clock)
        clock[STEP] = min(largest, max(wanted, clock[STEP]) if h < clock[STEP] else wanted)
        clock[TIME] = end if ends else t + h
        count[TAKEN] += 1
        take_on(state, work)
        clock[DEFLECTION] = max(clock[DEFLECTION], deflection(state[0], tau, work))
        if ends:
            count[KNOT] += 1
            if absolute == math.inf:
                forget(clock)
            if count[KNOT] == len(knots):
                sample_law(inputs.drive, end, end, state[0], state[1], tau)
                return ENDED
            begin(end, inputs, state, tau, forward)
    return GOES_ON


@kernel
def first_step(work, state, settings, duration):
    """Set the deflection, and the first step to one in which q̈ moves no body by more than the error of a step."""
    absolute, part, largest = settings[0], settings[1], settings[7]
    q, qd, qdd = state[0], state[1], state[2]
    bent, clock, τ = np.zeros(len(q)), work.clock, min(work.clock[SLOWEST], duration)
    place_bodies(q, work.posture)
    clock[DEFLECTION] = deflection(q, bent, work)
    for k in range(len(q)):  # of an arm with slack springs: what q̇ and q̈ bend in 1 / ω₁
        bent[k] = qd[k] + τ * qdd[k]
    clock[DEFLECTION] = max(clock[DEFLECTION], bending(τ, bent, work))
    moves = displacement(qdd, work.posture)
    clock[STEP] = min(largest, 0.01 * duration)
    if moves > 0.0:
        clock[STEP] = min(clock[STEP], math.sqrt((absolute + part * clock[DEFLECTION]) / moves))


@recursion
def deflection(q, bent, work):
    """Largest displacement [m] of a body by all springs' angles; scratch `bent` (n,)."""
    for k in range(len(q)):
        hinge = work.chain.hinges[k]
        bent[k] = q[k] - hinge.rest if hinge.stiffness > 0.0 else 0.0
    return displacement(bent, work.posture)


@entry
def begin(t, inputs, state, tau, forward):
    """q̈ and the power of a state at time t, where an input may have a knot."""
    q, qd, qdd, done = state
    for k in range(len(tau)):
        tau[k] = 0.0
    follow(inputs.motion, t, q, qd, qdd)
    sample_law(inputs.drive, t, t, q, qd, tau)
    drive_torque(inputs.drive, t, t, q, qd, tau)
    done[1] = forward_under(inputs, t, t, q, qd, tau, qdd, forward)


@inlined
def take_on(state, work):
    """The end of the step is the new state."""
    q, qd, qdd, done = state
    for k in range(len(q)):
        if work.chain.hinges[k].stiffness == 0.0 and not work.chain.hinges[k].prescribed:
            work.clock[TURNED] += abs(work.new[0, k] - q[k])
        q[k], qd[k], qdd[k] = work.new[0, k], work.new[1, k], work.new[2, k]
    done[0], done[1] = work.clock[WORK], work.clock[POWER]
    work.clock[ACCEPTED] = 1.0


@entry
def forget(clock):
    """The next step is as one that follows none."""
    clock[LAST] = clock[ERROR] = clock[ACCEPTED] = clock[CONTRACTION] = clock[CEILING] = clock[REFUSED] = 0.0


@recursion
def refuse(h, error, p, clock, count):
    """A shorter step, after one with an error, as a part of the tolerance, of 1 or more; nan: no step was found."""
    if math.isnan(error):
        if clock[REFUSED] > 0.0:
            clock[LAST] = 0.0
        count[FAILED] += 1
        clock[STEP], clock[CEILING], clock[REFUSED] = 0.4 * h, 0.7 * h, NOT_SOLVED
    else:
        count[REJECTED] += 1
        clock[STEP], clock[REFUSED] = h * max(SHRINK, SAFETY * error ** (-1.0 / p)), TOO_FAR_OFF


@recursion
def following(h, error, p, iterations, clock):
    """Length of the step after one of length h with an error, as a part of the tolerance, below 1."""
    safety = SAFETY * 21.0 / (20.0 + iterations)
    error = max(error, 1e-10)
    factor = safety * error ** (-1.0 / p)
    if clock[LAST] > 0.0 and clock[ERROR] > 0.0:
        factor = min(factor, safety * h / clock[LAST] * (clock[ERROR] / (error * error)) ** (1.0 / p))
    wanted = h * min(GROW, max(SHRINK, factor))
    if clock[REFUSED] > 0.0:
        wanted = min(wanted, h)
    if clock[CEILING] > 0.0:
        wanted = min(wanted, clock[CEILING])
        clock[CEILING] *= 1.5
    clock[LAST], clock[ERROR], clock[REFUSED] = h, max(error, 0.01), 0.0
    return wanted


@recursion
def sample(t, h, inputs, state, work, count, samples, spare):
    """Fill in the samples up to the end of the step, t + h."""
    times, qs, qds, works = samples
    while count[ROW] < len(times) and times[count[ROW]] <= t + (1.0 + AT_THE_END) * h:
        row = count[ROW]
        works[row] = place(min(1.0, (times[row] - t) / h), h, state, work, qs[row], qds[row])
        follow(inputs.motion, times[row], qs[row], qds[row], spare)
        count[ROW] += 1


@recursion
def place(x, h, state, work, angles, rates):
    """Write q and q̇ at a part x of the step that was just taken from `state`; returns W there."""
    if x < 1.0 - AT_THE_END:
        return between(x, h, state, work, angles, rates)
    for k in range(len(angles)):
        angles[k], rates[k] = work.new[0, k], work.new[1, k]
    return work.clock[WORK]
