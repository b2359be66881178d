"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in pieces between which Python may look up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.dynamics import solver_number
from flexlink.errors import ArgumentError, DivergenceError
from flexlink.kernels.runge_kutta import integrate
from flexlink.modal import largest_frequency, stable_step
from flexlink.scene import Run, Scene, spread
from flexlink.tableaus import tableau
from flexlink.trajectory import Trajectory

Array = NDArray[np.float64]
PIECES = 200  # progress is reported about this often


class DriveArrays(NamedTuple):
    """What the kernel sees of a drive: T_EX = table(t) + kp (target − q) − kd q̇."""

    times: Array  # (m,) [s]
    torques: Array  # (m, n) [N m]
    kp: Array  # (n,) [N m/rad]
    kd: Array  # (n,) [N m s/rad]
    target: Array  # (n,) [rad]


def drive_arrays(scene: Scene, chain: Chain) -> DriveArrays:
    """The scene's drive in sequential order, zeros where it has nothing to say."""
    drive = scene.drive
    zero = (0.0,) * len(scene.arm.links)
    rows = drive.torques or (drive.torque or zero,)
    return DriveArrays(
        np.array(drive.times or (0.0,)),
        np.array([spread(chain, row) for row in rows]),
        spread(chain, drive.kp or zero),
        spread(chain, drive.kd or zero),
        np.radians(spread(chain, drive.target_deg or zero)),
    )


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
        An override that is not a run setting.
    SceneError
        A run setting with a value that is not allowed.
    DivergenceError
        The state left the finite numbers; the error's `trajectory` holds the samples up to there.
    """
    run = _override(scene.run, overrides)
    chain = scene.chain()
    q, qd = np.empty((run.samples, chain.n)), np.empty((run.samples, chain.n))
    q[0], qd[0] = scene.initial_state(chain)
    method, drive, wrench = tableau(run.method).arrays, drive_arrays(scene, chain), scene.tip_wrench
    solver = solver_number(chain, run.dynamics)
    piece = max(1, (run.samples - 1) // PIECES)
    for start in range(0, run.samples - 1, piece):
        rows = slice(start, min(start + piece + 1, run.samples))
        wanted = (rows.stop - 1 - start) * run.steps_per_sample
        first = start * run.steps_per_sample
        done = integrate(
            chain.arrays, solver, method, drive, wrench, run.step, first, run.steps_per_sample,
            q[rows], qd[rows],
        )  # fmt: skip
        if done < wanted:
            raise _diverged(chain, run, q, qd, first + done)
        if progress is not None:
            progress((rows.stop - 1) / (run.samples - 1))
    return _trajectory(chain, run, q, qd)


def _trajectory(chain: Chain, run: Run, q: Array, qd: Array) -> Trajectory:
    t = np.arange(len(q), dtype=np.float64) * (run.steps_per_sample * run.step)
    return Trajectory.from_states(chain, t, q, qd)


def _override(run: Run, overrides: dict[str, Any]) -> Run:
    for name in overrides:
        if name not in Run.__struct_fields__:
            raise ArgumentError(f"{name}: not a run setting; allowed are {', '.join(Run.__struct_fields__)}")
    return msgspec.structs.replace(run, **overrides)


def _diverged(chain: Chain, run: Run, q: Array, qd: Array, steps: int) -> DivergenceError:
    last = (steps - 1) // run.steps_per_sample  # number of the last finite sample; the next row is the bad state
    bad = ~(np.isfinite(q[last + 1]) & np.isfinite(qd[last + 1]))
    joint = chain.joint_name(int(np.argmax(bad)))
    ω, h = largest_frequency(chain, q[0]), stable_step(chain, run.method, q[0])
    return DivergenceError(
        f"{chain.name}: no longer finite at t = {steps * run.step:.6g} s (step {steps}, joint {joint!r}); "
        f"omega_max * step = {ω * run.step:.3g}, largest stable step of {run.method} is {h:.3g} s "
        f"(got {run.step:.3g} s); {last + 1} samples kept",
        _trajectory(chain, run, q[: last + 1].copy(), qd[: last + 1].copy()),
    )
