"""Step-size control by the error estimate, with samples at any time between the steps; the whole loop is compiled.

    h ← 0.9 h (tolerance / error)^(1/p)        p: order of the error in h

limited by the predictive controller, which uses the last two errors (Gustafsson; Hairer & Wanner, Solving Ordinary
Differential Equations II, IV.8). A step ends at every knot of an input, because an input is not smooth there, and where
a motor saturates (`saturation`). After a rejected step the step length grows only slowly. Samples inside a step use its
dense output. An explicit method ends a step at a sample where that is cheaper, or if it has no dense output.

With an infinite tolerance all steps have the largest length, and only the state is carried across a knot, so a run
that starts from the state at a knot computes the same numbers.
"""

import math

from flexlink.kernels.forward.mass_plus import displacement, place_bodies
from flexlink.kernels.forward.solvers import forward_under
from flexlink.kernels.inputs.drive_torque import follow, sample_at_step, stage_torque
from flexlink.kernels.stepping.by_stage import count_step, tried_again
from flexlink.kernels.stepping.dense_output import inside, prepare_inside
from flexlink.kernels.stepping.embedded import EmbeddedWork, embedded_step
from flexlink.kernels.stepping.error_norm import deflection_norm
from flexlink.kernels.stepping.implicit import implicit_step
from flexlink.kernels.stepping.implicit_layout import ImplicitWork
from flexlink.kernels.stepping.runge_kutta import base_angle
from flexlink.kernels.stepping.saturation import NEVER, choose_branches, ends_at_switch, first_switch, ranges, saturates
from flexlink.kernels.stepping.step_state import COUNT, REFUSAL, SO_FAR, STEPPER
from flexlink.kernels.stepping.ties import accelerate, choose_laws
from flexlink.kernels.tools.compiler import by_type, entry, inlined, recursion, shared
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep

OUTCOME = numbered("goes_on ended stuck turned")  # results of `advance`; turned: a free base has turned far
SAFETY, SHRINK = 0.9, 1 / 8  # safety factor of the step length; smallest factor by which h changes
NEARLY = 1.01  # a knot at most this many h away is reached in one step
AT_THE_END = 1e-9  # fraction of a step within which a time counts as the end of the step
OF_A_SWITCH = 0.1  # displacement allowed if saturation changes within a step, as a fraction of a long step's tolerance


@by_type({ImplicitWork: implicit_step, EmbeddedWork: embedded_step})
def take_step(t, h, inputs, state, allowed, work):
    """Step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new`; returns its error [m] and number of iterations."""


@shared
@entry
def begin_tied(state, work):
    """Change q̈ (n,) at a start such that it satisfies the ties, and the power."""
    t, (q, qd, qdd, done) = work.stepper[STEPPER.time], state
    choose_laws(t, q, qd, work)
    done[1] += accelerate(t, q, qd, qdd, work)


@shared
@entry
def advance(work, forward, inputs, settings, count, state, tau, knots, samples, most):
    """Take up to `most` steps from `state` q, q̇, q̈ (n,) and W (2,), in place, and fill in the samples on the way.

    Scratch arrays are `work` of the method, `forward` of forward dynamics and `tau` (n,).

    `settings`: absolute tolerance of a long step [m]; its relative tolerance, as a fraction of the largest deflection;
    the length from which a step counts as long [s]; the largest error of the iteration [m], and the same as a fraction
    of the tolerance; p; the duration of the run [s]; smallest and largest step [s]. The tolerance of a shorter step is
    proportional to its length, so short steps have the same total error. `knots`: times where a step ends,
    the last being the end of the run, and for each the length above which a step may pass it [s], inf if none may.
    `samples`: times (rows,), q and q̇ (rows, n), W (rows,), and the record of the steps so far (rows, SO_FAR.size).
    """
    absolute, part, long, exact, left, p, duration, smallest, largest = settings
    # least: smallest fraction of a long step's tolerance: only a few steps, after a jump, are so short
    stepper, least, limited = work.stepper, 1e-3, absolute < math.inf and saturates(inputs.drive)
    switches = limited or ranges(work)
    for _ in range(most):
        t = stepper[STEPPER.time]
        knot = next_knot(t, stepper[STEPPER.step], knots, count)
        switch = t < stepper[STEPPER.switch] < knots[0][knot]  # the step ends at the switch, as at a knot
        end = stepper[STEPPER.switch] if switch else knots[0][knot]
        ends = t + NEARLY * stepper[STEPPER.step] >= end
        h = end - t if ends else stepper[STEPPER.step]
        long_error = absolute + part * stepper[STEPPER.deflection]
        tolerance = long_error * min(1.0, max(least, h / long))
        accurate = min(exact, max(left * tolerance, stepper[STEPPER.rounding]))
        error, iterations = take_step(t, h, inputs, state, (tolerance, accurate), work)
        count[COUNT.iterations] += iterations
        if not error < tolerance:
            refuse(h, error / tolerance, p, stepper, count)
            if stepper[STEPPER.step] <= smallest:
                return OUTCOME.stuck
            continue
        left_branch = first_switch(t, h, inputs.drive, state, work) if switches else NEVER
        if left_branch < 1.0 and ends_at_switch(  # also a fixed step, if it has ties
            left_branch, t, h, min(smallest, 1e-6 * largest), duration,
            OF_A_SWITCH * long_error if absolute < math.inf else accurate, inputs.drive, state, work,
        ):  # fmt: skip
            count[COUNT.rejected] += 1
            continue
        off = off_inside(t, h, long_error, inputs, state, knots, count, samples, work)
        if not off < 1.0:
            refuse(h, off, p, stepper, count)
            continue
        sample(t, h, inputs, state, work, count, samples, tau)
        wanted = following(h, max(error / tolerance, off), p, iterations, stepper)
        if h < stepper[STEPPER.step]:
            wanted = max(wanted, stepper[STEPPER.step])
        stepper[STEPPER.step] = min(largest, wanted)
        stepper[STEPPER.time] = end if ends else t + h
        count[COUNT.steps] += 1
        accept(h, state, work)
        if limited:
            choose_branches(stepper[STEPPER.time], inputs.drive, state[0], state[1], work.springs, work.saturation)
        if left_branch < NEVER:
            begin_anew(stepper[STEPPER.time], inputs, state, tau, forward, work)
        ends = ends and not switch
        bend = spring_displacement(state[0], tau, work.posture, work.chain)
        stepper[STEPPER.deflection] = max(stepper[STEPPER.deflection], bend)
        if not ends:
            pass_knots(t + (1.0 + AT_THE_END) * h, knots, count)
        else:
            count[COUNT.knot] = knot + 1
            if absolute == math.inf:
                forget(stepper)
            if count[COUNT.knot] == len(knots[0]):
                sample_at_step(inputs.drive, end, end, state[0], state[1], tau)
                return OUTCOME.ended
            begin_anew(end, inputs, state, tau, forward, work)
        if stepper[STEPPER.far] > 0.0 and base_angle(state[0]) > stepper[STEPPER.far]:
            return OUTCOME.turned
    return OUTCOME.goes_on


