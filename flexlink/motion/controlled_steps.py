"""Steps of a method that estimates their error, or of an implicit one, in pieces between which Python looks up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.analysis.extremes import slowest_frequency
from flexlink.analysis.stability import stable_step
from flexlink.common.errors import FlexlinkError, SceneError
from flexlink.describe.methods import Method, method
from flexlink.describe.situation import AUTO, Run
from flexlink.dynamics import rounding
from flexlink.kernels import clock, controlled, implicit
from flexlink.kernels.embedded import EmbeddedMethod, EmbeddedWork
from flexlink.kernels.implicit import ImplicitMethod, ImplicitWork
from flexlink.kernels.planar import planar_workspace
from flexlink.kernels.rne import rne_workspace
from flexlink.kernels.shifted import FACTORS
from flexlink.kernels.shifted_plane import plane_posture
from flexlink.kernels.shifted_space import space_posture
from flexlink.kernels.thrown import Springs
from flexlink.motion.choice import Choice, cheapest
from flexlink.motion.landings import LINEAR, landings
from flexlink.motion.pace import Pace, Reached
from flexlink.motion.result import Record, Steps
from flexlink.motion.watch import LONG, Watch, gains_of

Array = NDArray[np.float64]

OF_A_STEP, OF_A_LONG_STEP, OF_AN_EXPLICIT_STEP = 0.25, 0.1, 0.02
"""Error that one step may have, as a part of the tolerance, of which a run has `LONG` times as much for all its steps.
It is the error of a formula of lower order: that of the step itself is a few hundredths of it, or less. Measured on 16
scenes with 7 tolerances: the errors at the end have a median of 0.14 of the tolerance, or less, and are at most 6 times
it where motion is sensitive. An explicit method's steps, small for stability's sake, have the errors they tell, all in
one direction."""

LONG_STAGES = 5
"""Stages of an implicit method from which its steps are long, and few, so that each may count."""

OF_A_DEFLECTION = 0.1
"""The same of a deflection: its vibrations ring on, and the errors of all steps with them."""

SMALLEST = 200.0
"""Roundings of the tip's place, each of one step, below which a tolerance asks for less than what they add up to."""

OF_THE_ITERATION = 0.05
"""What Newton's iteration may leave of the error of a step."""

EXACT = 1e-13
"""What it may leave of a fixed step, as a part of the arm's reach: what is left drives the energy away."""

FEW_PASSES, MANY_PASSES = 12, 50
"""Iterations before a shorter step is the cheaper way, and those of a fixed step, which has no other way."""

OF_A_TABLE = 0.1
"""Torque, over the largest, that may come and go between the stages of a step, as a part of tolerance over reach."""

EXPLICIT, OFTEN = "DOP853", 20
"""The method with which a run goes on whose iteration fails, and how often it fails before this is thought of."""

ON_THE_GRID = 1e-6
"""Part of a fixed step within which a time is one of its ends."""

SHORTEST = 1e-14
"""Part of the duration below which a step is none."""


