"""Measures of tip travel, and extrapolation of tip paths to their limit."""

import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

import flexlink as fl
from flexlink.results import convergence
from flexlink.results.convergence import change_of_limit, extrapolated, observed_order
from flexlink.results.pictures.view import view_of
from flexlink.results.tip_motion import centre_of_motion, extent_of_motion, largest_so_far, tip_travel
from flexlink.scene_report.arm_picture import draw_arm
from flexlink.scene_report.parts import loads, vibration
from flexlink.scene_report.refinement import Refinement
from flexlink.scene_report.study import Study
from reports.verdict import CaseVerdict
from tests.conftest import ROOT
from tests.support.words import reviewed
from validation.kinds import drag, witnesses
from validation.speed import evaluations

Array = NDArray[np.float64]
EXACT = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.4]])


def levels(order: float, *hinges: int) -> list[tuple[float, Array]]:
    """Tip paths for these hinge counts, with errors that decrease with this order."""
    return [(n, EXACT + np.array([[0.0], [1e-2]]) / n**order) for n in hinges]


def test_travel_is_measured_from_the_start_and_extent_between_extremes() -> None:
    x = np.array([0.0, 3.0, -1.0])
    tip = np.column_stack([x, 0 * x, 0 * x])
    assert tip_travel(tip) == 3.0
    assert extent_of_motion(tip) == 4.0
    assert centre_of_motion(tip).tolist() == [1.0, 0.0, 0.0]


def test_waves_are_counted_along_hinges_and_slides_of_beams_without_gears_and_clamps() -> None:
    gear = {"joint.gear_stiffness": 1e4, "joint.armature": 0.1, "stretch": True, "segments": 2}
    changes = {"link.upper.segments": 3, "link.upper.root_stiffness": {"z": 100.0}, "link.upper.joint.armature": 0.1}
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    chain = fl.lump(scene.varied(changes | {f"link.fore.{key}": value for key, value in gear.items()}))
    names = [[chain.joint_names[k] for k in line] for line in convergence._lines(chain)]
    assert names == [["upper.1.z", "upper.2.z"], ["fore.1.stretch"], ["fore.1.z"]]


def test_an_error_that_is_not_finite_stays_infinite() -> None:
    assert largest_so_far(np.array([1.0, 0.5, np.nan, 0.1])).tolist() == [1.0, 1.0, np.inf, np.inf]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_extrapolation_is_exact_for_any_ratio_of_levels(order: float) -> None:
    found = extrapolated(levels(order, 2, 3), order)
    assert found.tip == pytest.approx(EXACT, abs=1e-16)
    assert sum(found.weights) == pytest.approx(1.0)
    assert change_of_limit(levels(order, 2, 3, 5), order) == pytest.approx(0.0, abs=1e-16)
    assert observed_order(levels(order, 2, 4, 8)) == pytest.approx(order)
    assert observed_order(levels(order, 1, 3, 9)) == pytest.approx(order)


def test_the_change_of_a_limit_bounds_its_error_even_for_a_wrong_order() -> None:
    found = levels(1.0, 4, 8, 16)
    assert np.abs(change_of_limit(found)).max() >= 0.999 * np.abs(extrapolated(found).tip - EXACT).max()


def test_the_observed_order_is_infinite_for_equal_levels_or_growing_changes() -> None:
    still, off = EXACT, EXACT + 1.0
    assert observed_order([(1, off), (2, still), (4, still)]) == np.inf
    assert observed_order([(1, still), (2, still), (4, off)]) == -np.inf


@pytest.mark.parametrize("waves", [1, 2, 3, 7])
def test_half_waves_of_a_mode_are_counted_by_sign_changes_of_its_moments(waves: int) -> None:
    x = (np.arange(40) + 0.5) / 40
    for sign in (1.0, -1.0):
        assert convergence._half_waves(sign * np.sin(waves * np.pi * x)) == waves


def test_rounding_errors_next_to_large_moments_are_not_half_waves() -> None:
    moments = -np.sin(np.pi * (np.arange(40) + 0.5) / 40)
    moments[[0, -1]] = 1e-12
    assert convergence._half_waves(moments) == convergence._half_waves(-moments) == 1


FALL = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"run.duration": 0.02, "run.sample": 0.005})


def test_relative_differences_are_divided_by_the_largest_value() -> None:
    ours = np.array([[1.0, -4.0], [0.5, 0.0]])
    assert witnesses._relative(ours + np.array([[0.0, 0.1], [-0.2, 0.0]]), ours) == pytest.approx(0.05)
    assert witnesses._relative(np.array([0.0, -0.3]), np.zeros(2)) == 0.3


def test_the_rate_error_is_the_maximum_over_all_samples() -> None:
    bar = fl.load_scene(ROOT / "validation" / "scenes" / "slowing_bar.toml")
    run = fl.simulate(bar)
    qd = run.qd * np.where(np.arange(len(run.t)) == 7, 1.003, 1.0)[:, None]
    assert drag._rate_error(bar, dataclasses.replace(run, qd=qd)) == pytest.approx(3e-3, rel=1e-4)


def test_the_timed_computation_of_mujoco_gives_the_accelerations_of_flexlink(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = fl.lump(FALL)
    engine, rng = evaluations.MujocoEngine(chain), np.random.default_rng(1)
    q, qd, tau, qdd = 0.1 * rng.normal(size=(4, 2, chain.n))
    monkeypatch.setattr(evaluations, "MujocoEngine", lambda _: engine)
    evaluations.mujoco_calls(chain, (q, qd, tau, qdd))[evaluations.FORWARD](2)
    assert engine.data.qacc == pytest.approx(fl.forward_dynamics(chain, q[1], qd[1], tau[1]), rel=1e-6)


def test_the_summary_line_of_a_case_states_a_speed_only_if_it_is_timed() -> None:
    timed, speed = CaseVerdict(3, 1, 0, "9 of 9 met", None).text, "9 of 9 met"
    reviewed("study: line of a timed case", timed)
    assert timed.startswith("2 of 3 ")
    assert timed.endswith(speed)
    informing = CaseVerdict(0, 0, 4, "", None).text
    reviewed("study: line of a case without limits", informing)
    assert informing.startswith("4 ")


@pytest.mark.parametrize("changes", [{"run.method": "RK4", "run.step": 1e-4}, {"run.tolerance": 1e-4}])
def test_adaptive_steps_are_offered_only_if_the_scene_has_fixed_steps(changes: dict[str, object]) -> None:
    about = Refinement(Study(FALL.varied(changes)))
    own, *others = about.choices()
    adaptive = [one for one in others if one.n == own.n and one.outcome.stepping == about.strict]
    assert len(adaptive) == ("run.step" in changes)
    assert others[-1].n == len(fl.lump(FALL).active)  # the last model has rigid links


def test_plots_of_mode_shapes_have_no_axis_scale() -> None:
    (picture,) = vibration.made(Study(FALL)).pictures
    assert not any(len(panel.get_xticks()) or len(panel.get_yticks()) for panel in picture.figure.axes)
    label = loads.made(Study(FALL)).facts[0].label
    reviewed("report: largest stress", label)
    assert ";" not in label


def test_an_arm_is_drawn_from_its_base_at_the_origin() -> None:
    axes, chain = Figure().subplots(), fl.lump(FALL)
    draw_arm(axes, view_of(chain), np.ones((len(chain.bodies), 3)), chain)
    (base,) = [line for line in axes.lines if line.get_label() == "base"]
    assert [*base.get_xdata(), *base.get_ydata()] == [0.0, 0.0]
