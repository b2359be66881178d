"""Steps of a run by one or several methods: data kept between steps, changes of coordinates, switches of method."""

import functools
import math
import operator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.common.memo import Kept, Memo, contents
from flexlink.common.types import Array
from flexlink.data.documents import is_user_file
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.dynamics.vibration.stability import bounding_eigenvalues, eigenvalue_bounds, stable_step, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping import adaptive
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.kernels.stepping.embedded import EmbeddedWork
from flexlink.kernels.stepping.implicit_layout import ImplicitWork
from flexlink.kernels.stepping.saturation import choose_branches
from flexlink.kernels.stepping.step_state import COUNT, SO_FAR, STEPPER
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion import step_workspace
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.inputs.drives import remembered
from flexlink.motion.method_choice import cheapest, fastest_motion, prices, tumbles
from flexlink.motion.stop_times import SHORTEST, StopTimes, only
from flexlink.motion.tolerable import Thresholds
from flexlink.results.record import Record
from flexlink.results.samples import Steps

NEVER = 2**62  # a number of steps that no run reaches


class MethodSteps:
    """Steps of a run from its start, by the run's method or by automatically chosen methods.

    `state`: q, q̇, q̈ (n,), and the work W with its power (2,), at the time reached; `methods`: first sample, name and
    reason of each so far; `end`: of the present piece [s]; `read`: T k_d (n,) of a sampled law that no drive describes;
    `dearest`: most evaluations in an adaptive step, 0 for fixed ones; `prices`: of the `OPERATIONS` by the present
    method, which took over at the time `taken`, when earlier ones had `spent` CPU time [s].
    """

    settings: tuple[float, ...]  # of the steps, in the order of `adaptive.advance`
    types: bytes  # of all arguments of the steps, which select their compiled code; if empty, they are inspected
    consider_at: int  # number of attempted steps at which a switch of method is considered next
    rated_since: tuple[float, float] | None  # time, and cost, at the start of the steps that give the cost rate
    guesses: dict[str, float]  # CPU time per second of motion with each method [s/s]
    rates: dict[str, float]  # the same, measured; inf if the method got stuck
    tried: dict[str, float]  # cost of the run when each method was last started or left [s]
    tried_for: tuple[str, str] | None  # method, and reason, to which the run returns from an unsuccessful trial

    def __init__(self, record: Record, by_drive: bool, halved: bool, passes: bool) -> None:
        n = record.chain.n
        self.by_drive, self.halved, self.passes = by_drive, halved, passes
        self.given, self.inputs = record.inputs, with_own_limits(record.inputs)
        self.read = np.zeros(n)
        self._gains: tuple[Inputs, tuple[Array, ...]] = record.inputs, step_workspace.own_gains(record)
        self.memory, self.tau, self.count = np.zeros(3 * n + 2), np.zeros(n), np.zeros(COUNT.size, np.int64)
        self.state = self.memory[:n], self.memory[n : 2 * n], self.memory[2 * n : -2], self.memory[-2:]
        self.forward = record.scratch
        self._started: tuple[Any, tuple[Any, ...]] = None, ()
        self.start(record)

    def start(self, record: Record) -> None:
        """Start from the first sample of a record; from the third start in one state on, everything is prepared."""
        memory = remembered(record.inputs.drive)
        state = record.q[0], record.qd[0], record.t[:1], *memory
        about = [record.run, *(array.tobytes() for array in state)]
        last, prepared = self._started
        again = last == about
        if prepared and again:
            self.read[:] = 0.0  # a simulator may have read another law since
            self.restore(prepared[0], gains=self.inputs is not self.given)  # else no step wrote to them
            for array, value in zip((record.q[0], record.qd[0], *memory), prepared[1], strict=True):
                array[...] = value
        self.record, self.run = record, record.run
        self.samples = record.t, record.q, record.qd, record.works, record.so_far
        if not (prepared and again):
            self._prepare()
            changed = record.q[0], record.qd[0], *memory
            prepared = (self.saved(), [array.copy() for array in changed]) if again else ()
        self._started = about, prepared

    def _prepare(self) -> None:
        """Choose the method and its settings, and evaluate the initial state."""
        record, run = self.record, self.run
        about = record.q[0].tobytes(), record.qd[0].tobytes()
        posture = record.q[0] if run.controlled else np.zeros(record.chain.n)
        self.slowest = record.kept("slowest", about, lambda: slowest_frequency(record.chain, posture))
        record.begin()
        if self.given is not record.inputs:  # a simulator has acted
            self.given, self.inputs = record.inputs, with_own_limits(record.inputs)
            self._gains = record.inputs, step_workspace.own_gains(record)
        self.memory[:], self.count[:], self.read[:] = 0.0, 0, 0.0
        self.state[0][:], self.state[1][:] = record.q[0], record.qd[0]
        self.methods: tuple[tuple[int, str, str], ...] = ()
        self.spent, self.taken = 0.0, float(record.t[0])
        self.count[COUNT.row] = 1
        # fixed steps begin on the grid of all steps, bit for bit
        start = float(record.t[0]) if run.controlled else run.fixed_step * record.origin
        self._take(record.kept("choice", (run, *about), self._choice), start)
        self._begun: tuple[float, Inputs] | None = None
        self.aim(start, start)
        self._begun = start, self.inputs
        if run.controlled:
            work, types = self.work, self.types
            parts = work.stepper, work.posture, work.springs, work.chain
            arguments = *parts, self.state, self.settings, run.duration, self.tau
            find = functools.partial(direct, adaptive.first_step, *arguments, types=types)
            record.kept("first step", (types, self.method), find)(*arguments)
            self.work.stepper[STEPPER.deflection] = min(self.work.stepper[STEPPER.deflection], record.chain.size)
        else:
            self.work.stepper[STEPPER.step] = run.fixed_step

    def _choice(self) -> tuple[str, str]:
        """Method of a run, and the reason if it was chosen automatically."""
        if self.run.method != AUTO:
            return self.run.method, ""
        return cheapest(self.record, self.run.tolerance_within(self.record.chain.size), self.slowest)

    def reads(self, impulse: Array) -> None:
        """Follow the vibrations that an unknown law reads with these gains T k_d (n,)."""
        self.read[:] = impulse
        self.work.springs.impulse[:] = self._gains[1][2] + impulse

    def act(self, inputs: Inputs) -> None:
        """Continue under these inputs; compiles if they are new."""
        if inputs is not self.given:
            self.given, self.inputs = inputs, with_own_limits(inputs)
            self._put_gains()
            self._compile()

    def saved(self) -> Any:
        """Copy of everything that steps change, for `restore`."""
        base = self.record.base.saved() if self.record.base is not None else None
        return vars(self).copy(), [array.copy() for array in self._changing], base

    def restore(self, saved: Any, gains: bool = True) -> None:
        """Return to a `saved` state; `gains`: whether the gains of the drive in the workspace may be others now."""
        attributes, arrays, base = saved
        vars(self).update(attributes)
        if self.record.base is not None:
            self.record.base.restore(base, self.forward, self.work)
        for array, before in zip(self._changing, arrays, strict=True):
            array[...] = before
        if gains:
            self._put_gains()

    @property
    def _changing(self) -> tuple[NDArray[Any], ...]:
        return self.memory, self.count, self.work.stepper, *step_workspace.stages_of(self.work)

    def _put_gains(self) -> None:
        chain, given = self.record.chain, self.given
        if self._gains[0] is not given:
            self._gains = given, step_workspace.drive_gains(chain, given)
        kp, kd, kick = self._gains[1]
        self.work.springs.impulse[:] = kick + self.read
        for gains in (self.work.springs, self.work.saturation):
            gains.kp[:], gains.kd[:] = kp, kd
        self._choose_branches()

    def _choose_branches(self) -> None:
        """Choose for every motor whether it follows its law or stays at a torque limit in the next adaptive step."""
        if self.run.controlled and self.inputs is not self.given:  # only then do steps write torque limits
            drive, work, (q, qd, *_) = self.inputs.drive, self.work, self.state
            choose_branches(self.time, drive, q, qd, work.springs, work.saturation)

    def aim(self, start: float, end: float) -> None:
        """Begin a piece between two times [s], at which torques may jump."""
        self.end, self.knots = end, self.stop_times.between(start, end)
        self.count[COUNT.knot], self.work.stepper[STEPPER.time] = 0, start
        self._choose_branches()
        begun, self._begun = self._begun, None
        if begun is None or start != begun[0] or self.inputs is not begun[1]:  # else begun when the run started
            self._begin(start, self.inputs, self.state, self.tau, self.forward)

    def take(self, most: int) -> int:
        """Attempt up to `most` steps; return an OUTCOME."""
        return int(self._take_steps(*self.arguments(most)))

    def turn(self) -> None:
        """Continue in coordinates in which the angles of the base are zero."""
        if self.record.base is not None:
            self.record.base.turn(self.row, *self.state[:2], self.forward, self.work)
        adaptive.forget(self.work.stepper)
        self._begin(self.time, self.inputs, self.state, self.tau, self.forward)

    def step_in_parts(self) -> bool:
        """Complete a fixed step in 2, 4, … or 64 parts; return whether this succeeds.

        Each division continues from the previous one. If all fail, they are repeated with the nonlinear law of dry
        friction, whose slope does not show where a joint stops. The step ends exactly at its time, as at a knot.
        """
        (*fixed, _, _), knots, now, count = self.settings, self.knots, self.work.stepper, self.count
        step, k, start = self.run.fixed_step, int(count[COUNT.knot]), float(now[STEPPER.time])
        at_knot = start + adaptive.NEARLY * step >= knots[0][k]
        end = float(knots[0][k]) if at_knot else start + step
        try:
            for now[STEPPER.turning] in step_workspace.friction_laws(self.work):
                # halving the step makes Newton's iteration converge 4 times as fast
                solved = any(self._solved_in((end - start) / parts, end, fixed) for parts in (2, 4, 8, 16, 32, 64))
                if solved:
                    break
        finally:
            now[STEPPER.turning] = 0.0
            self.settings, self.knots, count[COUNT.knot] = (*fixed, step, step), knots, k
        if not solved:
            return False
        self._restart(step)
        if at_knot:
            count[COUNT.knot] += 1
        if count[COUNT.knot] < len(knots[0]):
            self._begin(end, self.inputs, self.state, self.tau, self.forward)
        return True

    def _solved_in(self, part: float, end: float, fixed: list[float]) -> bool:
        """Whether steps of length `part` [s] reach the time `end` [s]."""
        self.settings, self.knots, self.count[COUNT.knot] = (*fixed, part, part), only(end), 0
        self._restart(part)
        while (how := self.take(NEVER)) == OUTCOME.turned:
            self.turn()
        return how == int(OUTCOME.ended)

    def _restart(self, step: float) -> None:
        """Restart with steps of this length [s], without using data of earlier steps."""
        adaptive.forget(self.work.stepper)
        self.work.stepper[STEPPER.step] = step

    def go_on_with(self, name: str, why: str = "") -> None:
        """Continue with another method to the end of the piece; by default the reason is the switch and its time."""
        before, time, end = self.work.stepper.copy(), self.time, self.end
        self.count[COUNT.besides], self.count[COUNT.iterations] = self.evaluations, 0
        self._take((name, why or f"{self.why}; {self.name} until t = {time:.3g} s"), time)
        self._put_gains()  # gains of the present inputs, which in a simulator may differ from the record's
        self.aim(time, end)
        now = self.work.stepper
        continued = [STEPPER.deflection, STEPPER.angle_travelled, STEPPER.drifting, STEPPER.drifted, STEPPER.kicked]
        now[continued], now[STEPPER.step] = before[continued], min(before[STEPPER.step], self.settings[-1])

    def _take(self, choice: tuple[str, str], now: float) -> None:
        """Prepare steps by a method, chosen for a reason, from time `now` [s] on; compile before deferring signals."""
        record, (self.name, self.why) = self.record, choice
        first = self.row if self.methods else 0
        self.spent, self.taken = self.spent + (self.cost if self.methods else 0.0), now
        self.methods = *(other for other in self.methods if other[0] < first), (first, *choice)
        self.method = method(self.name)
        stages = self.method.stages
        dearest = stages + self.method.more_stages if self.method.explicit else step_workspace.FEW_PASSES * stages
        self.dearest = dearest if self.run.controlled else 0
        self.work, self._at_first = self._scratch(), (self.evaluations, self.tries)
        start, rule, about = float(record.t[0]), self.method, (part.tobytes() for part in self.state[:2])
        stops = lambda: StopTimes(rule, record, self.by_drive, halved=self.halved, passes=self.passes)  # noqa: E731
        self.prices = prices(record, explicit=rule.explicit)
        of_the_run = self.run, self.halved, self.passes, rule, start
        self.stop_times = record.kept(("stops", self.name), (*of_the_run, tumbles(record)), stops)
        place = "settings", self.name, now == start  # settings differ between the start and a switch
        self.settings = record.kept(place, (*of_the_run, now, *about), lambda: self._settings(now))
        self.end, self.knots = now, only(now)
        self._compile()

    def _settings(self, now: float) -> tuple[float, ...]:
        """Settings of the method's steps from time `now` [s] on."""
        record = self.record
        longest, span = np.inf, self.stop_times.span
        if self.method.explicit and now > record.t[0]:
            longest = longest_step_of(self.name, span, *fastest_motion(record, self.state[0]))
        elif self.method.explicit:
            longest = longest_step(self.name, record, span, now, self.state)
        return settings(self.run, self.method, record, longest / 2 if self.halved else longest)

    def _scratch(self) -> EmbeddedWork | ImplicitWork:
        """Workspace of the method, new or reset."""
        kept, key, name = self.record.kept, (self.method, self.run.controlled), self.name
        work: EmbeddedWork | ImplicitWork
        work = kept(("scratch", name), key, lambda: step_workspace.workspace(self.method, self.record, self.slowest))
        new = kept(("new scratch", name), key, lambda: [array.copy() for array in step_workspace.remembered(work)])
        for array, value in zip(step_workspace.remembered(work), new, strict=True):
            array[:] = value
        work.stepper[STEPPER.inverse_ω1] = 1.0 / self.slowest
        if self.record.base is not None:
            self.record.base.take(self.record.base.attitude, self.forward, work)
        return work

    def _compile(self) -> None:
        kept = self.record.kept if self.given is self.record.inputs else Kept()  # compiled code depends on input types
        start, steps = (0.0, self.inputs, self.state, self.tau, self.forward), self.arguments(0)
        # types of all arguments of the steps; empty if a user's method file may change them
        self.types = types = b"" if is_user_file(self.name) or not kept.types else kept.types + self.name.encode()
        self._begin = kept("begin", None, lambda: direct(adaptive.begin, *start, types=kept.types))
        if self.record.tied:
            begin, tied = self._begin, (self.state, self.work)
            find = functools.partial(direct, adaptive.begin_tied, *tied, types=types)
            satisfy = kept(("tied", self.name), (types, self.method), find)
            self._begin = lambda *start: (begin(*start), satisfy(*tied))
        take = functools.partial(direct, adaptive.advance, *steps, types=types)
        self._take_steps = kept(("steps", self.name), (types, self.method), take)

    def arguments(self, most: int) -> tuple[Any, ...]:
        """Arguments of `adaptive.advance` for up to `most` steps."""
        of_the_method = self.work, self.forward, self.inputs, self.settings
        return *of_the_method, self.count, self.state, self.tau, self.knots, self.samples, most

    @property
    def steps(self) -> Steps:
        """Step counts so far."""
        count = self.count.tolist()
        taken, rejected, failed = count[COUNT.steps], count[COUNT.rejected], count[COUNT.failed]
        return Steps(self.name, taken, self.evaluations, rejected, failed, self.why)

    def steps_before(self, row: int) -> Steps:
        """Step counts up to the step that passed sample `row`."""
        *_, (_, name, why) = (found for found in self.methods if found[0] <= row)
        note = self.record.so_far[row].astype(int).tolist()
        evaluations = note[SO_FAR.besides] + note[SO_FAR.iterations] * method(name).stages
        return Steps(name, note[SO_FAR.steps], evaluations, note[SO_FAR.rejected], note[SO_FAR.failed], why)

    @property
    def evaluations(self) -> int:
        """Number of evaluations so far."""
        besides = int(self.count[COUNT.besides])  # by other methods, in trials, and for dense output
        return besides + int(self.count[COUNT.iterations]) * self.method.stages

    @property
    def work_done(self) -> list[float]:
        """Number of each of the `OPERATIONS` that this method has done since it took over."""
        s, now, (evaluations, tries) = self.method.stages, self.work.stepper.tolist(), self._at_first
        return [
            self.evaluations - evaluations, self.tries - tries, now[STEPPER.begun], s * now[STEPPER.prepared],
            now[STEPPER.weighed], now[STEPPER.stage_matrices], now[STEPPER.stage_solutions], s * now[STEPPER.answers],
            now[STEPPER.multiplications],
        ]  # fmt: skip

    @property
    def cost(self) -> float:
        """CPU time of `work_done` [s]."""
        return math.fsum(map(operator.mul, self.prices, self.work_done))

    @property
    def time(self) -> float:
        """Time reached [s]."""
        return float(self.work.stepper.item(STEPPER.time))

    @property
    def row(self) -> int:
        """Index of the next sample."""
        return int(self.count[COUNT.row])

    @property
    def tries(self) -> int:
        """Number of attempted steps."""
        count = self.count.tolist()
        return int(count[COUNT.steps] + count[COUNT.rejected] + count[COUNT.failed])

    @property
    def so_far(self) -> tuple[float, float, float]:
        """Largest deflection [m], angle travelled by all free joints [rad], sum of errors of rates that last [m/s]."""
        value = self.work.stepper.item
        return value(STEPPER.deflection), value(STEPPER.angle_travelled), value(STEPPER.drifting)


