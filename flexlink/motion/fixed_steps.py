"""Fixed steps of an explicit Runge-Kutta method, t = k · step, taken in chunks between which Python checks samples."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion.budget import ChunkSize, Reached
from flexlink.results.record import Arrays, Record
from flexlink.results.samples import Steps
from flexlink.results.stop_reasons import Failure

if TYPE_CHECKING:
    from flexlink.motion.sampled_control import Control

Lanes = tuple[Any, Inputs, Arrays, Arrays]
"""Workspace, inputs, state (n, 8) and samples (rows, n, 8) of eight runs that are integrated side by side."""


class FixedSteps:
    """Stepper of a run, or of eight runs side by side in `lanes`; if it ends early, `failure` gives the reason."""

    slow, so_far = (0, ""), (0.0, 0.0, 0.0)  # constant: only adaptive and implicit steps change these

    def __init__(self, record: Record, control: Control | None = None, lanes: Lanes | None = None) -> None:
        self.no_samples = *np.empty((2, 0, record.chain.n)), np.empty(0)
        self.start(record, control, lanes)

    def start(self, record: Record, control: Control | None = None, lanes: Lanes | None = None) -> None:
        """Start from the first sample of a record."""
        self.record, self.run, self.origin = record, record.run, record.origin
        self.tableau = method(record.run.method).arrays
        self.failure: Failure | None = None
        self._inputs: Inputs | None = None  # the inputs that `_go` is compiled for
        record.begin()
        if lanes is None:
            start = record.q[0].copy(), record.qd[0].copy(), np.zeros(1)
            lanes = record.scratch, record.inputs, start, (record.q, record.qd, record.works)
        self.scratch, inputs, self.state, samples = lanes
        self._fixed = self.scratch, self.tableau, inputs, self.run.fixed_step, self.origin
        self._rest, self._done, self._control = (self.run.steps_per_sample, self.state, samples), 0, None
        if control is not None:  # each first call compiles while signals are not deferred
            self._control = control.pieces(record, self.run, self.state)
            self._done = next(self._control)
            return
        self._steps = record.kept(
            "fixed steps", self.state[0].ndim, lambda: direct(integrate, *self._fixed, 0, 0, np.inf, *self._rest)
        )
        self._steps(*self._fixed, 0, 0, record.far, *self._rest)

    def __iter__(self) -> Iterator[Reached]:
        """Integrate in chunks of about `BREATH`; state and samples are filled in place. See `integrate`."""
        done, last = 0, (self.run.samples - 1) * self.run.steps_per_sample
        yield 1, 0.0 if last else 1.0
        if self._control is not None:
            yield from (self._reached(done, last) for done in self._control)
            return
        pace = ChunkSize(self.record.chain.n)
        while done < last:
            stop = min(done + pace.start(), last)
            done = self.record.advance(self._steps, self._fixed, done, stop, self._rest)
            if pace.end() or done < stop or stop == last:
                yield self._reached(done, last)
            if done < stop:
                return

    def _reached(self, done: int, last: int) -> Reached:
        """Note the number of the last step with a finite state, and a state that is not finite."""
        self._done, (q, qd, _) = done, self.state
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            self.failure = self._not_finite()
        return done // self.run.steps_per_sample + 1, done / last

    def go(self, inputs: Inputs, start: float, end: float) -> Failure | None:
        """Integrate from `start` to `end` [s] under these inputs; return the failure, if any."""
        h, origin = self.run.fixed_step, self.origin
        first, last = round(start / h) - origin, round(end / h) - origin
        fixed, rest = (self.scratch, self.tableau, inputs, h, origin), (NEVER, self.state, self.no_samples)
        if inputs is not self._inputs:
            self._inputs, self._go = inputs, direct(integrate, *fixed, first, last, self.record.far, *rest)
        self._done = self.record.advance(self._go, fixed, first, last, rest)
        return None if self._done == last else self._not_finite()

    def saved(self) -> Any:
        """Copy of everything that `go` changes, for `restore`."""
        base = self.record.base.saved() if self.record.base is not None else None
        return *(array.copy() for array in self.state), base, self._done

    def restore(self, saved: Any) -> None:
        """Return to a `saved` state."""
        *arrays, base, self._done = saved
        if self.record.base is not None:
            self.record.base.restore(base, self.scratch)
        for array, before in zip(self.state, arrays, strict=True):
            array[:] = before

    @property
    def steps(self) -> Steps:
        """Step counts so far."""
        return steps_up_to(self.run, self._done)

    @property
    def methods(self) -> tuple[tuple[int, str, str]]:
        """The method, with the index of its first sample."""
        return ((0, self.run.method, ""),)

    def steps_before(self, row: int) -> Steps:
        """Step counts up to a sample."""
        return steps_up_to(self.run, row * self.run.steps_per_sample)

    @property
    def time(self) -> float:
        """Time reached [s]."""
        return (self.origin + self._done) * self.run.fixed_step

    def _not_finite(self) -> Failure:
        (q, qd, _), step = self.state, self._done + 1
        finite = (np.isfinite(q) & np.isfinite(qd)).reshape(len(q), -1).all(axis=1)
        joint = self.record.chain.joint_name(int(np.argmin(finite)))
        time = (self.origin + step) * self.run.fixed_step
        return Failure(f"the state is no longer finite at t = {time:.6g} s (step {step}, joint {joint!r})")


def steps_up_to(run: RunSettings, number: int) -> Steps:
    """Step counts after a number of steps."""
    return Steps(run.method, number, number * method(run.method).stages)
