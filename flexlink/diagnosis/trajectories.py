"""compare_trajectories(scene) → TrajectoryComparison: one run in several engines, step by step the same method.

Two right programs differ by rounding, which motion may multiply. How far that goes in this motion tells a twin: our own
run by LU decomposition of M, which rounds otherwise at every stage. It is asked where an engine is off by more than
rounding alone is: it takes as long as our run, and its kernels are otherwise not compiled.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.arguments import positive, require_each, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, FlexlinkError, MissingDependencyError
from flexlink.describe.conditions import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.engines import ENGINES, load
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.drives import gains_of
from flexlink.inputs.initial_state import initial_state
from flexlink.inputs.tip_wrench import wrench_at
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory

Array = NDArray[np.float64]

AGREE = 1e-9
"""Difference of an angle [rad] up to which runs agree: two million roundings of an angle of 3 rad, all one way."""

TWINS = 100.0
"""How many times the twin's difference may be another program's, which rounds more: files are written in decimals, and
M is set up, or solved, from other parts. Measured on the scenes of `models/` it is up to eight times."""

LITTLE = 1e-3
"""Difference of an angle [rad] that rounding may make from which agreement says little: a wrong number makes less."""

WITHIN = 0.5
"""Part of the largest stable step that is taken where the scene names no step of RK4: motion shifts it by less."""


class RunDifference(NamedTuple):
    """An engine's run beside ours: largest differences at any sample."""

    engine: str
    q: float  # [rad]
    qd: float  # [rad/s]
    tip: float  # [m]
    time: float  # of the largest |Δq| [s]
    joint: str  # … and whose it is
    explained: float  # largest |Δq| that agrees [rad]
    diverged: str = ""  # what the engine says of a run that ended early, of which the samples up to there count

    @property
    def passed(self) -> bool:
        """The runs agree."""
        return self.q <= self.explained and not self.diverged


@dataclasses.dataclass(frozen=True, repr=False)
class TrajectoryComparison:
    """A `RunDifference` for every engine that can run the scene, and why others cannot; prints as a table."""

    scene: str
    steps: str
    rows: tuple[RunDifference, ...]
    refused: tuple[str, ...]

    def __repr__(self) -> str:
        agree = sum(row.passed for row in self.rows)
        return f"<TrajectoryComparison {self.scene!r}: {agree} of {len(self.rows)} engines agree>"

    @property
    def passed(self) -> bool:
        """Every run agrees with ours."""
        return all(row.passed for row in self.rows)

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self.steps}; largest differences from native"]
        titles = ("|Δq| [rad]", "|Δq̇| [rad/s]", "|Δtip| [m]", "agrees up to")
        lines.append(
            f"{'engine':<12}" + "".join(f"{title:<{_width(title)}}" for title in titles) + f"{'':<8}worst joint"
        )
        for row in self.rows:
            numbers = "".join(f"{number:<16.2g}" for number in (row.q, row.qd, row.tip, row.explained))
            verdict = "ok" if row.passed else "FAILED"
            lines.append(f"{row.engine:<12}{numbers}{verdict:<8}{row.joint} at t = {row.time:g} s")
        lines += [f"{row.engine}: {row.diverged}" for row in self.rows if row.diverged]
        if any(row.explained > LITTLE for row in self.rows):
            lines.append(
                "doubtful: this motion multiplies rounding so far that agreement says little; compare a shorter run"
            )
        return "\n".join([*lines, *(f"not compared: {reason}" for reason in self.refused)])


def _width(title: str) -> int:
    return 16 + title.count("\u0307")  # a character that takes no room