# Settings of the steps: limits of their errors and lengths, and the largest stable step.


def with_own_limits(inputs: Inputs) -> Inputs:
    """Inputs with a copy of the torque limits if steps may write to them; see `saturation.saturates` of the kernels."""
    drive = inputs.drive
    if drive.rate or min(drive.effort.tolist(), default=np.inf) == np.inf:  # no motor saturates within a step
        return inputs
    return inputs._replace(drive=drive._replace(limits=drive.limits.copy()))


LONGEST = Memo(16)  # cache of stable steps, which a run and those that it is compared with share


def longest_step(name: str, record: Record, span: float, t: float, state: tuple[Array, ...]) -> float:
    """Largest stable step [s] of an explicit method about a state; inf if beyond `span`, the time between two stops."""
    chain, (q, qd, *_) = record.chain, state
    acting = acting_at(record.inputs, chain, t, q, qd)

    def find() -> float:
        if _matters(name, span, *eigenvalue_bounds([(chain, q, qd)], [acting])):
            return stable_step(chain, q, qd, method=name, **acting)
        return np.inf

    return find() if is_user_file(name) else LONGEST(chain, contents((name, span, q, qd, *acting.values())), find)


def longest_step_of(name: str, span: float, ω: float, δ: float) -> float:
    """Return `longest_step` for motion whose fastest oscillation is ω [rad/s] and fastest decay δ [1/s]."""
    λ = bounding_eigenvalues(ω, δ)
    return stable_step_of(λ, name) if _matters(name, span, float(np.abs(λ).max())) else np.inf


