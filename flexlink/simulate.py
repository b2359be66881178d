"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in pieces between which Python may look up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.checks import callable_or_none, given
from flexlink.dynamics import solver_for
from flexlink.errors import ArgumentError, DivergenceError, InterruptedRunError, SceneError
from flexlink.inputs import input_arrays
from flexlink.kernels.runge_kutta import integrate
from flexlink.scene import Run, Scene
from flexlink.spec import meant
from flexlink.stability import fastest_eigenvalues, stable_step_of
from flexlink.tableaus import tableau
from flexlink.trajectory import Trajectory

Array = NDArray[np.float64]
PIECES = 200  # progress is reported about this often


def simulate(scene: Scene, progress: Callable[[float], None] | None = None, **overrides: Any) -> Trajectory:
    """Integrate the equation of motion M q̈ + T_GC + T_FL + T_FR = T_EX from the scene's initial state.

    Explicit Runge-Kutta with a fixed step, t = k · step (paper, equations 5 to 12).

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.
    progress
        Called with the finished fraction, from 0 to 1, now and then.
    **overrides
        Replace fields of `scene.run` for this run: method, step, duration, sample, dynamics.

    Returns
    -------
    Trajectory
        Samples at t = 0, sample, 2 · sample, … duration.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, `progress` no function, or an override no run setting.
    SceneError
        A run setting with a value that is not allowed.
    DivergenceError
        The state left the finite numbers; the error's `trajectory` holds the samples up to there.
    InterruptedRunError
        Ctrl-C; its `trajectory` holds the samples up to there.
    """
    callable_or_none("progress", progress)
    scene = _override(given("scene", scene, Scene), overrides)
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
    piece = max(1, (run.samples - 1) // PIECES)
    start = 0  # number of the last finished sample
    try:
        while start < run.samples - 1:
            rows = slice(start, min(start + piece + 1, run.samples))
            wanted = (rows.stop - 1 - start) * run.steps_per_sample
            first = start * run.steps_per_sample
            done = integrate(
                chain.arrays, work, method, *inputs, run.step, first, run.steps_per_sample, q[rows], qd[rows]
            )
            if done < wanted:
                raise _diverged(scene, chain, q, qd, first + done)
            start = rows.stop - 1
            if progress is not None:
                progress(start / (run.samples - 1))
    except KeyboardInterrupt:
        raise InterruptedRunError(_first(start + 1, scene, chain, q, qd)) from None
    return Trajectory.from_states(scene, chain, times, q, qd)


def _first(kept: int, scene: Scene, chain: Chain, q: Array, qd: Array) -> Trajectory:
    """The first samples of a run that ended early."""
    return Trajectory.from_states(scene, chain, *(array[:kept].copy() for array in (scene.run.times, q, qd)))


def _override(scene: Scene, overrides: dict[str, Any]) -> Scene:
    for name in overrides:
        if name not in Run.__struct_fields__:
            allowed = Run.__struct_fields__
            raise ArgumentError(f"{name}: not a run setting; allowed are {', '.join(allowed)}{meant(name, allowed)}")
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
