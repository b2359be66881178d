"""Runs of a scene with one model or another, each once, counted, and with the steps that they take."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from flexlink.advice.evaluation_cost import bodies_of, evaluation_cost, run_cost
from flexlink.advice.model import Bend, Model, with_model
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.describe.conditions import InitialState, RunSettings
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.extremes import fastest_decay, fastest_frequency
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.drives import gains_of
from flexlink.motion.simulate import SingleRun, prepare
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory

Array = NDArray[np.float64]

POSTURES = 5
"""Along a run, at which the stable step is found: the initial one alone has diverged."""

OF_STABLE = 0.9
"""Part of the smallest of them that is taken."""

MOST_DIVISIONS = 1000
"""Of the time between samples, tried for steps on which every time of a held table falls."""

NUDGE = 10.0
"""Tolerances of its steps that a twin starts apart from a run, at least: well above what the steps themselves do."""

GROWN = 0.1
"""Part of the motion up to which two runs part in proportion to what they started with."""

REACH = 2.78
"""|h λ| up to which RK4 is stable, in whatever direction, within some per cent: for what is not run yet."""


class Stepping(NamedTuple):
    """Fixed steps of RK4 [s], or a tolerance [m] of a method."""

    method: str
    step: float | None = None
    tolerance: float | None = None

    def __str__(self) -> str:
        return f"{self.method}, {self.tolerance:.2g} m" if self.step is None else f"{self.method} {self.step:.3g} s"


class Outcome(NamedTuple):
    """What became of a run."""

    tip: Array  # (samples, 3) [m], nan from where it ended early
    seconds: float  # of CPU, by its evaluations
    run: Trajectory | None
    stepping: Stepping
    why: str = ""  # it ended early
    dear: bool = False  # because it would have taken more than the budget

    @property
    def whole(self) -> bool:
        """Whether it came to its end."""
        return not self.why


class TooLongError(FlexlinkError):
    """A run has used up its budget."""


class Posture(NamedTuple):
    """Of the joints at a time [s]: angles [rad] and rates [rad/s] by link."""

    time: float
    angles: dict[int, float]
    rates: dict[int, float]


class ModelRunner:
    """Runs of one scene; `count` and `seconds` of all of them."""

    def __init__(self, scene: Scene, budget: float) -> None:
        self.scene, self.budget = scene, budget
        self.count, self.seconds = 0, 0.0
        self.along: list[Posture] = []
        self._chains: dict[Model, Chain] = {}
        self._stable: dict[Model, float] = {}
        self._outcomes: dict[tuple[Model, Stepping], Outcome] = {}

    def chain(self, model: Model) -> Chain:
        """The scene's chain with a model."""
        if model not in self._chains:
            self._chains[model] = lump(with_model(self.scene, model))
        return self._chains[model]

    def scene_of(self, model: Model, stepping: Stepping) -> Scene:
        """The scene with a model and its steps, ready to run."""
        return replace(with_model(self.scene, model), run=self._settings(stepping))

    def _settings(self, stepping: Stepping) -> RunSettings:
        run = self.scene.run
        step = run.step if stepping.step is None else stepping.step
        return replace(
            run, method=stepping.method, step=step, tolerance=stepping.tolerance, relative_tolerance=None,
            accuracy="tip", dynamics="articulated", unstable="refuse",
        )  # fmt: skip

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        """Run it, unless it was run before."""
        if (model, stepping) not in self._outcomes:
            self._outcomes[model, stepping] = self._run(model, stepping)
        return self._outcomes[model, stepping]

    def twin(self, model: Model, stepping: Stepping, angle: float) -> Outcome | None:
        """The same with every joint that is free turned by an angle [rad] at the start; None if there is none."""
        scene = self.scene
        held = {scene.arm.number(motion.link) for motion in scene.motion}
        held |= {k for k, link in enumerate(scene.arm.links, 1) if link.joint.locked}
        if len(held) == len(scene.arm.links):
            return None
        turned = [q + (k not in held) * math.degrees(angle) for k, q in enumerate(scene.initial.joint_deg, 1)]
        return self.run_from(replace(scene.initial, joint_deg=tuple(turned)), model, stepping)

    def run_from(self, initial: InitialState, model: Model, stepping: Stepping) -> Outcome:
        """The same from somewhere else, run anew."""
        return self._run(model, stepping, initial)

    def _run(self, model: Model, stepping: Stepping, initial: InitialState | None = None) -> Outcome:
        tip = np.full((self.scene.run.samples, 3), np.nan)
        why, dear, run = "", False, None
        try:
            scene = self.scene_of(model, stepping)
            scene = scene if initial is None else replace(scene, initial=initial)
            with deferred() as stop:
                run = self._finish(SingleRun(scene, prepare(scene, self.chain(model))), stop)
        except DivergenceError as error:
            run, why = error.trajectory, str(error)
        except FlexlinkError as error:
            why, dear = str(error), isinstance(error, TooLongError)
        seconds = 0.0
        if run is not None and run.steps is not None:
            tip[: len(run.tip)] = run.tip
            seconds = run_cost(run.chain, run.steps.method, run.steps.evaluations)
        self.count += 1
        self.seconds += seconds
        return Outcome(tip, seconds, run, stepping, why, dear)

    def _finish(self, single: SingleRun, stop: Stop) -> Trajectory:
        """Run it to its end, unless that takes more than the budget."""
        chain = single.watch.record.chain

        def check(part: float) -> None:
            steps = single.steps.steps
            spent = run_cost(chain, steps.method, steps.evaluations)
            if spent > self.budget:
                self.seconds += spent
                raise TooLongError(f"{single.scene.name}: {part:.0%} of a run took the budget of {self.budget:g} s")

        return single.finish(stop, check, compared=False)

    def pass_along(self, run: Trajectory) -> None:
        """Let the postures and rates of the joints in a run be those at which stable steps are found."""
        rows = np.linspace(0, len(run.t) - 1, POSTURES).astype(int)
        joints = {run.chain.coordinate(int(k)).link: k for k in run.chain.active}
        self.along = [
            Posture(float(run.t[row]), {i: run.q[row, k] for i, k in joints.items()},
                    {i: run.qd[row, k] for i, k in joints.items()})
            for row in rows
        ]  # fmt: skip

    def states(self, chain: Chain) -> list[tuple[float, Array, Array]]:
        """Time, angles and rates of a chain with straight links, its joints as in the run that was passed along."""
        found = []
        for time, angles, rates in self.along or [Posture(self.scene.initial.time, {}, {})]:
            q, qd = np.zeros((2, chain.n))
            for k in chain.active:
                link = chain.coordinate(int(k)).link
                initial = math.radians(self.scene.initial.joint_deg[link - 1])
                q[k], qd[k] = angles.get(link, initial), rates.get(link, 0.0)
            found.append((time, q, qd))
        return found

    def stable(self, model: Model) -> float:
        """RK4's largest stable step [s] at all of the postures; 0 where one has none."""
        if model not in self._stable:
            chain = self.chain(model)
            inputs = input_arrays(self.scene, chain)
            try:
                steps = []
                for time, q, qd in self.states(chain):
                    (wrench, follower), gains = inputs.given_wrench(time), gains_of(chain, inputs.drive, time, q, qd)
                    steps.append(stable_step(chain, q, qd, tip_wrench=wrench, follower=follower, gains=gains))
            except FlexlinkError:
                steps = [0.0]
            self._stable[model] = min(steps)
        return self._stable[model]

    def estimated_step(self, link: int, bend: Bend) -> float:
        """About RK4's stable step [s] where this link alone bends, which is about its own where others do, too."""
        model = tuple(bend if k == link else None for k in range(len(self.scene.arm.links)))
        chain = self.chain(model)
        _, q, _ = self.states(chain)[0]
        fastest = max(fastest_frequency(chain, q), fastest_decay(chain, q))
        return REACH / fastest if fastest else np.inf

    def fixed(self, largest: float) -> Stepping | None:
        """RK4 with steps of at most this length [s], so many to a sample; None if no such steps fit the scene."""
        if not largest > 0:
            return None
        sample, group = self.scene.run.sample, self._divisions
        if not group:
            return None
        per_sample = group * max(1, math.ceil(sample / largest / group * (1 - 1e-9)))
        return Stepping("RK4", sample / per_sample)

    @functools.cached_property
    def _divisions(self) -> int:
        """Least number of fixed steps to a sample that fit the scene, its held tables and kinks; 0 if there is none."""
        run = self.scene.run
        for parts in range(1, MOST_DIVISIONS + 1):
            try:
                replace(self.scene, run=self._settings(Stepping("RK4", run.sample / parts)))
            except FlexlinkError:
                continue
            return parts
        return 0

    def fixed_cost(self, model: Model, stepping: Stepping) -> float:
        """CPU time of fixed steps [s], before they are taken."""
        assert stepping.step is not None
        evaluations = method(stepping.method).stages * round(self.scene.run.duration / stepping.step)
        return run_cost(self.chain(model), stepping.method, evaluations)

    def evaluation(self, model: Model, *, explicit: bool) -> float:
        """CPU time of one evaluation [s]."""
        chain = self.chain(model)
        return evaluation_cost(bodies_of(chain), planar=chain.is_planar, explicit=explicit)