def _matters(name: str, span: float, rate: float) -> bool:
    """Whether a step of length `span` [s] may be unstable for eigenvalues λ with |λ| up to `rate` [1/s]."""
    return not 1.01 * span * rate < stable_half_disc(method(name))


def settings(run: RunSettings, rule: Method, record: Record, largest: float) -> tuple[float, ...]:
    """Settings of `advance`: error limits, order of the error estimate, shortest and longest step."""
    long_stages = 5  # implicit methods with this number of stages or more take few, long steps
    exact = 1e-13  # residual of a fixed step, relative to the arm's size; a larger one makes the energy drift
    if record.chain.has_free_base:
        exact = 1e-16  # free base: one more iteration, since momentum errors of all steps add up and nothing damps them
    of_the_iteration = 0.05  # residual of the Newton iteration, relative to the allowed error of a step
    of_a_deflection = 0.1  # factor on a tolerance for deflection, since errors of all steps persist as vibration
    size = record.chain.size
    if not run.controlled:
        return np.inf, 0.0, run.fixed_step, exact * size, 0.0, 1.0, run.duration, run.fixed_step, run.fixed_step
    if run.accuracy == "deflection" and not (record.chain.hinges["stiffness"] > 0).any():
        why = f"no link of {record.chain.name!r} bends, so its deflection is always zero; use accuracy = 'tip'"
        raise SceneError(f"run.accuracy = 'deflection': {why}", id="nothing-bends")
    least = record.least_tolerance
    absolute, part = run.tolerance_within(size), 0.0
    if run.accuracy == "deflection":
        absolute, part = least, run.tolerance_within(1.0)  # `least`, due to rounding, if the deflection is zero
    elif absolute < least:
        why = f"below the rounding error of an arm of {size:.3g} m at angles up to {np.abs(record.q[0]).max():.2g} rad"
        text = f"run.tolerance = {absolute:.3g} m: {why}; expected at least {least:.2g} m"
        raise SceneError(text, id="tolerance-below-rounding")
    elif record.follows_vibrations:
        absolute, part = least, absolute / size
    order = float(rule.order if rule.explicit else rule.stages + 1)
    long = rule.stages >= long_stages
    # Largest error, relative to the tolerance, of a step of length duration / `Thresholds.long`; a shorter step may
    # have proportionally less. This refers to the embedded lower-order formula; the step's own error is a few
    # hundredths of it or less. Measured on 16 scenes with 7 tolerances, errors at the end have a median of at most 0.14
    # tolerances, and are at most 6 tolerances where motion is sensitive. Explicit steps limited by stability actually
    # have the errors that they estimate, all of one sign.
    one = 0.02 if rule.explicit else 0.1 if long else 0.25
    errors = one * absolute, of_a_deflection * one * part, run.duration / Thresholds.long, np.inf, of_the_iteration
    return *errors, order, run.duration, SHORTEST * run.duration, largest
