"""Reference results for advice: repeatable random scenes; truth and cheapest model of runs with known errors."""

import itertools
import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.advice.model_runner import Outcome, Stepping
from flexlink.describe.vary import to_document
from validation.advice import truth
from validation.advice.scenes import random_scene, released_scene, robot_scene, tumbling_scene
from validation.extremes import outcomes
from validation.kinds import advice
from validation.random_arms import random_arm, random_tree


@pytest.mark.parametrize(("make", "args", "known"), [
    (random_scene, range(80), 23761.367215524),
    (tumbling_scene, range(20), 6393.112545017),
    (released_scene, range(20), 5972.309018352),
    (robot_scene, (0.5, 1.0), 970.857021555),
    (random_arm, range(40), 26946.439598062),
    (random_tree, range(30), 22684.321373375),
])  # fmt: skip
def test_the_same_seed_gives_the_scene_of_the_stored_study(make: Any, args: Any, known: float) -> None:
    """Scenes are compared by a weighted sum of their numbers: stored results require that a seed gives the same scene.

    Zeros are ignored, so a new key that is not set changes nothing.
    """
    found = (map(float, re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", repr(to_document(make(one))))) for one in args)
    total = sum((1 + k % 7) * math.asinh(x) for numbers in found for k, x in enumerate(filter(None, numbers)))
    assert total == pytest.approx(known, rel=1e-10)


THREE = {"run.duration": 1.0, "run.sample": 0.5, "run.step": 0.5}
SCENE = next(scene for scene in map(random_scene, range(99)) if len(scene.arm.links) == 2).varied(THREE)
PATH = np.array([[0.0, 0.0, 0.0], [0.3, 0.4, 0.0], [0.0, -0.8, 0.6]])


class Runs:
    """Stub of a runner whose tip has a relative error of h⁻² + 8 h⁻⁴ plus `slip` times the tolerance or step."""

    slip, allowed = 0.0, True

    def __init__(self, scene: fl.Scene, budget: float) -> None:
        self.budget = float(budget)  # a scene passed by mistake would raise an error

    def run(self, model: Any, stepping: Stepping, *, compared: bool = False) -> Outcome:
        h = sum(bend.hinges for bend in model if bend) / len(model) or 1
        if compared and self.cost(h, stepping) > self.budget:  # `cheapest` must not stop a run that it needs
            return Outcome(np.full_like(PATH, np.nan), self.budget, None, stepping, "budget", over_budget=True)
        aside = self.slip * (stepping.tolerance or 1e-3 * (stepping.step or 0.0)) * np.arange(3)[:, None] / 2
        tip = PATH * (1 + h**-2 + 8 * h**-4) + aside * [1.0, 0.0, 0.0]
        return Outcome(tip, self.cost(h, stepping), None, stepping)

    def cost(self, h: float, stepping: Stepping) -> float:
        """Cost of a run: hinges times steps; steps with DOP853 are cheaper with few hinges."""
        steps = 1 / stepping.step if stepping.step else (stepping.tolerance or 1.0) ** (-0.2 - 0.1 * (h > 8))
        return h * steps * (0.3 if stepping.method == "DOP853" and h < 6 else 1.0)

    def stable_step(self, model: Any) -> float:
        return 0.2 / (sum(bend.hinges for bend in model if bend) or 1)

    def fixed_steps(self, largest: float) -> Stepping | None:
        return Stepping("RK4", step=largest) if self.allowed else None

    def evaluation_cost(self, model: Any, *, explicit: bool) -> float:
        return 1e-9  # so that no run is stopped early

    def fixed_steps_cost(self, model: Any, stepping: Stepping) -> float:
        return self.cost(sum(bend.hinges for bend in model if bend) / len(model) or 1, stepping)


@pytest.fixture(autouse=True)
def runs(monkeypatch: pytest.MonkeyPatch) -> type[Runs]:
    made = type("Made", (Runs,), {})
    monkeypatch.setattr(truth, "ModelRunner", made)
    return made


def change(a: int, b: int, d: int) -> float:
    """Change of the second-order extrapolated limit from levels a and b to levels b and d."""
    return 8 / b**2 * (a**-2 - d**-2)


@pytest.mark.parametrize(("within", "levels"), [
    (0.5, (4, 6, 8)), (0.009, (6, 8, 12)), (1e-3, (8, 12, 16)), (4e-4, (12, 16, 24)), (1e-9, (24, 32, 48)),
])  # fmt: skip
def test_the_truth_is_the_extrapolated_limit_of_converged_levels(within: float, levels: Any) -> None:
    a, b, d = levels
    found = truth.truth(SCENE, within, 1.0)
    assert found.tip == pytest.approx(PATH * (1 - 8 / (b * d) ** 2), abs=1e-12)
    assert found.errors == pytest.approx(change(a, b, d) * np.array([0.0, 0.5, 1.0]), abs=1e-12)
    assert found.error == found.errors[-1]
    assert found.motion == pytest.approx(1 + d**-2 + 8 * d**-4)


@pytest.mark.parametrize(("slip", "of_motion"), [(10.0, 1e-6), (1e4, 1e-9)])
def test_the_step_error_is_added_and_reduced_if_it_is_not_small(runs, slip, of_motion) -> None:
    """Six hinges are run at the tolerance from four hinges, and at a tenth of the tolerance of the last level."""
    runs.slip = slip
    found, size = truth.truth(SCENE, 0.009, 1.0), {h: 1 + h**-2 + 8 * h**-4 for h in (4, 12)}
    steps = slip * of_motion * (size[4] - 0.1 * size[12])
    assert found.error - change(6, 8, 12) == pytest.approx(steps, rel=0.01)


def test_a_careless_model_has_eight_hinges_per_link_and_0_9_of_the_stable_step(runs: type[Runs]) -> None:
    assert truth.naive_cost(SCENE) == pytest.approx(8 * 16 / (0.9 * 0.2))
    runs.allowed = False
    assert truth.naive_cost(SCENE) == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("allowed", [True, False])
def test_the_cheapest_model_equals_that_of_an_exhaustive_search(runs: type[Runs], allowed: bool) -> None:
    runs.slip, runs.allowed = 0.3, allowed
    tolerances, links = (0.2, 0.03, 4e-3), len(SCENE.arm.links)
    counts = sorted({0, *itertools.chain.from_iterable(truth.GRID.values())})
    hinges = {sum(each) for each in itertools.product(counts, repeat=links)}
    best = dict.fromkeys(tolerances, math.inf)
    for n in hinges:
        h = n / links or 1
        ways = [Stepping("RK4", step=f * 0.9 * 0.2 / (n or 1)) for f in (1.0, 0.5) if allowed]
        ways += [Stepping(method, tolerance=f * tolerance) for method in ("Radau5", "DOP853")
                 for tolerance in tolerances for f in (1.0, 0.3, 0.1)]  # fmt: skip
        for way in ways:
            aside = 0.3 * (way.tolerance or 1e-3 * (way.step or 0.0))
            off = np.linalg.norm(PATH * (h**-2 + 8 * h**-4) + np.outer([0, 0.5, 1], [aside, 0, 0]), axis=1).max()
            for tolerance in tolerances:
                if max(off, way.tolerance or 0.0) <= tolerance:
                    best[tolerance] = min(best[tolerance], Runs.cost(None, h, way))  # type: ignore[arg-type]
    true = truth.Truth(PATH, 1.0, np.zeros(3))
    found = truth.cheapest(SCENE, true, dict.fromkeys(tolerances, math.inf), ("z",) * links)
    assert found == pytest.approx(best)


@pytest.mark.parametrize(("error", "stated", "doubt", "known", "wrong", "too_little"), [
    (1.2, 1.5, 0.1, 1, 1, 0), (1.2, 1.5, 0.11, 0, 0, 0), (1.0, 0.95, 0.1, 1, 0, 0), (1.0, 0.85, 0.1, 1, 0, 1),
])  # fmt: skip
def test_advice_is_judged_where_its_reference_is_known_to_a_tenth_of_the_tolerance(
    error: float, stated: float, doubt: float, known: int, wrong: int, too_little: int
) -> None:
    """True error, stated error and uncertainty of the reference, in units of the tolerance."""
    said = SimpleNamespace(
        met=True, converged_tip=PATH, error=stated, tolerance=1.0, scene=SCENE, compute_time=1.0, run_time=1.0
    )  # fmt: skip
    true = truth.Truth(PATH, 1.0, np.full(3, doubt))
    cell: Any = advice.Cell("arm", 0.1, said, error, 1.0, 1.0, 1.0, 1.0, true, PATH)  # type: ignore[arg-type]
    found = {each.quantity: each.value for each in advice._summary([cell], [])}
    counts = [found[name] for name in ("cells", "cells judged", "met, but is not", "stated too little")]
    assert counts == [1, known, wrong, too_little]
    assert found.get("stated over true error, largest") == (pytest.approx(stated / error) if known else None)


@pytest.mark.parametrize(("error", "apart", "doubted", "outcome"), [
    (0.5, 0.0, False, "within"), (1.0, 0.3, False, "within"), (1.0, 0.0, True, "false doubt"),
    (1.01, 0.0, False, "near"), (10.0, 0.0, False, "near"), (10.2, 0.25, False, "near"), (3.0, 0.3, True, "warned"),
    (10.2, 0.1, False, "silent wrong"), (1e9, 0.0, True, "warned"), (math.nan, 0.0, False, "silent wrong"),
    (0.5, 0.31, False, "unknown"), (10.3, 0.31, False, "unknown"), (10.4, 0.31, False, "silent wrong"),
    (10.4, 0.31, True, "unknown"),
])  # fmt: skip
def test_outcomes_are_classified_as_listed(error: float, apart: float, doubted: bool, outcome: str) -> None:
    """Errors are given in units of a tolerance of 0.2 mm."""
    scene = SCENE.varied({"run.tolerance": 2e-4})
    assert outcomes._judged(error * 2e-4, apart * 2e-4, 2e-4, doubted) == outcome
    known = outcomes.Truth(PATH, apart * 2e-4, "two")
    words = "the run is doubtful" if doubted else "hinges bent far"
    found = outcomes.judged(scene, PATH + error * np.array([2e-4, 0.0, 0.0]), known, words, 0.25)
    assert (found.words, found.seconds) == (words, 0.25)
    assert found.error == pytest.approx(error, rel=1e-9, nan_ok=True)
    still = outcomes.Truth(0 * PATH, 0.0, "")
    assert outcomes.allowed(SCENE.varied({"run.method": "RK4"}), still) == 1e-12
    nothing = outcomes.judged(scene, PATH, outcomes.Truth(np.empty((0, 3)), math.inf, ""), words, 0.5)
    assert (nothing.outcome, nothing.words, nothing.seconds) == ("unknown", words, 0.5)


@pytest.mark.parametrize(("off", "pair", "apart"), [
    ((0.0, 5e-10, 9.0, 9.0, 9.0, 9.0, 9.0), "DOP853, RK10", 5e-10),  # good enough: the last methods are not run
    ((0.0, 4e-3, 1e-3, None, 9.0, 12.0, 20.0), "DOP853, Radau9", 1e-3),
    ((None, None, 0.0, 5e-3, 1e-5, 2e-3, 1e-6), "Radau9, Radau5", 1.99e-3),
    ((None, None, None, None, None, None, 0.0), "", math.inf),
])  # fmt: skip
def test_the_truth_is_taken_from_the_two_methods_that_agree_best(monkeypatch, off, pair, apart) -> None:
    left, steps = [*off], {}

    def reference(scene: fl.Scene, budget: float) -> Any:
        assert budget == 0.7
        run = scene.run
        at = left.pop(0)
        if at is None and run.method == "DOP853":
            left.pop(0)  # without DOP853, RK10 is not run
        steps[run.method] = run.step if run.method == "RK10" else run.relative_tolerance
        return None if at is None else SimpleNamespace(tip=PATH * (1 + at), steps=SimpleNamespace(taken=7))

    monkeypatch.setattr(outcomes, "_reference", reference)
    found = outcomes.truth_of(SCENE, 0.7)
    assert found.methods == pair
    assert found.apart == pytest.approx(apart, rel=1e-6)
    assert found.tip.shape == ((3, 3) if pair else (0, 3))
    assert steps["DOP853"] == 1e-11
    assert steps.get("RK10", 0.5 / 7) == pytest.approx(0.5 / 7), "half the mean step, rounded to whole steps per sample"
