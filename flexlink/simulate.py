"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in pieces between which Python may look up."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.dynamics import solver_for
from flexlink.errors import ArgumentError, DivergenceError, InterruptedRunError, SceneError
from flexlink.inputs import input_arrays
from flexlink.interruption import deferred
from flexlink.kernels.runge_kutta import integrate
from flexlink.scene import Run, Scene
from flexlink.stability import fastest_eigenvalues, stable_step_of
from flexlink.tableaus import tableau
from flexlink.trajectory import Trajectory

Array = NDArray[np.float64]
BREATH = 0.1  # time between two looks at signals and the terminal [s]


def simulate(scene: Scene, progress: Callable[[float], None] | None = None, **overrides: Any) -> Trajectory:
    """Integrate the equation of motion M q̈ + T_GC + T_FL + T_FR = T_EX from the scene's initial state.

    Explicit Runge-Kutta with a fixed step, t = k · step (paper, equations 5 to 12).

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.
    progress
        Called with the finished fraction, now and then: 0 when everything is compiled and the run starts, 1 at its end.
    **overrides
        Replace fields of `scene.run` for this run: method, step, duration, sample, dynamics.

    Returns
    -------
    Trajectory
        Samples at t = 0, sample, 2 · sample, … duration.

    Raises
    ------
    ArgumentError
        An override that is not a run setting.
    SceneError
        A run setting with a value that is not allowed.
    DivergenceError
        The state left the finite numbers; the error's `trajectory` holds the samples up to there.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `trajectory` holds the samples up to there.
    """
    scene = _override(scene, overrides)
    run, chain = scene.run, scene.chain()
    try:
        times, q, qd = run.times, *np.empty((2, run.samples, chain.n))
    except (MemoryError, ValueError):  # ValueError: more than numpy can count
        raise SceneError(
            f"run.sample = {run.sample!r}: {run.samples} samples of {chain.n} joints do not fit into memory"
        ) from None
    q[0], qd[0] = scene.initial_state(chain)
    inputs = input_arrays(scene, chain)
    method = tableau(run.method).arrays
    work = solver_for(chain, run.dynamics).workspace(chain.arrays)
    arrays = chain.arrays, work, method, *inputs, run.step
    integrate(*arrays, 0, run.steps_per_sample, q[:1], qd[:1])  # compiles, while no signal is deferred
    Trajectory.from_states(scene, chain, times[:1], q[:1], qd[:1])
    kept = 1
    with deferred() as stop:
        try:
            for kept, fraction in _pieces(scene, chain, arrays, q, qd):  # noqa: B007  used below
                if progress is not None:
                    progress(fraction)
                if stop.asked:
                    break
        except KeyboardInterrupt:  # of a caller's own handler, or of its `progress`
            stop.signal = signal.SIGINT
        if stop.signal is not None:
            raise InterruptedRunError(_first(kept, scene, chain, q, qd), stop.signal)
        trajectory = Trajectory.from_states(scene, chain, times, q, qd)
        if stop.signal is not None:
            raise InterruptedRunError(trajectory, stop.signal)
    return trajectory


def _pieces(scene: Scene, chain: Chain, arrays: Any, q: Array, qd: Array) -> Iterator[tuple[int, float]]:
    """Fill `q`, `qd`; now and then yield how many samples are finished, and which fraction of the run."""
    run, pace, done = scene.run, 1, 0
    part_q, part_qd = q[[0, 0]], qd[[0, 0]]  # row 0: where a piece within a sample starts, row 1: where it ends
    stride, total = run.steps_per_sample, (run.samples - 1) * run.steps_per_sample
    yield 1, 0.0
    while done < total:
        started = time.perf_counter()
        row, inside = divmod(done, stride)
        rows = slice(row, row + 1 + min(pace // stride, run.samples - 1 - row))
        if inside == 0 and pace >= stride:
            wanted = (rows.stop - 1 - row) * stride
            reached = integrate(*arrays, done, stride, q[rows], qd[rows])
        else:
            wanted = min(pace, stride - inside)
            part_q[0], part_qd[0] = (part_q[1], part_qd[1]) if inside else (q[row], qd[row])
            reached = integrate(*arrays, done, wanted, part_q, part_qd)
            if inside + wanted == stride or reached < wanted:
                q[row + 1], qd[row + 1] = part_q[1], part_qd[1]
        done += reached
        if reached < wanted:
            raise _diverged(scene, chain, q, qd, done)
        pace = max(1, min(2 * pace, int(wanted * BREATH / max(time.perf_counter() - started, 1e-9))))
        yield done // stride + 1, done / total


def _first(kept: int, scene: Scene, chain: Chain, q: Array, qd: Array) -> Trajectory:
    """The first samples of a run that ended early."""
    return Trajectory.from_states(scene, chain, *(array[:kept].copy() for array in (scene.run.times, q, qd)))


def _override(scene: Scene, overrides: dict[str, Any]) -> Scene:
    for name in overrides:
        if name not in Run.__struct_fields__:
            raise ArgumentError(f"{name}: not a run setting; allowed are {', '.join(Run.__struct_fields__)}")
    return msgspec.structs.replace(scene, run=msgspec.structs.replace(scene.run, **overrides))


def _diverged(scene: Scene, chain: Chain, q: Array, qd: Array, steps: int) -> DivergenceError:
    run = scene.run
    last = (steps - 1) // run.steps_per_sample  # number of the last finite sample; the next row is the bad state
    bad = ~(np.isfinite(q[last + 1]) & np.isfinite(qd[last + 1]))
    joint = chain.joint_name(int(np.argmax(bad)))
    λ = fastest_eigenvalues(chain, q[0])
    ω, h = np.abs(λ).max(initial=0.0), stable_step_of(λ, run.method)
    return DivergenceError(
        f"{chain.name}: no longer finite at t = {steps * run.step:.6g} s (step {steps}, joint {joint!r}); "
        f"omega_max * step = {ω * run.step:.3g}, largest stable step of {run.method} is {h:.3g} s "
        f"(got {run.step:.3g} s); {last + 1} samples kept",
        _first(last + 1, scene, chain, q, qd),
    )
