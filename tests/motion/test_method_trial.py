"""method="auto" continues with the method whose own steps predict the lowest cost for the rest of the run."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion import adaptive_steps
from flexlink.motion.adaptive_steps import consider
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.method_steps import NEVER, MethodSteps
from flexlink.motion.single_run import SingleRun
from flexlink.motion.tolerable import Thresholds


@pytest.fixture
def whipping(models: Path) -> fl.Scene:
    """A soft arm with a heavy tip, whose bending becomes larger and faster with time."""
    scene = fl.load_scene(models / "t3_spatial.toml").varied({"tip.mass": 20.0, "material.aluminium.young": 2e8})
    return scene.varied({"run.relative_tolerance": 1e-4, "run.duration": 0.5})


@pytest.mark.slow
def test_auto_switches_repeatably_to_an_explicit_method_for_a_whipping_soft_arm(whipping: fl.Scene) -> None:
    """As the motion gets faster, the steps of Radau5 become as short as the stable steps of DOP853."""
    runs = {name: fl.simulate(whipping, method=name) for name in ("auto", "Radau5")}
    exact = fl.simulate(whipping, method="DOP853", relative_tolerance=1e-8)
    picked, named = (run.steps for run in runs.values())
    assert picked is not None
    assert named is not None
    assert picked.method == "DOP853"
    assert "Radau5 until t = " in picked.why
    assert picked.evaluations < 0.8 * named.evaluations
    assert np.abs(runs["auto"].tip - exact.tip).max() <= 1e-3
    problem = fl.Problem(whipping.varied({"run.method": "auto"}))
    for again in (problem.simulate(), problem.simulate()):
        assert again.steps == picked
        assert np.array_equal(again.q, runs["auto"].q)


STEP = 1e-5  # CPU time of a step by any method [s]


class Counted:
    """Steps of a method that cost a given CPU time per second of motion; 1 s of motion is done, 10 s remain."""

    def __init__(self, name: str, cost: float, **known: Any) -> None:
        self.name, self.why, self.cost, self.spent, self.taken = name, "", cost, 0.0, 0.0
        self.time, self.rated_since, self.tries = 1.0, (0.5, cost / 2), 64
        self.record, self.run = SimpleNamespace(t=[0.0]), SimpleNamespace(duration=11.0)
        self.guesses = {"Radau5": 1.0, "Radau9": 10.0, "DOP853": 10.0}
        self.rates: dict[str, float] = {}
        self.tried: dict[str, float] = {}
        self.tried_for: tuple[str, str] | None = None
        self.consider_at = 0
        vars(self).update(known)

    def go_on_with(self, name: str, why: str) -> None:
        self.name, self.why, self.spent, self.cost = name, why, self.spent + self.cost, 0.0


@pytest.fixture
def considered(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the steps after the trial has judged steps whose costs are `Counted`."""
    monkeypatch.setattr(adaptive_steps, "price_of_a_step", lambda _record, _name: STEP)

    def counted(name: str, cost: float, **known: Any) -> Counted:
        steps = Counted(name, cost, **known)
        consider(cast("MethodSteps", steps))
        return steps

    return counted


def test_a_cheaper_method_is_tried_after_a_fraction_of_its_predicted_cost_is_spent(considered: Any) -> None:
    guesses = {"Radau5": 100.0, "Radau9": 1e3, "DOP853": 2.0}
    enough = Thresholds.patience["DOP853"] * 2.0 * 10.0
    patient = considered("Radau5", 0.99 * enough, guesses=guesses, tried={"DOP853": 0.5 * enough})
    assert (patient.name, patient.tried_for) == ("Radau5", None)
    steps = considered("Radau5", 1.01 * enough, guesses=guesses)
    assert (steps.name, steps.tried_for) == ("DOP853", ("Radau5", ""))
    assert steps.rates == {"Radau5": pytest.approx(1.01 * enough)}
    assert steps.tried == {"Radau5": steps.spent, "DOP853": steps.spent}
    assert steps.rated_since is None


def test_a_method_that_is_only_slightly_cheaper_is_not_tried(considered: Any) -> None:
    known = {"guesses": {"Radau5": 100.0, "Radau9": 1e3, "DOP853": 8.0}, "spent": 1e3, "tried": {"DOP853": 1e3}}
    assert considered("Radau5", 10.0, **known).name == "Radau5"
    assert considered("Radau5", 11.0, **known).name == "DOP853"


def test_briefly_expensive_steps_count_no_more_than_the_average_of_the_run(considered: Any) -> None:
    """A jump may cause short steps, which grow again afterwards."""
    known = {"guesses": {"Radau5": 100.0, "Radau9": 1e3, "DOP853": 8.0}, "spent": 1e3, "tried": {"DOP853": 1e3}}
    assert considered("Radau5", 10.0, judged=(0.9, 5.0), **known).name == "Radau5"
    assert considered("Radau5", 50.0, judged=(0.9, 45.0), **known).name == "DOP853"


