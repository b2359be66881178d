"""auto: a stretch of the run by each method that may be cheaper, after which the cheapest goes on."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.motion import method_trial
from flexlink.motion.method_steps import MethodSteps

SAMPLED = {
    "kind": "pd",
    "kp": [60.0, 60.0, 30.0],
    "kd": [6.0, 6.0, 3.0],
    "target_deg": [60.0, -30.0, 60.0],
    "rate": 200.0,
}


@pytest.fixture
def whipping(models: Path) -> fl.Scene:
    """A soft arm with a heavy tip: it bends far and fast, more with time."""
    scene = fl.load_scene(models / "t3_spatial.toml").varied({"tip.mass": 20.0, "material.aluminium.young": 2e8})
    return scene.varied({"run.relative_tolerance": 1e-4, "run.duration": 0.5})


@pytest.mark.slow
@pytest.mark.parametrize("drive", [None, SAMPLED], ids=["constant", "sampled"])
def test_methods_that_do_not_go_on_leave_no_trace_but_their_evaluations(
    whipping: fl.Scene, monkeypatch: pytest.MonkeyPatch, drive: dict[str, Any] | None
) -> None:
    whole = method_trial._cost_up_to_the_end

    def never_cheaper(steps: MethodSteps, _most: float) -> float:
        assert math.isfinite(whole(steps, math.inf))
        return math.inf

    monkeypatch.setattr(method_trial, "_cost_up_to_the_end", never_cheaper)
    monkeypatch.setattr(method_trial, "_least_cost", lambda *_: 0.0)
    scene = whipping if drive is None else whipping.varied({"drive": drive})
    auto, named = (fl.simulate(scene, method=method) for method in ("auto", "Radau5"))
    for part in ("t", "q", "qd", "work"):
        assert np.array_equal(getattr(auto, part), getattr(named, part))
    assert auto.steps is not None
    assert named.steps is not None
    assert auto.steps[:2] == named.steps[:2]
    assert auto.steps.evaluations > named.steps.evaluations


@pytest.mark.slow
def test_a_soft_arm_that_whips_is_left_to_an_explicit_method(whipping: fl.Scene) -> None:
    """After a while steps of Radau5 are no longer than those that DOP853 may take."""
    runs = {name: fl.simulate(whipping, method=name) for name in ("auto", "Radau5")}
    exact = fl.simulate(whipping, method="DOP853", relative_tolerance=1e-8)
    picked, named = (run.steps for run in runs.values())
    assert picked is not None
    assert named is not None
    assert picked.method == "DOP853"
    assert "Radau5 until t = " in picked.why
    assert picked.evaluations < 0.8 * named.evaluations
    assert np.abs(runs["auto"].tip - exact.tip).max() <= 1e-3


@pytest.mark.slow
def test_a_choice_by_trial_is_made_alike_every_time(whipping: fl.Scene) -> None:
    problem = fl.Problem(whipping.varied({"run.method": "auto"}))
    first, again, anew = problem.simulate(), problem.simulate(), fl.simulate(whipping, method="auto")
    assert first.steps == again.steps == anew.steps
    assert np.array_equal(first.q, again.q)
    assert np.array_equal(first.q, anew.q)


class Rejecting:
    """A run whose steps are all rejected, near a posture in which a coordinate moves no inertia."""

    name, end, evaluations_besides, time, row, tries, evaluations, fastest = (
        "Radau5",
        1.0,
        0,
        0.5,
        3,
        100,
        1000,
        math.inf,
    )

    def saved(self, _row: int) -> None:
        return None

    def take(self, _most: int) -> int:
        return int(OUTCOME.goes_on)


def test_a_stretch_in_which_nothing_was_accepted_compares_nothing() -> None:
    assert method_trial.go_on_with_the_cheapest(Rejecting()) == OUTCOME.goes_on  # type: ignore[arg-type]