class ControlledSteps:
    """The steps of a run, compiled and not yet taken; `failure` says why they ended early."""

    def __init__(self, watch: Watch) -> None:
        record, run = watch.record, watch.run
        self.failure, self.record, self.run = "", record, run
        self.slowest = slowest_frequency(record.chain, record.q[0])
        self.state = record.q[0].copy(), record.qd[0].copy(), np.zeros(record.chain.n), np.zeros(2)
        self.count, self.evaluations_before, self.looked_at = np.zeros(clock.COUNTS, np.int64), 0, 0
        self.count[clock.ROW] = 1
        self.samples = record.t, record.q, record.qd, record.works
        controlled.begin(float(record.t[0]), record.inputs, self.state, np.zeros(record.chain.n), record.scratch)
        self._take(choose(run, record, self.slowest))
        controlled.first_step(self.work, self.state, self.settings, run.duration)

    def __iter__(self) -> Iterator[Reached]:
        duration, pace, how = self.run.duration, Pace(), controlled.GOES_ON
        yield Reached(1, 0.0 if duration else 1.0)
        while duration and how == controlled.GOES_ON:
            how = self._advance(pace.start())
            pace.end()
            if self._explicit_is_cheaper(how):
                how = self._go_on_explicitly()
            if how == controlled.STUCK:
                self.failure = self._stuck()
            past = self.work.clock[clock.TIME] - self.record.t[0]
            yield Reached(int(self.count[clock.ROW]), past / duration)

    @property
    def steps(self) -> Steps:
        """What was done so far."""
        taken, rejected, failed = (int(n) for n in self.count[[clock.TAKEN, clock.REJECTED, clock.FAILED]])
        return Steps(self.name, taken, self._evaluations(), rejected, failed, self.why)

    def _evaluations(self) -> int:
        return self.evaluations_before + int(self.count[clock.ITERATIONS]) * self.method.stages

    def _take(self, choice: Choice) -> None:
        """Prepare steps by a method; compiles, while no signal is deferred."""
        run, record, (self.name, self.why) = self.run, self.record, choice
        self.method = method(self.name)
        self.work = workspace(self.method, record, self.slowest)
        self.work.clock[clock.TIME] = record.t[0]
        self.knots = knots(run, self.method, record)
        longest = longest_step(self.name, record, self.state) if self.method.explicit else np.inf
        self.settings = settings(run, self.method, rounding.reach(record.chain), longest)
        self._advance(0)

    def _explicit_is_cheaper(self, how: int) -> bool:
        """Whether the iteration of a method that was picked fails so often that DOP853's stable steps take less."""
        failed = int(self.count[clock.FAILED])
        if self.run.method != AUTO or self.method.explicit or how == controlled.ENDED:
            return False
        if failed < max(OFTEN, 2 * self.looked_at) and how != controlled.STUCK:
            return False
        self.looked_at = failed
        try:
            explicit = method(EXPLICIT).stages / longest_step(EXPLICIT, self.record, self.state)
        except FlexlinkError:  # of a posture whose M is singular, or nearly so
            return False
        past = self.work.clock[clock.TIME] - self.record.t[0]
        return explicit * past < self._evaluations() or how == controlled.STUCK

    def _go_on_explicitly(self) -> int:
        """Take the rest of the run with DOP853, from where it is."""
        before, self.evaluations_before = self.work.clock, self._evaluations()
        failed = f"{self.name} until t = {before[clock.TIME]:.3g} s: its iteration failed too often"
        self.count[clock.ITERATIONS] = 0
        self._take(Choice(EXPLICIT, f"{self.why}; {failed}"))
        now = self.work.clock
        now[clock.TIME], now[clock.DEFLECTION] = before[clock.TIME], before[clock.DEFLECTION]
        now[clock.STEP] = min(before[clock.STEP], self.settings[-1])
        self.count[clock.KNOT] = np.searchsorted(self.knots, now[clock.TIME], side="right")
        return int(controlled.GOES_ON)

    def _advance(self, most: int) -> int:
        return int(
            controlled.advance(
                self.work,
                self.record.scratch,
                self.record.inputs,
                self.settings,
                self.count,
                self.state,
                self.knots,
                self.samples,
                most,
            )
        )

    def _stuck(self) -> str:
        now, h = self.work.clock[clock.TIME], self.work.clock[clock.STEP]
        joint = self.record.chain.joint_name(int(self.work.clock[clock.WORST]))
        return (
            f"no step is found at t = {now:.6g} s, down to {h:.3g} s: Newton's iteration does not end (joint {joint!r})"
            if self.work.clock[clock.REFUSED] == clock.NOT_SOLVED
            else f"no step is small enough for the tolerance at t = {now:.6g} s, down to {h:.3g} s (joint {joint!r})"
        )


def choose(run: Run, record: Record, slowest: float) -> Choice:
    """The method of a run, and, if it is not named, why."""
    if run.method != AUTO:
        return Choice(run.method, "")
    return cheapest(record, run.tolerance_within(rounding.reach(record.chain)), slowest)


def longest_step(name: str, record: Record, state: tuple[Array, ...]) -> float:
    """Of an explicit method its largest stable step about a state q, q̇ [s], beyond which its error only grows."""
    inputs, (q, qd, *_) = record.inputs, state
    gains = gains_of(record.chain, inputs)
    return stable_step(record.chain, q, qd, method=name, tip_wrench=inputs.wrench, gains=gains)


