"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in pieces between which Python looks up."""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.arguments import callable_or_none, given
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import SceneError
from flexlink.common.interruption import Stop, deferred
from flexlink.describe.methods import check_method
from flexlink.describe.scene import Scene
from flexlink.describe.situation import Dynamics, Unstable
from flexlink.kernels.runge_kutta import integrate
from flexlink.motion.actuation import input_arrays
from flexlink.motion.endings import InterruptedRunError
from flexlink.motion.result import Record, Trajectory
from flexlink.motion.start import initial_state
from flexlink.motion.watch import Watch, judge_step

Array = NDArray[np.float64]
Arrays = tuple[Array, Array, Array]
"""q, q̇ and W."""
BREATH = 0.1  # time between two looks at the samples, at signals and the terminal [s]


def simulate(
    scene: Scene,
    *,
    progress: Callable[[float], None] | None = None,
    method: str | None = None,
    step: float | None = None,
    duration: float | None = None,
    sample: float | None = None,
    dynamics: Dynamics | None = None,
    unstable: Unstable | None = None,
) -> Trajectory:
    """Integrate the equation of motion M q̈ + T_GC + T_FL + T_FR = T_EX from the scene's initial state.

    Explicit Runge-Kutta with a fixed step, t = k · step (paper, equations 5 to 12). The run judges itself: its step
    before it starts, and each sample by the power balance E(t) − E(0) = W(t).

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.
    progress
        Called with the finished fraction, now and then: 0 when everything is compiled and the run starts, 1 at its end.
    method, step, duration, sample, dynamics, unstable
        In place of those of `scene.run`, times in s; None: as the scene says.

    Returns
    -------
    Trajectory
        Samples at t = 0, sample, 2 · sample, … duration.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, or `progress` no function.
    SceneError
        A run setting with a value that is not allowed.
    UnstableStepError
        The step is larger than the largest stable one at the start (`stable_step`); unstable = "allow" insists.
    DivergenceError
        The state left the finite numbers, or the energy does not balance by more than a tenth of what was exchanged;
        the error's `trajectory` holds the good samples.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `trajectory` holds the samples up to there.
    """
    callable_or_none("progress", progress)
    settings = {
        "method": method, "step": step, "duration": duration, "sample": sample,
        "dynamics": dynamics, "unstable": unstable,
    }  # fmt: skip
    said = {f"run.{name}": value for name, value in settings.items() if value is not None}
    run = SingleRun(given("scene", scene, Scene).varied(said) if said else scene)
    with deferred() as stop:
        return run.finish(stop, progress)


class SingleRun:
    """A run that is judged and compiled, and has not started; errors as in `simulate`."""

    def __init__(self, scene: Scene, watch: Watch | None = None) -> None:
        self.watch = prepare(scene, lump(scene)) if watch is None else watch
        record = self.watch.record
        self.state = record.q[0].copy(), record.qd[0].copy(), np.zeros(1)
        samples = record.q, record.qd, record.works
        self.pieces = pieces(self.watch, record.scratch, self.state, samples)
        next(self.pieces)  # compiles, while no signal is deferred

    def finish(self, stop: Stop, progress: Callable[[float], None] | None = None) -> Trajectory:
        """Run to the end, or to where it is stopped."""
        watch, told = self.watch, progress or (lambda _: None)
        steps = (watch.run.samples - 1) * watch.run.steps_per_sample
        try:
            for done in itertools.chain([0], self.pieces):
                if not watch.look(done // watch.run.steps_per_sample + 1) or not np.isfinite(self.state[:2]).all():
                    break
                told(done / steps if steps else 1.0)
                if stop.asked:
                    break
        except KeyboardInterrupt:  # of a caller's own handler, or of its `progress`
            stop.signal = signal.SIGINT
        if watch.fault or not np.isfinite(self.state[:2]).all():
            raise watch.diverged(done + 1, self.state)
        if stop.signal is not None:
            raise InterruptedRunError(watch.trajectory(), stop.signal)
        return watch.trajectory()


def prepare(scene: Scene, chain: Chain) -> Watch:
    """Room for the samples of a run, of which the first is filled, and its step judged.

    Raises
    ------
    SceneError
        The method is unknown or implicit, or the samples do not fit into memory.
    UnstableStepError
        As in `simulate`.
    """
    run, inputs = scene.run, input_arrays(scene, chain)
    check_method(run)
    try:
        record = Record(run, chain, inputs, run.times, *np.empty((2, run.samples, chain.n)))
    except (MemoryError, ValueError):  # ValueError: more than numpy can count
        raise SceneError(
            f"run.sample = {run.sample!r}: {run.samples} samples of {chain.n} joints do not fit into memory"
        ) from None
    record.q[0], record.qd[0] = start = initial_state(scene, chain)
    watch = Watch(run, record, judge_step(scene, chain, *start, inputs))
    watch.look(1)
    return watch


def pieces(watch: Watch, scratch: Any, state: Arrays, samples: Arrays) -> Iterator[int]:
    """Integrate in pieces of about `BREATH`; yields the number of the last step whose state is finite, at first 0.

    The state, and the samples, of one chain or, with their scratch, of eight side by side, are filled in place; see
    `integrate`.
    """
    run, record = watch.run, watch.record
    first, size, steps, every = 0, 1, (run.samples - 1) * run.steps_per_sample, run.steps_per_sample
    fixed = scratch, watch.tableau, record.inputs, run.step
    yield int(integrate(*fixed, 0, 0, every, state, samples))
    while first < steps:
        started, last = time.perf_counter(), min(first + size, steps)
        done = int(integrate(*fixed, first, last, every, state, samples))
        yield done
        if done < last:
            return
        first = last
        size = max(1, int(size * min(2.0, BREATH / max(time.perf_counter() - started, 1e-9))))
