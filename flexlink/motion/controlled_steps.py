"""Steps of a method that estimates their error, or of an implicit one, in pieces between which Python looks up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.analysis.extremes import slowest_frequency
from flexlink.analysis.stability import stable_step
from flexlink.common.errors import SceneError
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
from flexlink.motion.landings import landings
from flexlink.motion.pace import Pace, Reached
from flexlink.motion.result import Record, Steps
from flexlink.motion.watch import LONG, Watch, gains_of

Array = NDArray[np.float64]

OF_A_STEP, OF_A_LONG_STEP, OF_AN_EXPLICIT_STEP = 0.25, 0.1, 0.02
"""Error that one step may have, as a part of the tolerance, of which a run has `LONG` times as much for all its steps.
It is the error of a formula of lower order: that of the step itself is a few hundredths of it, or less. Measured on 16
scenes with 7 tolerances: the errors at the end have a median of 0.1 of the tolerance, or less, and are at most 4 times
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

SHORTEST = 1e-14
"""Part of the duration below which a step is none."""


class ControlledSteps:
    """The steps of a run, compiled and not yet taken; `failure` says why they ended early."""

    def __init__(self, watch: Watch) -> None:
        record, run = watch.record, watch.run
        self.failure, self.record, self.run = "", record, run
        slowest = slowest_frequency(record.chain, record.q[0])
        self.name, self.why = choose(run, record, slowest)
        self.method = method(self.name)
        self.state = record.q[0].copy(), record.qd[0].copy(), np.zeros(record.chain.n), np.zeros(2)
        self.work = workspace(self.method, record, slowest)
        self.count = np.zeros(clock.COUNTS, np.int64)
        self.count[clock.ROW] = 1
        self.knots = knots(run, self.method, record)
        self.samples = record.t, record.q, record.qd, record.works
        self.work.clock[clock.PASSES] = FEW_PASSES if run.controlled else MANY_PASSES
        self.work.clock[clock.ROUNDING] = rounding.of_position(record.chain)
        self.work.clock[clock.TIME] = record.t[0]
        controlled.begin(float(record.t[0]), record.inputs, self.state, np.zeros(record.chain.n), record.scratch)
        longest = longest_step(self.method, self.name, record)
        self.settings = settings(run, self.method, rounding.reach(record.chain), longest)
        controlled.first_step(self.work, self.state, self.settings, run.duration)
        self._advance(0)  # compiles, while no signal is deferred

    def __iter__(self) -> Iterator[Reached]:
        duration, pace, how = self.run.duration, Pace(), controlled.GOES_ON
        yield Reached(1, 0.0 if duration else 1.0)
        while duration and how == controlled.GOES_ON:
            how = self._advance(pace.start())
            pace.end()
            if how == controlled.STUCK:
                self.failure = self._stuck()
            past = self.work.clock[clock.TIME] - self.record.t[0]
            yield Reached(int(self.count[clock.ROW]), past / duration)

    @property
    def steps(self) -> Steps:
        """What was done so far."""
        taken, rejected, failed, passes = (int(n) for n in self.count[:4])
        return Steps(self.name, taken, passes * self.method.stages, rejected, failed, self.why)

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
            if self.count[clock.FAILED]
            else f"no step is small enough for the tolerance at t = {now:.6g} s, down to {h:.3g} s (joint {joint!r})"
        )


def choose(run: Run, record: Record, slowest: float) -> Choice:
    """The method of a run, and, if it is not named, why."""
    if run.method != AUTO:
        return Choice(run.method, "")
    return cheapest(record, run.tolerance_within(rounding.reach(record.chain)), slowest)


def longest_step(method: Method, name: str, record: Record) -> float:
    """Of an explicit method its largest stable step at the start [s], beyond which its error only grows."""
    if not method.explicit:
        return np.inf
    inputs = record.inputs
    gains = gains_of(record.chain, inputs)
    return stable_step(record.chain, record.q[0], record.qd[0], method=name, tip_wrench=inputs.wrench, gains=gains)


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
    """Times where a step ends [s]: of the inputs' pieces, and the end; fixed steps end where they do.

    A long step of an explicit method ends at its samples: between its ends it is known less well than there.
    """
    if not run.controlled:
        return record.t[-1:]
    samples = record.t if method.explicit else np.empty(0)
    reach = rounding.reach(record.chain)
    table = landings(record.inputs.drive, OF_A_TABLE * run.tolerance_within(reach) / reach)
    given = np.concatenate([table, record.inputs.motion.knots, samples])
    start, end = float(record.t[0]), float(record.t[-1])  # rounded as the last sample is
    return np.array([*np.unique(given[(given > start) & (given < end)]), end])


def workspace(method: Method, record: Record, slowest: float) -> EmbeddedWork | ImplicitWork:
    """Scratch of the steps of a method on the chain of a record, with its lowest frequency [rad/s]."""
    chain, arrays, n, s = record.chain, record.chain.arrays, record.chain.n, method.stages
    posture = (plane_posture if chain.is_planar else space_posture)(*arrays)
    numbers, new = np.zeros(clock.CLOCK_SIZE), np.zeros((3, n))
    numbers[clock.SLOWEST] = 1.0 / slowest
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