def settings(run: Run, method: Method, reach: float, largest: float) -> tuple[float, ...]:
    """What `advance` wants to know of a run: errors, the order of the steps' error, shortest and longest step."""
    if not run.controlled:
        return np.inf, 0.0, run.step, EXACT * reach, 0.0, 1.0, run.step, run.step
    least = SMALLEST * rounding.of_reach(reach)
    absolute, part = least, run.relative_tolerance or 0.0  # of no deflection what rounding leaves
    if run.accuracy == "tip":
        absolute, part = run.tolerance_within(reach), 0.0
        if absolute < least:
            raise SceneError(
                f"run.tolerance = {absolute:.3g} m: smaller than what rounding leaves of an arm of {reach:.3g} m; "
                f"allowed are {least:.2g} m and more"
            )
    order = float(method.order if method.explicit else method.stages + 1)
    long = method.stages >= LONG_STAGES
    one = OF_AN_EXPLICIT_STEP if method.explicit else OF_A_LONG_STEP if long else OF_A_STEP
    errors = one * absolute, OF_A_DEFLECTION * one * part, run.duration / LONG, np.inf, OF_THE_ITERATION
    return *errors, order, SHORTEST * run.duration, largest


def knots(run: Run, method: Method, record: Record) -> Array:
    """Times where a step ends [s]: of the inputs' pieces, and the end.

    A long step of an explicit method ends at its samples: between its ends it is known less well than there. Fixed
    steps end at the knots of a table that is not smooth, and then on their own grid again.
    """
    drive, motion = record.inputs.drive, record.inputs.motion
    start, end = float(record.t[0]), float(record.t[-1])  # rounded as the last sample is
    if not run.controlled:
        smooth = drive.coefficients.shape[1] > LINEAR
        number = (np.concatenate([np.empty(0) if smooth else drive.knots, motion.knots]) - start) / run.step
        number = number[np.abs(number - np.round(number)) > ON_THE_GRID]
        given = start + np.concatenate([number, np.ceil(number)]) * run.step
    else:
        reach, samples = rounding.reach(record.chain), record.t if method.explicit else np.empty(0)
        table = landings(drive, OF_A_TABLE * run.tolerance_within(reach) / reach)
        given = np.concatenate([table, motion.knots, samples])
    return np.array([*np.unique(given[(given > start) & (given < end - SHORTEST * run.duration)]), end])


def workspace(method: Method, record: Record, slowest: float) -> EmbeddedWork | ImplicitWork:
    """Scratch of the steps of a method on the chain of a record, with its lowest frequency [rad/s]."""
    chain, arrays, n, s = record.chain, record.chain.arrays, record.chain.n, method.stages
    posture = (plane_posture if chain.is_planar else space_posture)(*arrays)
    numbers, new = np.zeros(clock.CLOCK_SIZE), np.zeros((3, n))
    numbers[clock.SLOWEST], numbers[clock.ROUNDING] = 1.0 / slowest, rounding.of_position(chain)
    numbers[clock.PASSES] = FEW_PASSES if record.run.controlled else MANY_PASSES
    springs = Springs(*gains_of(chain, record.inputs), np.zeros((n, FACTORS)), *np.zeros((2, n)))
    if method.explicit:
        coefficients = EmbeddedMethod(*method.arrays, method.error)
        K, L = np.zeros((2, s + 1, n))
        Q, tau = np.zeros((2, n))
        e = np.zeros((2, n))
        return EmbeddedWork(coefficients, arrays, record.scratch, posture, numbers, new, K, L, Q, tau, e, springs)
    r, p = len(method.modes.real), len(method.modes.complex)
    return ImplicitWork(
        coefficients_of(method), arrays, planar_workspace(*arrays) if chain.is_planar else rne_workspace(arrays),
        posture, numbers, new, np.zeros((5, s, n)), np.zeros(s), np.zeros((implicit.VECTORS, n)), springs,
        np.zeros((r, n, FACTORS)), np.zeros((2, n), complex), np.zeros((p, n, FACTORS), complex),
    )  # fmt: skip


def coefficients_of(method: Method) -> ImplicitMethod:
    """An implicit method as its kernel takes it."""
    (A, b, c), modes = method.arrays, method.modes
    γ, d = method.embedded if method.controlled else (0.0, np.zeros(method.stages))
    return ImplicitMethod(
        np.array([A, modes.A2]), np.array([b, modes.bA, c, d]), γ, modes.real, modes.T_real, modes.Tinv_real,
        modes.complex, modes.T_complex, modes.Tinv_complex,
    )  # fmt: skip
