"""Control laws from outside: torques from time and state, asked for by a run, and held as a sampled controller does."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import callable_or_none, positive
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.describe.methods import method, steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.situation import Run
from flexlink.describe.spec import short
from flexlink.kernels.inputs import follow
from flexlink.kernels.runge_kutta import integrate, stage
from flexlink.motion.actuation import held
from flexlink.motion.endings import LawFailure
from flexlink.motion.pace import Pace
from flexlink.motion.result import Record

Array = NDArray[np.float64]
Law = Callable[[float, Array, Array], ArrayLike]
"""T_EX of the driven joints (d,), `chain.active`, in N m, from t [s], q [rad] and q̇ [rad/s], both (n,)."""


class Control:
    """A law at work in a run: sampled at a rate and held in between, or asked at every stage.

    Attributes
    ----------
    every
        Number of steps between two samples of the law; 0: it is continuous.
    drive
        What it gave at its instants, held: so far, 0 later.
    """

    def __init__(self, law: Law, rate: float | None, scene: Scene, chain: Chain) -> None:
        run, self.law, self.chain = scene.run, law, chain
        self.every = 0 if rate is None else steps_between(rate, run)
        self.origin = round(scene.initial.time / run.step)
        if self.every and self.origin % self.every:
            raise ArgumentError(
                f"t0 = {scene.initial.time!r}: must be a multiple of 1 / rate, {1 / positive('rate', rate):.6g} s"
            )
        apart = self.every or run.steps_per_sample
        self.instants = range(0, (run.samples - 1) * run.steps_per_sample + 1, apart)
        times = (self.origin + np.array(self.instants)) * run.step
        self.drive = held(chain, times, np.zeros((len(times), self.joints)))

    @property
    def joints(self) -> int:
        """Number of driven joints."""
        return len(self.chain.active)

    def torque(self, t: float, q: Array, qd: Array) -> Array:
        """What the law gives, shape (d,).

        Raises
        ------
        LawFailure
            It raises, or gives no d finite numbers.
        """
        name = getattr(self.law, "__qualname__", type(self.law).__name__)
        try:
            given = np.asarray(self.law(t, q.copy(), qd.copy()))
        except Exception as error:
            raise LawFailure(f"t = {t:.6g} s: control law {name} raised {type(error).__name__}: {error}") from error
        if given.dtype.kind not in "fiu" or given.shape != (self.joints,) or not np.isfinite(given).all():
            raise LawFailure(
                f"t = {t:.6g} s: control law {name} gave {short(given.tolist())}; expected one finite number per "
                f"driven joint, shape ({self.joints},)"
            )
        return given.astype(np.float64)

    def note(self, number: int, t: float, q: Array, qd: Array) -> None:
        """Ask the law at the instant of step `number`, if it is one, and hold what it gives from there."""
        if number in self.instants:
            self.drive.coefficients[self.instants.index(number), 0] = self.torque(t, q, qd)

    def pieces(self, record: Record, run: Run, state: tuple[Array, Array, Array]) -> Iterator[int]:
        """Integrate; yields, about every `BREATH`, the number of the last step whose state is finite, at first 0.

        Raises
        ------
        LawFailure
            As in `torque`; the samples before that instant are there.
        """
        last, apart = (run.samples - 1) * run.steps_per_sample, self.instants.step
        advance, pace, number = self._sampled if self.every else self._continuous, Pace(), 0
        yield advance(record, run, state, 0, 0)
        while number < last:
            stop = min(number + apart, last)
            try:
                number = advance(record, run, state, number, stop)
                if number < stop:
                    yield number
                    return
                self.note(number, (self.origin + number) * run.step, *state[:2])
            except LawFailure:
                yield stop - 1
                raise
            if pace.over or number == last:
                yield number
                pace.start()

    def _sampled(self, record: Record, run: Run, state: tuple[Array, Array, Array], first: int, stop: int) -> int:
        fixed = record.scratch, method(run.method).arrays, record.inputs, run.step, record.origin
        samples = record.q, record.qd, record.works
        return int(integrate(*fixed, first, stop, run.steps_per_sample, state, samples))

    def _continuous(self, record: Record, run: Run, state: tuple[Array, Array, Array], first: int, stop: int) -> int:
        """As `integrate`, the law asked at every stage."""
        (A, b, c), h, inputs = method(run.method).arrays, run.step, record.inputs
        (q, qd, work), (L, K) = state, np.zeros((2, len(c), self.chain.n))
        for number in range(self.origin + first, self.origin + stop):
            for i in range(len(c)):
                t, Q, L[i] = (number + c[i]) * h, q + h * A[i, :i] @ L[:i], qd + h * A[i, :i] @ K[:i]
                follow(inputs.motion, t, Q, L[i], K[i])
                work += h * b[i] * stage(record.scratch, inputs, t, Q, L[i], self._spread(t, Q, L[i]), K[i])
            q += h * b @ L
            qd += h * b @ K
            follow(inputs.motion, (number + 1) * h, q, qd, K[0])
            if not np.isfinite([q, qd]).all():
                return number - self.origin
            row, left = divmod(number + 1 - self.origin, run.steps_per_sample)
            if not left:
                record.q[row], record.qd[row], record.works[row] = q, qd, work[0]
        return stop

    def _spread(self, t: float, q: Array, qd: Array) -> Array:
        tau = np.zeros(self.chain.n)
        tau[self.chain.active] = self.torque(t, q, qd)
        return tau


def steps_between(rate: float, run: Run) -> int:
    """Number of steps between two samples of a law, taken `rate` times a second.

    Raises
    ------
    ArgumentError
        The time between is no multiple of the step.
    """
    between = 1 / positive("rate", rate)
    steps = round(between / run.step)
    if steps < 1 or abs(between / run.step - steps) > 1e-9 * steps:
        raise ArgumentError(
            f"rate = {rate!r}: 1 / rate = {between:.6g} s must be a multiple of run.step = {run.step!r} s"
        )
    return steps


def control_of(scene: Scene, chain: Chain, law: Law | None, rate: float | None) -> Control | None:
    """The law of a run, checked, or None.

    Raises
    ------
    ArgumentError
        It cannot be called, the scene has a drive, too, the rate does not fit the step, or steps are not those that a
        law can be asked in.
    """
    callable_or_none("control", law)
    if law is None:
        if rate is not None:
            raise ArgumentError(f"rate = {rate!r}: there is no control to be sampled")
        return None
    run = scene.run
    if scene.drive.kind != "none":
        raise ArgumentError(f"control: the scene has a drive, {scene.drive.kind!r}, too; drop one of both")
    if not steps_explicitly(run):
        raise ArgumentError(f"control: method = {run.method!r}: a law takes fixed steps of an explicit method")
    return Control(law, rate, scene, chain)
