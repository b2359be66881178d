"""Advice on the smallest model meets its goal, reports a correct error, and is refused for scenes it cannot assess."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

import msgspec
import numpy as np
import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace
from numpy.typing import NDArray

import flexlink as fl
from flexlink.advice.advise import own_time, run_time
from flexlink.advice.goal import Goal, TipErrorNorm, goal_of
from flexlink.advice.model import Bend, all_axes, limited_axes, uniform, with_model
from flexlink.advice.model_runner import ModelRunner, Stepping
from flexlink.advice.refinement import RefinementStudy
from flexlink.advice.rigid import oscillator_response
from flexlink.advice.verdict import Advice, payback
from flexlink.cli.main import main
from flexlink.common.interruption import Stop
from flexlink.describe.scene import scene_from
from flexlink.describe.spec import decode
from flexlink.dynamics.placement import unbent
from flexlink.motion.evaluation_cost import bodies_of, run_cost
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from flexlink.results.trajectory import deflections
from flexlink.scene_report.study import Study
from flexlink.sweeps.measures import column_of
from tests.conftest import ROOT, flexible, make_scene
from tests.support.beams import STEEL
from tests.support.beams import steel_bars as arm
from tests.support.words import refused, reviewed
from validation.advice import truth as advice_truth
from validation.advice.scenes import random_scene, robot_scene
from validation.case import CASES, load_case
from validation.kinds import advice as kind
from validation.trade.scenes import seen

Array = NDArray[np.float64]


FINE = 16, 24  # hinge counts; the tip extrapolated from them is accurate to 3e-6 m (from 8 and 12 hinges: 8e-5 m)


def truth(scene: fl.Scene, *, flex: str = "xyz", hinges: tuple[int, int] = FINE) -> Array:
    """Tip path extrapolated from these hinge counts (Gauss points); by default with bending about all axes."""
    key = msgspec.json.encode((scene, flex, hinges))
    if key not in TRUTHS:
        TRUTHS[key] = _truth(scene, flex, hinges)
    return TRUTHS[key]


TRUTHS: dict[bytes, Array] = {}  # cached: several tests use it


def _truth(scene: fl.Scene, flex: str, hinges: tuple[int, int]) -> Array:
    runner, axes = ModelRunner(scene, 60.0), limited_axes(all_axes(scene), flex)
    coarse, fine = (runner.run(uniform(axes, n), Stepping("Radau9", tolerance=1e-8)).tip for n in hinges)
    return np.asarray(fine + (fine - coarse) / ((hinges[1] / hinges[0]) ** 2 - 1))


def true_error(scene: fl.Scene, advice: Advice, hinges: tuple[int, int] = FINE) -> float:
    """True tip error of the scene that advice returns [m]."""
    return float(np.linalg.norm(fl.simulate(advice.scene).tip - truth(scene, hinges=hinges), axis=1).max())


def led(*links: str, by: float = 40.0, end: float = 0.3) -> list[fl.PrescribedMotion]:
    zero = (0.0, 0.0)
    return [
        fl.PrescribedMotion(link=link, times=(0.0, end), angle_deg=(0.0, by), rate_deg=zero, acceleration_deg=zero)
        for link in links
    ]


@pytest.mark.slow
@pytest.mark.parametrize("tip", [1e-2, 1e-3, 1e-4])
def test_reported_error_is_between_one_and_three_times_the_true_error(tip: float) -> None:
    scene = arm(0.004, links=2, motion=led("bar0", "bar1"))
    advice = fl.advise(scene, tip)
    assert advice.met
    assert advice.tolerance == pytest.approx(tip * advice.tip_travel)
    assert true_error(scene, advice) <= advice.error <= min(advice.tolerance, 3 * true_error(scene, advice))


@pytest.mark.slow
def test_the_converged_tip_is_more_accurate_than_the_model_with_a_valid_error_bound() -> None:
    scene = arm(0.004, motion=led("bar0"))
    advice = fl.advise(scene, 1e-3)
    assert advice.converged_tip is not None
    assert (
        np.linalg.norm(advice.converged_tip.tip - truth(scene), axis=1).max()
        <= advice.converged_tip.error
        <= advice.error
    )
    assert len(advice.plot().axes[0].lines) == 6  # three coordinates, and where they converge to


def test_a_stiff_arm_gets_rigid_links_without_running_a_flexible_model() -> None:
    advice = fl.advise(arm(0.3, links=2, motion=led("bar0", "bar1")), 1e-2)
    assert advice.met
    assert advice.converged_tip is None
    assert all(link.flex == "rigid" for link in advice.scene.arm.links)
    assert advice.runs <= 6
    assert len(advice.plot().axes[0].lines) == 3
    first, second = (figure := Figure()).subplots(1, 2)
    assert advice.plot(ax=second) is figure
    assert not first.has_data() and len(second.lines) == 3


@pytest.mark.slow
@pytest.mark.parametrize(("thick", "load", "tip"), [(0.012, 2.0, 1e-2), (0.008, 1.0, 3e-2), (0.008, 1.0, 0.2)])
def test_advice_is_right_for_a_bar_released_from_its_static_sag(thick: float, load: float, tip: float) -> None:
    scene = arm(thick, **{"tip.mass": load, "initial.joint_deg": (-20.0,), "initial.passive": "static"})
    advice = fl.advise(scene, tip)
    assert advice.met
    assert true_error(scene, advice, (8, 12)) <= advice.error


@pytest.mark.slow
def test_a_planar_arm_gets_a_planar_model_and_a_skew_arm_a_spatial_one() -> None:
    plane = fl.advise(arm(0.004, motion=led("bar0")), 1e-3).scene
    assert [link.flex for link in plane.arm.links] == ["z"]
    assert fl.lump(plane).is_planar
    skew = arm(0.004, links=2, motion=led("bar0"), gravity=(0.0, 0.0, -9.81))
    bent = skew.varied({"link.bar1.mount.rpy_deg": (0.0, 0.0, 90.0), "link.bar1.joint.locked": True})
    assert fl.advise(bent, 1e-2).scene.arm.links[0].flex == "xyz"  # the weight of the second bar twists the first


@pytest.mark.slow
def test_only_the_soft_link_gets_hinges() -> None:
    scene = arm(0.3, links=2, motion=led("bar0", "bar1"))
    soft = scene.varied({"section.thin": scene.arm.sections["square"], "link.bar1.section": "thin"})
    soft = soft.varied({"section.thin.height": 0.004, "section.thin.width": 0.004})
    assert [link.flex for link in fl.advise(soft, 1e-2).scene.arm.links] == ["rigid", "z"]


@pytest.mark.slow
@pytest.mark.parametrize("passive", ["zero", "static"])
def test_advice_works_for_an_arm_whose_joints_are_all_locked(passive: str) -> None:
    pushed = {"initial.passive": passive, "wrench.force": (0.0, 1.0, 0.0)}
    scene = arm(0.006, locked=True, **pushed, **{"material.steel.loss_time": 1e-3})  # damped: reference is unique
    if passive == "static":  # at rest in equilibrium: a tolerance relative to zero motion is zero
        assert not fl.advise(scene, "1 mm").error > 1e-3
        with refused(fl.errors.ArgumentError, "no-motion"):
            fl.advise(scene, 1e-3)
        with refused(fl.errors.ArgumentError, "no-motion"):
            fl.advise(replace(scene, gravity=(0.0, 0.0, 0.0), wrench=fl.Wrench()), 1e-3)
        return
    advice = fl.advise(scene, 1e-2)
    assert advice.met
    assert advice.scene.arm.links[0].flex == "z"
    assert true_error(scene, advice) <= advice.error


PUSH = ((0.0, 0.0, 0.0), (0.0, 5.0, 0.0))
ACTS: dict[str, dict[str, object]] = {
    "a wrench": {"wrench": fl.Wrench(force=PUSH[1])},
    "one that follows the tip": {"wrench": fl.Wrench(force=PUSH[1], frame="tip")},
    "a table of it": {"wrench": fl.Wrench(times=(0.0, 0.3), forces=PUSH)},
    "a held one": {"wrench": fl.Wrench(times=(0.0, 0.125), forces=PUSH, hold=True), "run.tolerance": 1e-4},
    "gains": {"drive": fl.Drive(kind="pd", kp=(400.0,), kd=(40.0,), target_deg=(30.0,))},
    "dry friction": {"link.1.joint.coulomb": 1.0, "link.1.joint.coulomb_width": 0.1},
    "an elastic gear": {"link.1.joint": fl.Joint(armature=0.05, gear_stiffness=500.0)},
}


@pytest.mark.slow
@pytest.mark.parametrize("what", ACTS)
def test_advice_is_right_for_every_kind_of_load(what: str) -> None:
    scene = arm(0.01, **ACTS[what])
    advice = fl.advise(scene, 1e-2)
    assert advice.met
    assert true_error(scene, advice, (8, 12)) <= advice.error


@pytest.mark.slow
def test_vibrations_above_the_band_are_ignored() -> None:
    scene = arm(0.01, **{"run.step": 0.005, "run.sample": 0.005, "motion": led("bar0", end=0.1)})

    def cost(advice: Advice) -> float:
        run = fl.simulate(advice.scene)
        assert run.steps is not None
        return run_cost(run.chain, run.steps.method, run.steps.evaluations)

    assert cost(fl.advise(scene, "3 mm", band=2.0)) < cost(fl.advise(scene, "3 mm"))


class Watch:
    """A fake clock and fake runs: code loading takes 9 units once, preparing a scene 2 units once, the steps 1 unit."""

    def __init__(self, unit: float = 1.0) -> None:
        self.now, self.made, self.known, self.unit = 0.0, list[object](), list[object](), unit  # unit in s

    def __call__(self) -> float:
        return self.now

    def scene(self) -> object:
        self.made.append(object())
        return self.made[-1]

    def simulate(self, scene: object) -> None:
        self.now += self.unit * (10.0 if not self.known else 1.0 if scene in self.known else 3.0)
        self.known.append(scene)

    def run_time(self, enough: float, monkeypatch: pytest.MonkeyPatch) -> tuple[float, float]:
        monkeypatch.setattr("flexlink.advice.advise.thread_time", self)
        monkeypatch.setattr("flexlink.advice.advise.simulate", self.simulate)
        return run_time(cast("Callable[[], fl.Scene]", self.scene), enough)


@pytest.mark.parametrize(("enough", "times"), [(0.0, 2), (9.5 / 128, 4), (np.inf, 5)])
def test_run_time_includes_preparation_and_is_the_shortest_of_repeated_runs(enough, times, monkeypatch) -> None:
    watch = Watch(1 / 128)
    assert watch.run_time(enough, monkeypatch) == (3 / 128, 1 / 128)
    assert len(watch.made) == times


def test_a_run_longer_than_5_seconds_is_timed_once(monkeypatch) -> None:
    watch = Watch(1.0)
    assert watch.run_time(np.inf, monkeypatch) == (10.0, 10.0)
    assert len(watch.known) == 1


@pytest.mark.parametrize(
    ("own", "numbers"), [(0.004, ["50", "4 ms"]), (0.2, ["1", "200 ms"]), (np.inf, ["1"]), (0.001, [])]
)
def test_advice_reports_the_number_of_runs_after_which_it_pays_off(own: float, numbers: list[str]) -> None:
    text = payback(0.1, own, 0.002)
    assert re.findall(r"\d+(?: ms)?", text) == numbers
    reviewed("advise: payback", text)
    assert payback(0.1, np.nan, 0.002) == "", "the scene was not timed"


def test_the_original_scene_is_timed_unless_it_fails_or_exceeds_the_time_limit() -> None:
    scene = arm(0.3, links=2)
    fixed = {"run.method": "RK4", "run.step": 1e-4}
    free = {"run.method": "auto", "run.step": None, "run.relative_tolerance": 1e-4}
    for changes in (fixed, free):
        assert 0.0 < own_time(scene.varied(changes), 1.0) < 1.0
        assert own_time(scene.varied(changes), 1e-6) == np.inf
    unstable = arm(links=1).varied({"link.bar0.flex": "z", "link.bar0.segments": 9, **fixed, "run.step": 0.01})
    assert np.isnan(own_time(unstable, 1.0))


def test_advice_does_not_depend_on_measured_times(monkeypatch) -> None:
    scene = arm(0.3, links=2, motion=led("bar0", "bar1"))
    first = fl.advise(scene, 1e-2)
    monkeypatch.setattr("flexlink.advice.advise.thread_time", Watch())
    again = fl.advise(scene, 1e-2)
    assert again.run_time == 0.0 < first.run_time < first.compute_time
    assert again.scene.to_toml() == first.scene.to_toml()
    assert again.lines[:-1] == first.lines[:-1]
    assert again.lines[-1].startswith("cost ")


@pytest.mark.slow
def test_the_reported_horizon_of_a_sensitive_motion_is_right_within_twenty_percent() -> None:
    scene = arm(0.03, links=2, **{"initial.joint_deg": (80.0, 30.0), "run.duration": 3.6})
    advice = fl.advise(scene, 1e-3, budget=0.1)  # the budget limits the predicted cost, which is equal on all machines
    assert not advice.met
    assert any(line.startswith("cannot") for line in advice.lines)
    assert any(line.startswith("sensitive") for line in advice.lines)
    before, after = (truth(scene, flex="z", hinges=hinges) for hinges in ((4, 6), (6, 8)))
    run = SingleRun(problem_of(advice.scene)).finish(Stop(), compared=False)  # `simulate` returns a finer one
    beyond = np.flatnonzero(np.linalg.norm(run.tip - after, axis=1) > advice.tolerance)[0]
    assert np.linalg.norm(after - before, axis=1)[: beyond + 1].max() < 0.1 * advice.tolerance  # converged
    assert 0.8 * scene.run.times[beyond - 1] <= advice.horizon <= scene.run.times[beyond - 1] < scene.run.duration


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({"initial.q": (0.0,)}, "hinge-state-with-advice"),
        ({"run.duration": 0.0}, "no-motion"),
        ({"link.1.material": None, "link.1.section": None}, "no-flexible-link"),
    ],
)
def test_a_scene_that_advice_does_not_cover_is_refused(change: dict[str, object], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        fl.advise(arm(**change))


@pytest.mark.parametrize(
    ("options", "id"),
    [
        ({"tip": 0.0}, "tip-goal"),
        ({"tip": 2.0}, "tip-goal"),
        ({"tip": "2 miles"}, "wrong-type"),
        ({"tip": "2 mm", "deflection": True}, "tip-goal"),
        ({"band": 51.0}, "band-too-wide"),
        ({"budget": 0.0}, "out-of-range"),
    ],
)
def test_arguments_out_of_range_are_refused(options: dict[str, object], id: str) -> None:
    with refused(fl.errors.ArgumentError, id):
        fl.advise(arm(), **options)


def test_a_tip_goal_is_a_fraction_or_a_length() -> None:
    run = fl.RunSettings(sample=0.01, step=0.01)
    assert goal_of(1e-3, deflection=False, band=None, run=run).tolerance(2.0, 0.5) == 2e-3
    assert goal_of(1e-3, deflection=True, band=None, run=run).tolerance(2.0, 0.5) == 5e-4
    assert goal_of("50 µm", deflection=False, band=None, run=run).tolerance(2.0, 0.5) == pytest.approx(5e-5)


def test_a_band_whose_period_exceeds_the_run_still_gives_an_error_at_every_sample() -> None:
    difference = np.ones((30, 1)) * np.array([3.0, 0.0, 4.0])
    assert TipErrorNorm(Goal(1e-3, band=2.0), 0.01).lengths(difference) == pytest.approx(np.full(30, 5.0))


def test_the_oscillator_response_to_a_step_and_a_ramp_is_exact() -> None:
    ω, Δ = 7.0, 0.05
    t = Δ * np.arange(40)
    step = np.ones((40, 1))
    assert oscillator_response(step, ω, Δ, np.zeros(1))[:, 0] == pytest.approx(1 - np.cos(ω * t), abs=1e-12)
    ramp = t[:, None]
    assert oscillator_response(ramp, ω, Δ, np.zeros(1))[:, 0] == pytest.approx(t - np.sin(ω * t) / ω, abs=1e-12)


def test_predicted_costs_grow_with_chain_length_and_are_higher_in_3d() -> None:
    scene = arm(links=2)
    plane, space = (fl.lump(with_model(scene, (Bend(flex, "gauss", 8),) * 2)) for flex in ("z", "xyz"))
    assert bodies_of(plane).tolist() == [0, 2 + 16, 0, 0]
    assert bodies_of(space).tolist() == [0, 2, 0, 16]
    assert run_cost(plane, "RK4", 1000) < run_cost(space, "RK4", 1000) < run_cost(space, "Radau5", 1000)


@pytest.mark.slow
def test_advice_is_refused_if_no_two_models_can_run() -> None:
    with refused(fl.errors.ArgumentError, "too-few-models"):
        fl.advise(arm(0.004, motion=led("bar0")), budget=1e-7)


@pytest.mark.slow
def test_the_advise_command_prints_its_reasons_and_writes_a_scene_that_runs(tmp_path, models, capsys) -> None:
    out = tmp_path / "small.toml"
    options = ["--tip", "1e-2", "--set", "run.duration=0.5", "-o", str(out)]
    assert main(["advise", str(models / "t3_spatial.toml"), *options]) == 0
    printed = capsys.readouterr().out
    for word in ("motion", "rigid", "axes", "link", "step", "error", "cost"):
        assert f"\n{word} " in f"\n{printed}"
    assert fl.simulate(fl.load_scene(out)).tip.shape == (101, 3)


@pytest.mark.slow
def test_the_advise_command_fails_if_no_model_meets_the_tolerance(tmp_path: Path, capsys) -> None:
    pushed = arm(0.006, locked=True, **{"wrench.force": (0.0, 1.0, 0.0)})  # a sudden force excites all modes
    (tmp_path / "pushed.toml").write_text(pushed.to_toml(), encoding="utf-8")
    assert main(["advise", str(tmp_path / "pushed.toml"), "--tip", "1e-2", "--budget", "0.02"]) == 1
    printed = capsys.readouterr().out
    assert "\ncannot " in printed
    assert "\nhorizon " in printed


@pytest.mark.slow
def test_advice_on_an_imported_robot_is_right_and_links_without_beams_stay_rigid() -> None:
    scene = robot_scene(1.0)
    advice = fl.advise(scene, 1e-2)
    assert advice.met
    true = advice_truth.truth(scene, 1e-4, budget=6.0)
    assert true.error < 0.1 * advice.tolerance
    off = np.linalg.norm(fl.simulate(advice.scene).tip - true.tip, axis=1).max()
    allowed = advice.scene.run.tolerance  # of the steps, which a compared run makes much smaller
    assert allowed is not None
    assert off <= advice.error <= min(advice.tolerance, 3 * (off + allowed))
    assert allowed <= advice.tolerance
    column, upper, fore = advice.scene.arm.links
    assert (column.name, column.flex) == ("column", "rigid")
    assert "rigid" not in {upper.flex, fore.flex}


@pytest.mark.slow
def test_the_stated_error_is_right_where_large_bending_in_space_reduces_the_order_of_cells() -> None:
    scene = random_scene(9)
    advice = fl.advise(scene, 1e-4)
    assert advice.met
    assert "lobatto4" in {link.lumping for link in advice.scene.arm.links}
    true = advice_truth.truth(scene, 1e-6, budget=6.0)
    off = np.linalg.norm(fl.simulate(advice.scene).tip - true.tip, axis=1).max()
    assert off - true.error <= advice.error <= min(advice.tolerance, 3 * off)
    assert true.error < 0.02 * advice.tolerance


@pytest.mark.slow
def test_the_advice_case_of_the_study_uses_an_independent_reference() -> None:
    case = load_case(CASES / "advice.toml")
    only = replace(
        decode(case.settings, kind.Settings), first=25, scenes=1, robot=0.0, tumbling=(), released=(),
        tolerances=(1e-2,), grid=(25,),
    )  # fmt: skip
    rows = {row.quantity: row.value for row in kind.run(replace(case, scenes=()), only)}
    judged, met, wrong, cost = (
        rows[name] for name in ("cells judged", "cells met", "met, but is not", "cost over the grid's cheapest")
    )
    assert judged == met == 1
    assert wrong == 0
    assert cost >= 1
    assert {*rows} <= {*case.quantity}


GEAR = 0.5 * 2 * np.sin(0.01 / 2)  # tip displacement [m] of a 0.5 m arm whose gear spring turns by 0.01 rad


@pytest.fixture(scope="module")
def two_masses() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "two_mass_joint.toml")


def test_advice_sweeps_reports_and_trade_agree_on_the_deflection_of_a_gear(two_masses: fl.Scene) -> None:
    run = fl.simulate(two_masses)
    assert deflections(run)[0] == pytest.approx(GEAR, rel=1e-12)
    assert deflections(run).max() == pytest.approx(GEAR, rel=1e-3)  # the tip vibrates with this amplitude
    assert np.array_equal(column_of(run, "deflection [m]"), deflections(run))
    assert np.array_equal(Study(two_masses).bent_by, deflections(run))
    assert np.linalg.norm(seen(run.chain, run.q).bend, axis=1) == pytest.approx(deflections(run), abs=1e-15)


def test_an_advice_goal_relative_to_the_deflection_includes_the_gear(two_masses: fl.Scene) -> None:
    scene = two_masses.varied({"initial": fl.InitialState(joint_deg=(0.0,)), "link.1.material": "steel",
                               "link.1.section": "bar", "material.steel": STEEL, "gravity": (0.0, -9.81, 0.0),
                               "section.bar": fl.Section(shape="circle", diameter=0.02)})  # fmt: skip
    runner = ModelRunner(scene, 1.0)
    refinement = RefinementStudy(
        runner, TipErrorNorm(Goal(1e-2), 1e-3), Goal(1e-2, deflection=True), ("z",), Stepping("Radau5", tolerance=1e-5)
    )
    refinement.refine()
    run = refinement.finest.outcome.run
    assert run is not None
    assert refinement.deflection == deflections(run).max()
    hinges = [c.segment > 0 for c in run.chain.coordinates]
    links_alone = np.linalg.norm(run.tip - fl.tip_position(run.chain, np.where(hinges, 0.0, run.q)), axis=1)
    assert refinement.deflection > 1.5 * links_alone.max()  # the displacement due to the gear is included


def test_the_unbent_configuration_puts_springs_at_their_rest_angles(two_masses: fl.Scene) -> None:
    chain = fl.lump(two_masses)
    hinges = chain.hinges.copy()
    hinges["rest"][chain.stiffness > 0] = 0.3
    assert unbent(dataclasses.replace(chain, hinges=hinges), np.array([0.7, 0.1])) == pytest.approx([0.7, 0.3])


def test_the_band_filter_removes_its_frequency_and_passes_a_tenth_of_it() -> None:
    """The Hann window of two periods of the band has its first zero at the band frequency."""
    t = 1e-3 * np.arange(2001)
    norm = TipErrorNorm(Goal(1e-3, band=10.0), 1e-3)
    fast, slow = (norm.lengths(np.sin(2 * np.pi * f * t)[:, None])[200:-200].max() for f in (10.0, 1.0))
    assert fast < 0.01
    assert slow > 0.95


def test_a_strain_gauge_does_not_hinder_advice_and_is_left_out_where_its_link_is_rigid() -> None:
    gauge = fl.Sensor(name="gauge", kind="strain", link="b", x=0.05, fibre=(0.005, 0.0))
    scene = make_scene(flexible("a", segments=3), flexible("b", segments=3), gravity=(0.0, -9.81, 0.0))
    scene = scene.varied({"sensor": (gauge,), "run": fl.RunSettings(duration=0.2, sample=0.01)})
    loose, strict = (fl.advise(scene, tip=tip) for tip in ("300 mm", "0.02 mm"))
    assert loose.met and strict.met
    for found in (loose, strict):
        bends = found.scene.arm.links[1].flex != "rigid"
        assert [sensor.name for sensor in found.scene.sensor] == ["gauge"] * bends
        assert any(line.startswith("sensor ") for line in found.lines) == (not bends)
    assert not loose.scene.sensor
    assert strict.scene.sensor


def linkage(reach: float, **more: object) -> fl.Scene:
    """A falling four-bar whose third link is pinned to the ground at 0.8 m, and is `reach` long."""
    link = {"flex": "z", "segments": 3, "material": "steel", "section": "bar", "joint": {"axis": [0, 0, 1]}}
    lengths = {"crank": 0.4, "coupler": 1.0, "rocker": reach}
    return scene_from({
        "name": "linkage", "gravity": [0, -9.81, 0],
        "material": {"steel": {"young": 7e9, "density": 1200.0, "loss_time": 1e-3}},
        "section": {"bar": {"shape": "rectangle", "height": 0.012, "width": 0.03}},
        "link": [{"name": name, "length": length, **link} for name, length in lengths.items()],
        "initial": {"joint_deg": [60.0, -33.03, -116.34]},
        "tie": [{"name": "pin", "kind": "point", "link": "rocker", "x": 0.8, "to": {"point": [1.1, 0, 0]}}],
        "run": {"duration": 0.4, "sample": 0.02}, **more,
    })  # fmt: skip


@pytest.mark.parametrize("tip", [0.03, 0.001])
def test_advice_on_a_tied_arm_is_right(tip: float) -> None:
    scene = linkage(1.3)
    found = fl.advise(scene, tip=f"{tip} m")
    assert found.met
    assert true_error(scene, found, hinges=(32, 48)) <= found.error <= tip


def test_advice_is_refused_where_ties_hold_the_tip() -> None:
    with refused(fl.errors.ArgumentError, "tip-held"):
        fl.advise(linkage(0.8), tip="1 mm")