@inlined
def next_knot(t, h, knots, count):
    """Index of the next knot that a step of length h may not pass, or does not reach."""
    times, passed_by = knots
    k = count[COUNT.knot]
    while passed_by[k] < h and times[k] < t + NEARLY * h:
        k += 1
    return k


@inlined
def pass_knots(t, knots, count):
    """Advance the index of the next knot past the knots up to time t; stop at a knot that no step may pass."""
    times, passed_by = knots
    while times[count[COUNT.knot]] <= t and passed_by[count[COUNT.knot]] < math.inf:
        count[COUNT.knot] += 1


@entry
def first_step(stepper, posture, springs, chain, state, settings, duration, bent):
    """Set the deflection, and a first step in which q̈ moves no body by more than the tolerance; `bent` is scratch."""
    absolute, part, largest = settings[0], settings[1], settings[8]
    q, qd, qdd = state[0], state[1], state[2]
    τ = min(stepper[STEPPER.inverse_ω1], duration)
    place_bodies(q, posture)
    stepper[STEPPER.deflection] = spring_displacement(q, bent, posture, chain)
    for k in range(len(q)):  # for an arm with relaxed springs: deflection due to q̇ and q̈ in the time 1 / ω₁
        bent[k] = qd[k] + τ * qdd[k]
    stepper[STEPPER.deflection] = max(stepper[STEPPER.deflection], deflection_norm(τ, bent, springs, posture, chain))
    moves = displacement(qdd, posture)
    stepper[STEPPER.step] = min(largest, 0.01 * duration)
    if moves > 0.0:
        tolerance = absolute + part * stepper[STEPPER.deflection]
        stepper[STEPPER.step] = min(stepper[STEPPER.step], math.sqrt(tolerance / moves))


@recursion
def spring_displacement(q, bent, posture, chain):
    """Largest displacement [m] of a body due to the deflections of all springs; `bent` (n,) is scratch."""
    for k in range(len(q)):
        hinge = chain.hinges[k]
        bent[k] = q[k] - hinge.rest if hinge.stiffness > 0.0 else 0.0
    return displacement(bent, posture)


@shared
@entry
def begin(t, inputs, state, tau, forward):
    """Write q̈ and the power of a state at time t, where the run starts or an input has a knot."""
    q, qd, qdd, done = state
    tau[:] = 0.0
    follow(inputs.motion, t, q, qd, qdd)
    sample_at_step(inputs.drive, t, t, q, qd, tau)
    stage_torque(inputs.drive, t, t, q, qd, tau)
    done[1] = forward_under(inputs, t, t, q, qd, tau, qdd, forward)


@inlined
def accept(h, state, work):
    """Make the end of the step h the new state, and add up the errors that last or that a sampled law reads."""
    q, qd, qdd, done = state
    work.stepper[STEPPER.drifted] += h * work.stepper[STEPPER.drifting]
    work.stepper[STEPPER.drifting] += work.stepper[STEPPER.drift]
    work.stepper[STEPPER.kicked] += work.stepper[STEPPER.kick]
    for k in range(len(q)):
        if work.chain.hinges[k].stiffness == 0.0 and not work.chain.hinges[k].prescribed:
            work.stepper[STEPPER.angle_travelled] += abs(work.new[0, k] - q[k])
        q[k], qd[k], qdd[k] = work.new[0, k], work.new[1, k], work.new[2, k]
    done[0], done[1] = work.stepper[STEPPER.work], work.stepper[STEPPER.power]
    work.stepper[STEPPER.accepted] = 1.0


