"""compare_trajectories(scene) → TrajectoryComparison: the same run in several engines, with the same method and steps.

Two correct programs differ by rounding errors, which the motion may amplify. A cross-check estimates the amplification:
it repeats our run with another solver of the forward dynamics. It is computed only if an engine differs by more than
rounding errors, since it takes as long as our run and its kernels may not be compiled yet.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.arguments import positive, require_each, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, FlexlinkError, MissingDependencyError, SceneError
from flexlink.common.notebook import html_lines
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.dynamics.forces import Gains
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.engines import ENGINES, load
from flexlink.formats.tied import spring_gains
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory

ANGLE_TOLERANCE = 1e-9
"""Largest difference of an angle between runs that agree [rad]; two million rounding errors at 3 rad add up to this."""

CROSS_CHECK_FACTOR = 100.0
"""Allowed difference of an engine, relative to the difference in the cross-check. Other programs have larger rounding
errors (up to 8 times for the scenes in `models/`): numbers in files are decimal, and M is computed in another way."""

MEANINGFUL_TOLERANCE = 1e-3
"""Largest angle tolerance at which agreement is meaningful [rad]; a wrong parameter could change the angle by less."""


class RunDifference(NamedTuple):
    """Largest differences between the runs of an engine and of flexlink at any sample."""

    engine: str
    q: float  # largest |Δq| [rad]
    qd: float  # largest |Δq̇| [rad/s]
    tip: float  # largest distance between the tips [m]
    time: float  # time of the largest |Δq| [s]
    joint: str  # joint with the largest |Δq|
    explained: float  # largest |Δq| that counts as agreement [rad]
    diverged: str = ""  # message of the engine if its run ended early; only the samples before that are compared

    @property
    def passed(self) -> bool:
        """Whether the runs agree."""
        return self.q <= self.explained and not self.diverged


@dataclasses.dataclass(frozen=True, repr=False)
class TrajectoryComparison:
    """A `RunDifference` for every engine that can run the scene, and why others cannot; printed as a table."""

    scene: str
    steps: str
    rows: tuple[RunDifference, ...]
    refused: tuple[str, ...]

    def __repr__(self) -> str:
        agree = sum(row.passed for row in self.rows)
        return f"<TrajectoryComparison {self.scene!r}: {agree} of {len(self.rows)} engines agree>"

    @property
    def passed(self) -> bool:
        """Whether every run agrees with ours."""
        return all(row.passed for row in self.rows)

    def _repr_html_(self) -> str:
        return html_lines(str(self))

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self.steps}; largest differences from flexlink"]
        titles = ("|Δq| [rad]", "|Δq̇| [rad/s]", "|Δtip| [m]", "|Δq| allowed")
        widths = [16 + title.count("\u0307") for title in titles]  # combining dots have no width
        heads = "".join(f"{title:<{width}}" for title, width in zip(titles, widths, strict=True))
        lines.append(f"{'engine':<12}{heads}{'':<8}worst joint")
        for row in self.rows:
            numbers = "".join(f"{number:<16.2g}" for number in (row.q, row.qd, row.tip, row.explained))
            verdict = "ok" if row.passed else "FAILED"
            lines.append(f"{row.engine:<12}{numbers}{verdict:<8}{row.joint} at t = {row.time:g} s")
        lines += [f"{row.engine}: {row.diverged}" for row in self.rows if row.diverged]
        if any(row.explained > MEANINGFUL_TOLERANCE for row in self.rows):
            means = "this motion amplifies errors so much that agreement means little; compare a shorter run"
            lines.append(f"warning: {means}")
        return "\n".join([*lines, *(f"not compared: {reason}" for reason in self.refused)])


def compare_trajectories(
    scene: Scene, *, engines: Sequence[str] | None = None, duration: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> TrajectoryComparison:  # fmt: skip
    """Simulate a scene with all its loads and motions in several engines, and compare them with flexlink.

    All engines take the same steps: the scene's steps if they are fixed steps of an explicit method, otherwise stable
    RK4 steps. An engine agrees if all angles differ by at most 1e-9 rad, or by at most 100 times the difference between
    two of our solvers, since a sensitive motion amplifies rounding errors. With ties all engines then take half of
    these steps, with which angles may differ by twice what halving changes in both runs.

    Parameters
    ----------
    scene
        The scene; an engine loads its arm from the text of an exported file.
    engines
        Names in `flexlink.engines.ENGINES`. Default: all installed engines; engines that cannot run the scene are then
        omitted, and listed in the result.
    duration
        Simulated time [s], which replaces the scene's.
    progress
        Called with the finished fraction, from 0 to 1.

    Returns
    -------
    TrajectoryComparison
        Largest differences of angles, rates and tip for every engine, and their time; printed as a table.

    Raises
    ------
    ArgumentError, SceneError
        `scene` is not a Scene, an engine is unknown, or one of `engines` (default: every engine) cannot run the scene.
    MissingDependencyError
        One of `engines` is not installed (default: none is).
    DivergenceError, UnstableStepError
        Our own run fails, as in `simulate`.

    Examples
    --------
    >>> found = fl.compare_trajectories(scene, engines=["mujoco"], duration=0.05)
    >>> print(found.passed)
    True
    """
    require_type("scene", scene, Scene)
    if duration is not None:
        scene = scene.varied({"run.duration": positive("duration", duration)})
    named = None if engines is None else require_each("engines", engines, str)
    chain, report = lump(open_chain(scene)), progress or (lambda _: None)
    scene, steps = in_fixed_steps(scene, chain)
    coarse = simulate(scene) if scene.ties else None
    if coarse is not None:
        steps, scene = f"{steps}, and half of it", scene.varied({"run.step": scene.run.fixed_step / 2})
    names = [name for name in ENGINES if name != "native"] if named is None else named
    ours = simulate(scene)
    rows, refused, missing = list[RunDifference](), list[str](), None
    for k, name in enumerate(names):
        report(k / len(names))
        try:
            rows.append(_difference(ours, scene, name, coarse))
        except (MissingDependencyError, ArgumentError, SceneError) as error:
            if named is not None:
                raise
            if isinstance(error, MissingDependencyError):
                missing = error
            else:
                refused.append(f"{name}: {error}")
    report(1.0)
    if not rows and refused:
        raise ArgumentError(f"engines: no engine can run {scene.name!r}: {'; '.join(refused)}", id="no-engine")
    if not rows and missing is not None:
        raise missing
    if coarse is None and any(row.q > ANGLE_TOLERANCE for row in rows):
        allowed = max(ANGLE_TOLERANCE, CROSS_CHECK_FACTOR * _cross_check(scene, ours))
        rows = [row._replace(explained=allowed) for row in rows]
    return TrajectoryComparison(scene.name, steps, tuple(rows), tuple(refused))


def in_fixed_steps(scene: Scene, chain: Chain) -> tuple[Scene, str]:
    """The scene with fixed steps of an explicit method, and a text that describes these steps."""
    run = scene.run
    over = f"{run.duration:g} s in"
    if steps_explicitly(run):
        return scene, f"{over} {run.method} steps of {run.fixed_step:g} s"
    problem = problem_of(scene, chain, tied=True)
    state = problem.q, problem.qd
    acting = acting_at(problem.inputs, chain, problem.start, *state)
    if scene.ties:
        kp, kd = (a + b for a, b in zip(acting["gains"].matrices(), spring_gains(scene, problem.q), strict=True))
        acting["gains"] = Gains(kp, kd)
    stable = stable_step(chain, *state, method="RK4", **acting)
    whole = min(run.spacing, 1 / (scene.drive.rate or 1 / run.spacing)) if run.controlled else run.fixed_step
    step = whole / max(1, math.ceil(whole / (0.5 * stable)))  # half, since the limit changes less in the motion
    fixed = scene.varied({"run.method": "RK4", "run.step": step, "run.sample": run.spacing})
    given = f"a tolerance, {run.method}" if run.controlled else f"{run.method} steps of {run.fixed_step:g} s"
    return fixed, f"{over} RK4 steps of {step:g} s, {step / stable:.2g} of the stability limit (the scene has {given})"


def _cross_check(scene: Scene, ours: Trajectory) -> float:
    """Largest difference between our run and a run with another solver [rad]; 0 if the other run fails."""
    other = "articulated" if scene.run.solver == "lu" else "lu"
    try:
        return float(np.abs(simulate(scene, solver=other).q - ours.q).max(initial=0.0))  # type: ignore[arg-type]
    except FlexlinkError:
        return 0.0


def _difference(ours: Trajectory, scene: Scene, name: str, coarse: Trajectory | None) -> RunDifference:
    """Differences between an engine's run and ours; if the engine diverges, only earlier samples are compared."""
    diverged, allowed, ties = "", ANGLE_TOLERANCE, scene if scene.ties else None
    try:
        _, q, qd = load(name, ours.chain, ties=ties).integrate(scene)
        if coarse is not None and coarse.scene is not None:
            change = load(name, ours.chain, ties=coarse.scene).integrate(coarse.scene)[1] - q  # ≥ what O(h) leaves
            allowed += 2 * float(np.abs(change).max() + np.abs(coarse.q - ours.q).max())
    except DivergenceError as error:
        diverged, q, qd = str(error), error.trajectory.q, error.trajectory.qd
    rows = slice(len(q))
    angles = np.abs(q - ours.q[rows])
    row, joint = np.unravel_index(int(angles.argmax()), angles.shape)
    return RunDifference(
        name, float(angles.max()), float(np.abs(qd - ours.qd[rows]).max()),
        float(np.linalg.norm(tip_position(ours.chain, q) - ours.tip[rows], axis=1).max()), float(ours.t[row]),
        ours.chain.joint_name(int(joint)), allowed, diverged,
    )  # fmt: skip
