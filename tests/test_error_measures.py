"""What errors are measured by, and what is said and drawn of a result: each by one planted case."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import ROOT
from matplotlib.figure import Figure

import flexlink as fl
from flexlink.results.pictures.view import view_of
from flexlink.scene_report.arm_picture import draw_arm
from flexlink.scene_report.parts import loads, vibration
from flexlink.scene_report.refinement import Refinement
from flexlink.scene_report.study import Study
from reports.verdict import CaseVerdict
from validation.kinds import drag, witnesses
from validation.speed import evaluations

FALL = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"run.duration": 0.02, "run.sample": 0.005})


def test_witnesses_differ_by_the_largest_difference_over_the_largest_number() -> None:
    ours = np.array([[1.0, -4.0], [0.5, 0.0]])
    assert witnesses._relative(ours + np.array([[0.0, 0.1], [-0.2, 0.0]]), ours) == pytest.approx(0.05)
    assert witnesses._relative(np.array([0.0, -0.3]), np.zeros(2)) == 0.3


def test_a_rate_that_is_off_at_one_sample_counts_as_far_as_it_is_off() -> None:
    bar = fl.load_scene(ROOT / "validation" / "scenes" / "slowing_bar.toml")
    run = fl.simulate(bar)
    qd = run.qd * np.where(np.arange(len(run.t)) == 7, 1.003, 1.0)[:, None]
    assert drag._rate_error(bar, dataclasses.replace(run, qd=qd)) == pytest.approx(3e-3, rel=1e-4)


def test_mujocos_work_that_is_timed_finds_the_accelerations_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = fl.lump(FALL)
    engine, rng = evaluations.MujocoEngine(chain), np.random.default_rng(1)
    q, qd, tau, qdd = 0.1 * rng.normal(size=(4, 2, chain.n))
    monkeypatch.setattr(evaluations, "MujocoEngine", lambda _: engine)
    evaluations.mujoco_calls(chain, (q, qd, tau, qdd))[evaluations.FORWARD](2)
    assert engine.data.qacc == pytest.approx(fl.forward_dynamics(chain, q[1], qd[1], tau[1]), rel=1e-6)


def test_a_line_on_a_case_says_speed_only_of_what_is_timed() -> None:
    assert CaseVerdict(3, 1, 0, "9 of 9 met", None).text == "2 of 3 pass; speed: 9 of 9 met"
    assert CaseVerdict(0, 0, 4, "", None).text == "4 numbers without a limit"


@pytest.mark.parametrize("changes", [{"run.method": "RK4", "run.step": 1e-4}, {"run.tolerance": 1e-4}])
def test_adaptive_steps_are_a_choice_beside_fixed_ones_only(changes: dict[str, object]) -> None:
    labels = [one.label for one in Refinement(Study(FALL.varied(changes))).choices()]
    assert ("adaptive steps" in labels) == ("run.step" in changes)
    assert labels[-1] == "rigid links"


def test_shapes_have_no_scale_and_stress_of_a_rectangle_needs_no_remark() -> None:
    (picture,) = vibration.made(Study(FALL)).pictures
    assert not any(len(panel.get_xticks()) or len(panel.get_yticks()) for panel in picture.figure.axes)
    assert "as a rectangle" not in loads.made(Study(FALL)).facts[0].label


def test_an_arm_is_drawn_from_its_base_at_the_origin() -> None:
    axes, chain = Figure().subplots(), fl.lump(FALL)
    draw_arm(axes, view_of(chain), np.ones((len(chain.bodies), 3)), chain)
    (base,) = [line for line in axes.lines if line.get_label() == "base"]
    assert [*base.get_xdata(), *base.get_ydata()] == [0.0, 0.0]
