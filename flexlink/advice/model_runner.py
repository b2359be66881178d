"""Run a scene with different models and steps: each combination once, within a budget of CPU time."""

import contextlib
import functools
import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.advice.model import Bend, Model, with_model
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.common.types import Array
from flexlink.describe.initial import InitialState
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.extremes import fastest_decay, fastest_frequency
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.motion.evaluation_cost import evaluation_cost, run_cost
from flexlink.motion.inputs.actuation import acting_at, input_arrays
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory


class Stepping(NamedTuple):
    """Fixed steps [s] of a method, or steps that meet a tolerance [m]."""

    method: str
    step: float | None = None
    tolerance: float | None = None

    def __str__(self) -> str:
        return f"{self.method}, {self.tolerance:.2g} m" if self.step is None else f"{self.method} {self.step:.3g} s"


class Outcome(NamedTuple):
    """Result of a run."""

    tip: Array  # (samples, 3) [m]; nan after an early end of the run
    seconds: float  # CPU time of its steps [s], from evaluations and listed costs
    run: Trajectory | None
    stepping: Stepping
    reason: str = ""  # why the run ended early; otherwise empty
    over_budget: bool = False  # whether the run ended because it used up the budget

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return not self.reason


class ModelRunner:
    """Runs of one scene, with their `count` and the CPU `seconds` of their steps, computed from listed costs."""

    def __init__(self, scene: Scene, budget: float) -> None:
        self.scene, self.budget = scene, budget
        self.count, self.seconds = 0, 0.0
        self.postures: list[tuple[float, dict[int, float], dict[int, float]]] = []  # time, angles, rates by link
        self._chains: dict[Model, Chain] = {}
        self._stable_steps: dict[Model, float] = {}
        self._outcomes: dict[tuple[Model, Stepping, bool], Outcome] = {}

    def chain(self, model: Model) -> Chain:
        """The scene's chain with a model."""
        if model not in self._chains:
            self._chains[model] = lump(open_chain(with_model(self.scene, model)))
        return self._chains[model]

    def scene_of(self, model: Model, stepping: Stepping) -> Scene:
        """The scene with a model and its steps, ready to run."""
        return replace(with_model(self.scene, model), run=self._settings(stepping))

    def _settings(self, stepping: Stepping) -> RunSettings:
        run = self.scene.run
        return replace(
            run, method=stepping.method, step=stepping.step, tolerance=stepping.tolerance, relative_tolerance=None,
            sample=run.spacing, accuracy="tip", solver="articulated", unstable="refuse",
        )  # fmt: skip

    def run(self, model: Model, stepping: Stepping, *, compared: bool = False) -> Outcome:
        """Run a model, or return its outcome if it has already been run; `compared` as in `run_from`."""
        key = model, stepping, compared
        if key not in self._outcomes:
            self._outcomes[key] = self.run_from(None, model, stepping, compared=compared)
        return self._outcomes[key]

    def perturbed_run(self, model: Model, stepping: Stepping, angle: float) -> Outcome | None:
        """The run with free hinges turned by an angle [rad] at the start, slides by angle × size; None if none is."""
        chain, initial = self.chain(model), self.scene.initial
        if not (free := [k for k in chain.active.tolist() if not chain.held[k]]):
            return None
        deg, m = np.array(initial.joint_deg), np.array(initial.positions_m)
        for k in free:
            link = chain.coordinate(k).link - 1
            if chain.slides[k]:
                m[link] += angle * chain.size
            else:
                deg[link] += math.degrees(angle)
        joint_m = tuple(m.tolist()) if chain.slides[free].any() else initial.joint_m
        return self.run_from(replace(initial, joint_deg=tuple(deg.tolist()), joint_m=joint_m), model, stepping)

    def run_from(
        self, initial: InitialState | None, model: Model, stepping: Stepping, *, compared: bool = False
    ) -> Outcome:
        """The run from other initial conditions; None: those of the scene. `compared`: the run `simulate` returns."""
        tip = np.full((self.scene.run.samples, 3), np.nan)
        reason, over_budget, run = "", False, None
        try:
            scene = self.scene_of(model, stepping)
            scene = scene if initial is None else replace(scene, initial=initial)
            with deferred() as stop:
                run = self._finish(SingleRun(problem_of(scene, self.chain(model), tied=True)), stop, compared=compared)
        except DivergenceError as error:
            run, reason = error.trajectory, str(error)
        except FlexlinkError as error:
            reason, over_budget = str(error), error.id == "over-budget"
        seconds = 0.0
        if run is not None and run.steps is not None:
            tip[: len(run.tip)] = run.tip
            seconds = run_cost(run.chain, run.steps.method, run.steps.evaluations)
        self.count += 1
        self.seconds += seconds
        return Outcome(tip, seconds, run, stepping, reason, over_budget)

    def _finish(self, single: SingleRun, stop: Stop, *, compared: bool) -> Trajectory:
        """Run to the end, or until the budget is used up."""
        chain = single.monitor.record.problem.original

        def check(fraction: float) -> None:
            steps = single.steps.steps
            spent = run_cost(chain, steps.method, steps.evaluations)
            if spent > self.budget:
                self.seconds += spent
                why = f"a run used up the budget of {self.budget:g} s at {fraction:.0%} of its duration"
                raise FlexlinkError(f"{chain.name}: {why}; use a larger budget", id="over-budget")

        return single.finish(stop, check, compared=compared)

    def sample_postures(self, run: Trajectory) -> None:
        """Sample five configurations of a run to find stable steps; the initial one alone is not sufficient."""
        rows = np.linspace(0, len(run.t) - 1, 5).astype(int)
        joints = {run.chain.coordinate(int(k)).link: k for k in run.chain.active}
        self.postures = [
            (float(run.t[row]), {i: run.q[row, k] for i, k in joints.items()},
             {i: run.qd[row, k] for i, k in joints.items()})
            for row in rows
        ]  # fmt: skip

    def states(self, chain: Chain) -> list[tuple[float, Array, Array]]:
        """Times, angles and rates of a chain with unloaded links in the sampled configurations."""
        states = []
        for time, angles, rates in self.postures or [(self.scene.initial.time, {}, {})]:
            q, qd = chain.rest.copy(), np.zeros(chain.n)
            for k in chain.active.tolist():
                link = chain.coordinate(k).link
                q[k] = angles.get(link, self.scene.joint_positions[link - 1])
                qd[k] = rates.get(link, 0.0)
            states.append((time, q, qd))
        return states

    def stable_step(self, model: Model) -> float:
        """Largest step of RK4 [s] that is stable in all sampled configurations; 0 if there is no such step."""
        if model not in self._stable_steps:
            chain = self.chain(model)
            inputs, states = input_arrays(self.scene, chain), self.states(chain)
            try:
                steps = (stable_step(chain, q, qd, **acting_at(inputs, chain, t, q, qd)) for t, q, qd in states)
                self._stable_steps[model] = min(steps)
            except FlexlinkError:
                self._stable_steps[model] = 0.0
        return self._stable_steps[model]

    def estimated_step(self, link: int, bend: Bend) -> float:
        """Estimate of RK4's stable step [s] if only this link bends; the other links hardly change it."""
        chain = self.chain(tuple(bend if k == link else None for k in range(len(self.scene.arm.links))))
        _, q, _ = self.states(chain)[0]
        fastest = max(fastest_frequency(chain, q), fastest_decay(chain, q))
        return 2.78 / fastest if fastest else np.inf  # RK4's limit of |h λ|, to a few percent for all directions of λ

    def fixed_steps(self, largest: float) -> Stepping | None:
        """RK4 with an integer number of steps per sample, at most this long [s]; None if no number fits the scene."""
        if not largest > 0 or not self._divisions:
            return None
        sample, group = self.scene.run.spacing, self._divisions
        per_sample = group * max(1, math.ceil(sample / largest / group * (1 - 1e-9)))
        return Stepping("RK4", sample / per_sample)

    @functools.cached_property
    def _divisions(self) -> int:
        """Smallest number of fixed steps per sample that fits the scene's holds and kinks; 0 if none does."""
        run = self.scene.run
        for parts in range(1, 1001):
            with contextlib.suppress(FlexlinkError):
                replace(self.scene, run=self._settings(Stepping("RK4", run.spacing / parts)))
                return parts
        return 0

    def fixed_steps_cost(self, model: Model, stepping: Stepping) -> float:
        """Predicted CPU time of a run with fixed steps [s]."""
        assert stepping.step is not None
        evaluations = method(stepping.method).stages * round(self.scene.run.duration / stepping.step)
        return run_cost(self.chain(model), stepping.method, evaluations)

    def least_explicit_cost(self, model: Model) -> float:
        """Lower estimate of the CPU time of a run with DOP853 [s]: no step is longer than stability allows."""
        stable, longer = self.stable_step(model), 2.2  # stable steps of DOP853, relative to those of RK4
        steps = self.scene.run.duration / (longer * stable) if stable > 0 else np.inf
        return run_cost(self.chain(model), "DOP853", method("DOP853").stages * steps)

    def evaluation_cost(self, model: Model, *, explicit: bool) -> float:
        """CPU time of one evaluation [s]."""
        return evaluation_cost(self.chain(model), explicit=explicit)