@entry
def forget(stepper):
    """Clear the memory of the last step, so the next step is treated like the first step of a run."""
    stepper[STEPPER.last_step] = stepper[STEPPER.last_error] = stepper[STEPPER.accepted] = 0.0
    stepper[STEPPER.contraction] = stepper[STEPPER.max_step] = stepper[STEPPER.refusal] = 0.0


@recursion
def refuse(h, error, p, stepper, count):
    """Shorten the step after a rejection; `error` is relative to the tolerance, ≥ 1, or nan if the iteration failed."""
    if math.isnan(error):
        if stepper[STEPPER.refusal] > 0.0:
            stepper[STEPPER.last_step] = 0.0
        count[COUNT.failed] += 1
        if tried_again(stepper):
            return
        stepper[STEPPER.step], stepper[STEPPER.max_step], stepper[STEPPER.refusal] = 0.4 * h, 0.7 * h, REFUSAL.iteration
    else:
        count[COUNT.rejected] += 1
        stepper[STEPPER.step], stepper[STEPPER.refusal] = h * max(SHRINK, SAFETY * error ** (-1.0 / p)), REFUSAL.error


@recursion
def following(h, error, p, iterations, stepper):
    """Length of the step after an accepted step of length h; its `error`, relative to the tolerance, is below 1."""
    safety = SAFETY * 21.0 / (20.0 + iterations)
    error = max(error, 1e-10)
    factor = safety * error ** (-1.0 / p)
    last, last_error = stepper[STEPPER.last_step], stepper[STEPPER.last_error]
    if last > 0.0 and last_error > 0.0:
        factor = min(factor, safety * h / last * (last_error / (error * error)) ** (1.0 / p))
    wanted = h * min(5.0, max(SHRINK, factor))
    if stepper[STEPPER.contraction] > 0.0:  # the contraction factor grows as h²
        wanted = min(wanted, h * max(1.2, math.sqrt(0.5 / stepper[STEPPER.contraction])))
    count_step(iterations, stepper)
    if stepper[STEPPER.refusal] > 0.0:
        wanted = min(wanted, h)
    if stepper[STEPPER.max_step] > 0.0:
        wanted = min(wanted, stepper[STEPPER.max_step])
        stepper[STEPPER.max_step] *= 1.5
    stepper[STEPPER.last_step], stepper[STEPPER.last_error], stepper[STEPPER.refusal] = h, max(error, 0.01), 0.0
    return wanted


@inlined
def off_inside(t, h, long_error, inputs, state, knots, count, samples, work):
    """Ratio of the error of the samples inside a step to their tolerance; 0 if no sample is inside.

    Their tolerance is twenty times the tolerance of a long step, because this error does not propagate.
    """
    off, times, row, near = 0.0, 20.0, count[COUNT.row], t + (1.0 - AT_THE_END) * h
    # a knot counts as a sample even if none is requested
    if knots[0][count[COUNT.knot]] < near or (row < len(samples[0]) and samples[0][row] < near):
        off, evaluations = prepare_inside(t, h, inputs, state, work)
        count[COUNT.besides] += evaluations
    return off / (times * long_error)


@inlined
def begin_anew(t, inputs, state, tau, forward, work):
    """Restart from the state at time t: evaluate q̈ and the power, and count the restart."""
    begin(t, inputs, state, tau, forward)
    if work.ties is not None:
        begin_tied(state, work)
    work.stepper[STEPPER.begun] += 1.0


@recursion
def sample(t, h, inputs, state, work, count, samples, spare):
    """Fill in the samples up to the end of the step, t + h."""
    times, qs, qds, works, so_far = samples
    while count[COUNT.row] < len(times) and times[count[COUNT.row]] <= t + (1.0 + AT_THE_END) * h:
        row = count[COUNT.row]
        works[row] = write_state(min(1.0, (times[row] - t) / h), h, state, work, qs[row], qds[row])
        follow(inputs.motion, times[row], qs[row], qds[row], spare)
        so_far[row, SO_FAR.deflection] = work.stepper[STEPPER.deflection]  # for the check of the sample, as all below
        keep(so_far, row, (work.stepper[STEPPER.drifted], work.stepper[STEPPER.kicked]), SO_FAR.drifted)
        for k in range(COUNT.knot):
            so_far[row, SO_FAR.steps + k] = count[k]
        count[COUNT.row] += 1


@recursion
def write_state(x, h, state, work, angles, rates):
    """Write q and q̇ at the fraction x of the step just taken from `state`; returns W there."""
    if x < 1.0 - AT_THE_END:
        return inside(x, h, state, angles, rates, work)
    for k in range(len(angles)):
        angles[k], rates[k] = work.new[0, k], work.new[1, k]
    return work.stepper[STEPPER.work]