def test_a_tried_method_that_is_not_clearly_cheaper_is_abandoned(considered: Any) -> None:
    trial: dict[str, Any] = {
        "tried_for": ("Radau5", "stiff"), "rates": {"Radau5": 10.0}, "spent": 1e3,
        "tried": {"Radau5": 1e3, "Radau9": 1e3},
    }  # fmt: skip
    back = considered("DOP853", 9.5, **trial)
    assert (back.name, back.why, back.tried_for) == ("Radau5", "stiff", None)
    for rate in (8.0, 4.0):
        stays = considered("DOP853", rate, **trial)
        assert (stays.name, stays.tried_for) == ("DOP853", None)
    early = {**trial, "tried": {"Radau5": 9.0, "Radau9": 9.0}, "spent": 0.0, "run": SimpleNamespace(duration=21.0)}
    assert considered("DOP853", 8.0, **early).name == "Radau5"  # too little of the predicted cost is spent
    assert considered("DOP853", 4.9, **early).name == "DOP853"  # but a method at half the cost per second is kept


def test_radau9_is_kept_only_after_the_initial_vibration(considered: Any) -> None:
    trial = {"tried_for": ("Radau5", ""), "rates": {"Radau5": 10.0}, "tried": {"Radau5": 1e3, "DOP853": 1e3}}
    enough = Thresholds.patience["Radau9"] * 4.0 * 10.0
    assert considered("Radau9", 4.0, spent=enough - 4.1, **trial).name == "Radau5"
    assert considered("Radau9", 4.0, spent=enough - 3.9, **trial).name == "Radau9"


def test_measured_costs_of_a_method_expire_when_the_simulated_time_has_doubled(considered: Any) -> None:
    """Radau5 was abandoned during fast motion. In slow motion DOP853 is no cheaper: stability limits its steps."""
    known = {"rates": {"Radau5": 100.0, "DOP853": 10.0}, "guesses": {"Radau5": 1.0, "Radau9": 1e3, "DOP853": 9.0}}
    steps = considered("DOP853", 10.0, tried={"Radau5": 4.9}, **known)
    assert (steps.name, steps.tried_for) == ("Radau5", ("DOP853", ""))
    assert considered("DOP853", 10.0, tried={"Radau5": 5.1}, **known).name == "DOP853"
    short = 9.0 * (Thresholds.switch + 2 * Thresholds.few * STEP)
    assert considered("DOP853", short, run=SimpleNamespace(duration=1e4), **known).name == "DOP853"


def test_a_method_that_cannot_be_cheaper_or_failed_is_not_tried(considered: Any) -> None:
    guesses = {"Radau5": 40.0, "Radau9": 40.0, "DOP853": 11.0}
    assert considered("Radau5", 10.0, guesses=guesses).name == "Radau5"
    rates = {"Radau5": math.inf, "Radau9": math.inf}
    assert considered("DOP853", 10.0, rates=rates).name == "DOP853"


def test_cost_estimates_of_other_methods_fall_with_the_current_cost(considered: Any) -> None:
    rates = {"Radau5": 40.0, "Radau9": 30.0}
    guesses = {"Radau5": 10.0, "Radau9": 10.0, "DOP853": 1e3}
    assert considered("Radau5", 20.0, rates=rates, guesses=guesses).rates == {"Radau5": 20.0, "Radau9": 15.0}
    assert considered("Radau5", 60.0, rates=rates, guesses=guesses).rates["Radau9"] == 30.0


def test_steps_that_just_began_or_made_no_progress_are_not_judged(considered: Any) -> None:
    for rated in (None, (1.0, 0.0)):
        steps = considered("Radau5", 1e3, rated_since=rated)
        assert (steps.name, steps.rates, steps.rated_since) == ("Radau5", {}, (1.0, 1e3))
    assert steps.consider_at == 64 + round(2 * Thresholds.switch / STEP)
    tried = considered("Radau5", 1.0, rated_since=None, tried={"Radau5": 1.0}, spent=1.0)
    assert tried.consider_at == 64 + round(Thresholds.trial / 2 / STEP)


def test_no_switch_near_the_end_if_the_rest_costs_less_than_a_switch(considered: Any) -> None:
    cheap = {"Radau5": 100.0, "Radau9": 1e3, "DOP853": 0.0}
    almost = SimpleNamespace(duration=1.0 + 0.9 * Thresholds.switch / 10.0)
    assert considered("Radau5", 10.0, run=almost, guesses=cheap).name == "Radau5"


def test_cost_records_of_methods_are_restored_with_rejected_steps(whipping: fl.Scene) -> None:
    steps = SingleRun(problem_of(whipping.varied({"run.method": "auto"}))).steps
    assert isinstance(steps, MethodSteps)
    steps.aim(0.0, 0.5)
    steps.take(20)
    names = "name", "spent", "taken", "rated_since", "rates", "tried", "tried_for", "consider_at", "cost"
    saved, before = steps.saved(), {name: getattr(steps, name) for name in names}
    steps.rated_since, steps.rates, steps.tried_for = (0.0, 0.0), {**steps.rates, "DOP853": 1e-9}, ("Radau5", "")
    adaptive_steps.consider_others(steps, 1e9)
    assert steps.name != before["name"]
    steps.take(20)
    steps.restore(saved)
    assert {name: getattr(steps, name) for name in names} == before


def test_a_named_method_is_never_replaced(whipping: fl.Scene) -> None:
    steps = SingleRun(problem_of(whipping.varied({"run.method": "Radau5"}))).steps
    assert isinstance(steps, MethodSteps)
    assert steps.consider_at == NEVER