def compare_trajectories(
    scene: Scene,
    *,
    engines: Sequence[str] | None = None,
    duration: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> TrajectoryComparison:
    """Run a scene in several engines with its drive, tip wrench, friction and motions, and compare with our own run.

    All take the same steps, the scene's own if they are fixed ones of an explicit method, else RK4 at a stable step. An
    engine agrees if no angle is off by more than 1e-9 rad, or, where one is, than a hundred times what our own run by
    another algorithm is off: motion that multiplies errors multiplies rounding, too.

    Parameters
    ----------
    scene
        The scene; an engine gets its arm as the text of an exported file.
    engines
        Names that `flexlink.engines.load` knows; by default all that are installed, without those that cannot run this
        scene, which the result names with the reason.
    duration
        Simulated time [s] in place of the scene's.
    progress
        Called with the finished fraction, from 0 to 1, now and then.

    Returns
    -------
    TrajectoryComparison
        For every engine the largest differences of angles, rates and the tip's place, and when; prints as a table.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, an engine is unknown, or of the engines named one cannot run this scene, or of
        all others none.
    MissingDependencyError
        An engine that is named, or all others, are not installed.
    DivergenceError, UnstableStepError
        Of our own run, as in `simulate`.
    """
    require_type("scene", scene, Scene)
    if duration is not None:
        scene = scene.varied({"run.duration": positive("duration", duration)})
    named = None if engines is None else require_each("engines", engines, str)
    chain, told = lump(scene), progress or (lambda _: None)
    scene, steps = in_fixed_steps(scene, chain)
    names = [name for name in ENGINES if name != "native"] if named is None else named
    ours = simulate(scene)
    rows: list[RunDifference] = []
    refused: list[str] = []
    missing: MissingDependencyError | None = None
    for k, name in enumerate(names):
        told(k / len(names))
        try:
            rows.append(_beside(ours, scene, name))
        except MissingDependencyError as error:
            missing = error
            if named is not None:
                raise
        except ArgumentError as error:
            refused.append(f"{name}: {error}")
            if named is not None:
                raise
    told(1.0)
    if not rows and refused:
        raise ArgumentError(f"engines: none can run {scene.name!r}: {'; '.join(refused)}")
    if not rows and missing is not None:
        raise missing
    if any(row.q > AGREE for row in rows):
        allowed = max(AGREE, TWINS * _twin(scene, ours))
        rows = [row._replace(explained=allowed) for row in rows]
    return TrajectoryComparison(scene.name, steps, tuple(rows), tuple(refused))


def in_fixed_steps(scene: Scene, chain: Chain) -> tuple[Scene, str]:
    """The scene in steps that other engines take, and words for them."""
    run = scene.run
    over = f"{run.duration:g} s in"
    if steps_explicitly(run):
        return scene, f"{over} {run.method} steps of {run.step:g} s"
    inputs, state = input_arrays(scene, chain), initial_state(scene, chain)
    wrench, frame = wrench_at(inputs, scene.initial.time)
    gains = gains_of(chain, inputs.drive, scene.initial.time, *state)
    stable = stable_step(chain, *state, tip_wrench=wrench, frame=frame, gains=gains, method="RK4")
    whole = min(run.sample, 1 / (scene.drive.rate or 1 / run.sample)) if run.controlled else run.step
    step = whole / math.ceil(whole / (WITHIN * stable))
    fixed = scene.varied({"run.method": "RK4", "run.step": step})
    kept = f"a tolerance, {run.method}" if run.controlled else f"{run.method} at {run.step:g} s"
    return fixed, f"{over} RK4 steps of {step:g} s, {step / stable:.2g} of the largest stable one (the scene: {kept})"


def _twin(scene: Scene, ours: Trajectory) -> float:
    """How far apart two of our own algorithms run [rad]; 0 where the other one does not come to the end."""
    other = "articulated" if scene.run.solver == "lu" else "lu"
    try:
        return float(np.abs(simulate(scene, solver=other).q - ours.q).max(initial=0.0))  # type: ignore[arg-type]
    except FlexlinkError:
        return 0.0


def _beside(ours: Trajectory, scene: Scene, name: str) -> RunDifference:
    """An engine's run beside ours, as if nothing multiplied rounding; of one that diverges the samples up to there."""
    diverged = ""
    try:
        _, q, qd = load(name, ours.chain).integrate(scene)
    except DivergenceError as error:
        diverged, q, qd = str(error), error.trajectory.q, error.trajectory.qd
    rows = slice(len(q))
    off = np.abs(q - ours.q[rows])
    row, joint = np.unravel_index(int(off.argmax()), off.shape)
    tips = tip_position(ours.chain, q)
    return RunDifference(
        name, float(off.max()), float(np.abs(qd - ours.qd[rows]).max()),
        float(np.linalg.norm(tips - ours.tip[rows], axis=1).max()), float(ours.t[row]),
        ours.chain.joint_name(int(joint)), AGREE, diverged,
    )  # fmt: skip
