"""Control laws in Python: torques as functions of time and state, sampled and held as by a digital controller."""

import inspect
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, require_callable
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.numbers import multiples, parts, whole
from flexlink.describe.plausibility.sizes import hint_if_outside
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.conserved import Energy
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.sensors.instrument import Readings
from flexlink.dynamics.tied_motion import add_torques_of_ties
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.runge_kutta import integrate, stage
from flexlink.kernels.stepping.samples import derive, prescribed_torques
from flexlink.kernels.tools.finite import is_finite
from flexlink.motion.budget import ChunkSize
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import effort_of, held_torques
from flexlink.results.record import Record
from flexlink.results.samples import RunSamples
from flexlink.results.stop_reasons import LawFailure

Law = Callable[..., ArrayLike]
"""T_EX of the driven joints `chain.active`, (d,) [N m], as a function of t [s], q [rad] and q̇ [rad/s], both (n,).

A law with a parameter `sensors` also gets the sensor readings, by the names of their columns.
"""
SENSORS = "sensors"  # name of the parameter through which a law gets sensor readings
Tableau = tuple[Array, Array, Array]  # Butcher tableau A, b, c of a method


class Control:
    """A control law in a run: sampled at a rate and held in between, or evaluated at every stage.

    `apart`: number of fixed steps between two instants; `between`: their distance [s]; `times`: instants [s] for which
    the run stores torques; `joints`: number of driven ones; `drive`: with the torques held so far, 0 at later instants;
    `impulse`: estimated T k_d (n,) with which the law reads rates; `before`: torques on their way as a run begins.
    """

    def __init__(
        self, law: Law, rate: float | None, delay: float, problem: InitialValueProblem, before: Array | None = None
    ) -> None:
        run, start, chain, self.law, self.chain = problem.run, problem.start, problem.chain, law, problem.chain
        self._problem, self._sensing = problem, Readings(problem.scene) if takes_sensors(law) else None
        self.base = problem.base
        self.effort, self.joints = effort_of(problem.scene, chain), len(chain.active)
        self.limited = bool(np.isfinite(self.effort).any())
        self.sampled, self.origin = rate is not None, round(start / run.fixed_step)
        self.between = between = run.spacing if rate is None else 1 / positive("rate", rate)
        if self.sampled:
            whole("t0", start, "1 / rate", between, ArgumentError)
        if run.controlled:
            self.times = multiples(start, between, math.floor(parts(run.duration, between)) + 1)
        else:
            self.apart = whole(f"rate = {rate!r}: 1 / rate", between, "run.step", run.fixed_step, ArgumentError)
            last = (run.samples - 1) * run.steps_per_sample
            self.times = np.asarray((self.origin + np.arange(0, last + 1, self.apart)) * run.fixed_step)
        late, before = self._late(delay), np.empty((0, 1 + self.joints)) if before is None else before
        self._earlier = len(before)
        self._read, self.impulse = nothing_read(chain), np.zeros(chain.n)
        acting = np.concatenate([before[:, 0], self.times + late])
        torques = np.concatenate([before[:, 1:], np.zeros((len(self.times), self.joints))])
        self.drive = drive_for(chain, held_torques(chain, acting, torques)._replace(delay=late))

    def _late(self, delay: float) -> float:
        """Delay [s] after which torques act; a multiple of a fixed step."""
        if not delay:
            return 0.0
        if not self.sampled:
            raise ArgumentError(f"delay = {delay!r}: needs rate, the sampling rate of the law [Hz]", id="no-effect")
        run, delay = self._problem.run, positive("delay", delay)
        if run.controlled:
            return delay
        return run.fixed_step * whole("delay", delay, run.label("step", "run."), run.fixed_step, ArgumentError)

    def torque(self, t: float, q: Array, qd: Array, sensors: dict[str, dict[str, float]] | None = None) -> Array:
        """Torques (d,) of the law within `effort`, or a LawFailure if it raises or does not return d finite numbers."""
        if self.base is not None:
            q, qd = self.base.relative_to_start(q, qd)
        try:
            given = np.asarray(self.law(t, q.copy(), qd.copy(), **(sensors or {})))
        except Exception as error:
            form = "; it is called as law(t, q, qd)" if isinstance(error, TypeError) else ""
            raise LawFailure(f"{self._label(t)} raised {type(error).__name__}: {error}{form}") from error
        if given.dtype.kind in "fiu" and given.shape == (self.joints,):
            torque = given.astype(np.float64)
            if is_finite(torque):
                return np.clip(torque, -self.effort, self.effort) if self.limited else torque
        wanted = f"expected one finite number per driven joint, shape ({self.joints},)"
        wanted += "; their angles are q[chain.active]" * (given.shape == q.shape)
        raise LawFailure(f"{self._label(t)} returned {truncated(given.tolist())}; {wanted}")

    def _label(self, t: float) -> str:
        """Time and name of the law, for messages."""
        return f"t = {t:.6g} s: control law {getattr(self.law, '__qualname__', type(self.law).__name__)}"

    def note(self, k: int, q: Array, qd: Array) -> None:
        """Evaluate the law at instant `k`, and hold its torques from then on; sensors still see the previous ones."""
        t, held, k = float(self.times[k]), self.drive.feedforward.coefficients, k + self._earlier
        sensors = None
        if self._sensing is not None:
            held[k, 0] = held[k - 1, 0] if k else 0.0
            seen = sample_at(self._problem, self._problem.inputs._replace(drive=self.drive), t, q, qd)
            sensors = {SENSORS: self._sensing.after(seen)}
        held[k, 0] = self.torque(t, q, qd, sensors)
        if self.sampled:
            self.impulse = impulses(self._read, self.chain, held[k, 0], qd, self.between)

    def pieces(self, record: Record, run: RunSettings, state: tuple[Array, Array, Array]) -> Iterator[int]:
        """Integrate, at most until the law fails; yield the last step with a finite state, about every `BREATH`."""
        last, go = (run.samples - 1) * run.steps_per_sample, self._sampled if self.sampled else self._continuous
        tableau, pace, number = method(run.method).arrays, ChunkSize(record.chain.n), 0
        yield go(record, tableau, state, 0, 0)
        while number < last:
            stop = min(number + self.apart, last)
            try:
                number = go(record, tableau, state, number, stop)
                if number < stop:
                    yield number
                    return
                if number % self.apart == 0:
                    self.note(number // self.apart, *state[:2])
            except (LawFailure, KeyboardInterrupt):
                yield stop - 1 if number == stop else number
                raise
            if pace.over or number == last:
                yield number
                pace.start()

    def _sampled(
        self, record: Record, tableau: Tableau, state: tuple[Array, Array, Array], first: int, stop: int
    ) -> int:
        run, samples = record.run, (record.q, record.qd, record.works)
        fixed = record.scratch, tableau, record.inputs, run.fixed_step, record.origin
        return record.advance(integrate, fixed, first, stop, (run.steps_per_sample, state, samples))

    def _continuous(
        self, record: Record, tableau: Tableau, state: tuple[Array, Array, Array], first: int, stop: int
    ) -> int:
        """Integrate as `integrate` does, with the law evaluated at every stage."""
        (A, b, c), run, inputs = tableau, record.run, record.inputs
        h = run.fixed_step
        (q, qd, work), (L, K) = state, np.zeros((2, len(c), self.chain.n))
        for number in range(self.origin + first, self.origin + stop):
            for i in range(len(c)):
                t, Q, L[i] = (number + c[i]) * h, q + h * A[i, :i] @ L[:i], qd + h * A[i, :i] @ K[:i]
                follow(inputs.motion, t, Q, L[i], K[i])
                tau, middle = np.zeros(self.chain.n), (number + 0.5) * h
                tau[self.chain.active] = self.torque(t, Q, L[i])
                work += h * b[i] * stage(record.scratch, inputs, t, middle, Q, L[i], tau, K[i])
            q += h * b @ L
            qd += h * b @ K
            follow(inputs.motion, (number + 1) * h, q, qd, K[0])
            if not np.isfinite([q, qd]).all():
                return number - self.origin
            row, left = divmod(number + 1 - self.origin, run.steps_per_sample)
            if not left:
                record.q[row], record.qd[row], record.works[row] = q, qd, work[0]
            if record.base is not None and record.is_far(q):
                record.base.turn(row + 1, q, qd, record.scratch)
        return stop


def nothing_read(chain: Chain) -> Array:
    """Memory of `impulses` before the first instant, (d, 4): τ and q̇ of the last instant, and both sums."""
    return np.tile([np.nan, np.nan, 0.0, 0.0], (len(chain.active), 1))


def impulses(memory: Array, chain: Chain, tau: Array, qd: Array, period: float) -> Array:
    """Impulses T k_d, (n,), of a law of unknown gains, from its torques (d,) and the rates (n,) at an instant.

        k_d = √(Σ Δτ² / Σ Δq̇²)

    They count in the error of the steps (`STEPPER.read`). Torques that change for other reasons make the gains larger,
    and the steps more accurate than needed. The `memory` is updated.
    """
    fading = 0.95  # weight of earlier instants; about twenty count
    found, joints, rows = np.zeros(chain.n), chain.active.tolist(), memory.tolist()  # lists: a tenth of NumPy's time
    for one, k, torque, rate in zip(rows, joints, tau.tolist(), qd[joints].tolist(), strict=True):
        Δτ, Δv = torque - one[0], rate - one[1]
        one[:2] = torque, rate
        if not (math.isnan(Δτ) or math.isnan(Δv)):  # as at the first instant
            one[2:] = fading * one[2] + Δτ * Δτ, fading * one[3] + Δv * Δv
        square = one[2] / one[3] if one[3] > 0.0 else 0.0
        found[k] = period * math.sqrt(square) if square < math.inf else 0.0  # a diverging run overflows
    memory[...] = np.reshape(rows, memory.shape)
    return found


def control_of(
    problem: InitialValueProblem, law: Law | None, rate: float | None, delay: float, before: Array | None
) -> Control | None:
    """The control law of a run, or None.

    Refused are laws that are not callable or given in addition to a drive, rates that do not fit the step or are likely
    a period, and methods without stages at which a law can be evaluated.
    """
    require_callable("control", law)
    if law is None:
        for name, given in (("rate", rate), ("delay", delay or None)):
            if given is not None:
                text = f"{name} = {given!r}: has no effect without control; specify control, or omit {name}"
                raise ArgumentError(text, id="no-effect")
        return None
    run, scene = problem.run, problem.scene
    if scene.drive.kind != "none":
        remedy = "specify only one: scene.varied({'drive': None}) removes the drive"
        raise ArgumentError(f"control: the scene also has a drive, {scene.drive.kind!r}; {remedy}", id="both-given")
    if rate is None and problem.ties is not None:
        raise ArgumentError("control: with ties, a control law needs a rate; specify rate", id="controller-needs-rate")
    if rate is None and not problem.explicit:
        implicit = f"method = {run.method!r}, which is implicit"
        what = "the default tolerance" if run.by_default else "a tolerance" if run.controlled else implicit
        remedy = "use fixed steps of an explicit method: run.step, such as 1e-4, and run.method = 'RK4'"
        why = f"control: with {what}, a control law needs a rate; specify rate, or {remedy}"
        raise ArgumentError(why, id="controller-needs-rate")
    if takes_sensors(law):
        if not scene.sensor:
            why = "control: has the parameter sensors, but the scene has no [[sensor]]; add one"
            raise ArgumentError(why, id="no-sensors")
        if rate is None:
            why = "control: a law with the parameter sensors needs a rate; specify rate [Hz]"
            raise ArgumentError(why, id="controller-needs-rate")
    controlled = Control(law, rate, delay, problem, before)
    if rate is not None and 1 / rate > run.duration > 0:
        ends = f", and the run ends after {run.duration:g} s, before the second sample"
        for hint in hint_if_outside("rate", rate, "rate", rate, detail=ends):
            raise ArgumentError(hint, id=hint.id)
    return controlled


def takes_sensors(law: Law) -> bool:
    """Whether a law has a parameter `sensors`."""
    try:
        return SENSORS in inspect.signature(law).parameters
    except (TypeError, ValueError):  # a callable that is not written in Python has no signature
        return False


# One sample of a problem during integration, with the acting torques, for sensors to measure.


def sample_at(problem: InitialValueProblem, inputs: Inputs, t: float, q: Array, qd: Array) -> RunSamples:
    """The sample of a problem at time t [s] and a state (n,), with these inputs.

    With a free base, the state is given in the integrator's coordinates; the sample is returned in those
    of `problem.original`, like the samples of a finished run.
    """
    chain, time = problem.original, np.array([t])
    wrench = inputs.tip_wrenches(time, q[None], qd[None])
    if problem.base is not None:
        q, qd = problem.base.relative_to_start(q, qd)
    states = time, q[None].copy(), qd[None].copy()
    tau, tip, energy = np.zeros((1, chain.n)), np.empty((1, 3)), np.empty((3, 1))
    derive(chain.arrays, inputs, 0, 1, *states, tau, tip, energy)
    if len(inputs.motion.joints):
        scratch = solver_for(chain, problem.run.solver).workspace(chain.arrays)
        loads = None if inputs.loads is None else inputs.loads.holding(wrench[0], chain.arrays)
        prescribed_torques(scratch, inputs._replace(wrench=wrench[0], loads=loads), *states, tau)
        if problem.ties is not None:
            add_torques_of_ties(problem.ties, chain, *states, tau, wrench)
    return RunSamples(chain, *states, tau, tip, Energy(*energy), tip_wrench=wrench, scene=problem.scene)
