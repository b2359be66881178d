"""compare_trajectories(): the same run in several engines, and what is said of those that differ or cannot run it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import flexible, make_scene

import flexlink as fl
from flexlink.cli.main import main
from flexlink.diagnosis import native, trajectories
from flexlink.diagnosis.trajectories import ANGLE_TOLERANCE, CROSS_CHECK_FACTOR
from tests.words import refused

pytestmark = pytest.mark.slow
SPATIAL = Path(__file__).parent.parent / "models" / "t3_spatial.toml"
BOTH = ("pinocchio", "mujoco")


@pytest.fixture
def engines() -> tuple[str, ...]:
    """Those that tests need."""
    for name in BOTH:
        pytest.importorskip(name)
    return BOTH


def test_a_scene_runs_alike_in_every_engine_with_all_that_acts(engines, capsys) -> None:
    table = "wrench={ frame='tip', times=[0, 0.01], moments=[[0, 0, 1], [1, 0, 0]], smooth=true }"
    options = ["--duration", "0.02", "--engines", *engines, "--set", table]
    assert main(["compare", str(SPATIAL), "--trajectory", *options]) == 0
    shown = capsys.readouterr().out
    assert "0.02 s in RK4 steps of 5e-05 s" in shown
    assert shown.count(" ok ") == 2


def test_an_engine_that_leaves_out_the_wrench_is_told_by_joint_and_time(engines, monkeypatch, capsys) -> None:
    monkeypatch.setattr("flexlink.engines.steps.wrench_function", lambda _: None)
    found = fl.compare_trajectories(fl.load_scene(SPATIAL), engines=engines, duration=0.02)
    wrong, right = found.rows
    assert not found.passed
    assert not wrong.passed
    assert right.passed
    assert wrong.q > 1e-6
    assert wrong.tip > 1e-6
    assert wrong.time == 0.02
    assert wrong.joint in fl.lump(fl.load_scene(SPATIAL)).joint_names
    assert main(["compare", str(SPATIAL), "--trajectory", "--duration", "0.01", "--engines", "pinocchio"]) == 1
    assert "FAILED" in capsys.readouterr().out


def test_a_scene_with_a_tolerance_is_compared_in_stable_steps_and_says_so(engines) -> None:
    for changes in ({"run.tolerance": 1e-4}, {"run.method": "Radau5", "run.step": 5e-3}):
        scene = fl.load_scene(SPATIAL).varied({**changes, "run.duration": 0.02, "run.sample": 0.01})
        found = fl.compare_trajectories(scene, engines=engines[:1])
        assert found.passed
        assert "RK4 steps of" in found.steps
        assert "of the stability limit (the scene has " in found.steps


def test_an_engine_that_cannot_run_a_scene_is_named_with_the_reason(engines) -> None:
    motion = fl.PrescribedMotion(
        link="a", times=(0.0, 1.0), angle_deg=(0.0, 20.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    scene = make_scene(flexible("a", segments=2), motion=(motion,)).varied({"run.duration": 0.05})
    found = fl.compare_trajectories(scene)
    assert [row.engine for row in found.rows] == ["pinocchio"]
    assert found.passed
    assert any(reason.startswith("mujoco: ") and "is prescribed" in reason for reason in found.refused)
    assert "not compared: mujoco: " in str(found)
    with refused(fl.errors.ArgumentError, "engine-does-not-support"):
        fl.compare_trajectories(scene, engines=["mujoco"])


def test_a_run_that_diverges_elsewhere_disagrees_by_what_there_is_of_it(monkeypatch) -> None:
    def ends_early(_: native.NativeEngine, scene: fl.Scene) -> None:
        run = fl.simulate(scene, duration=0.01)
        raise fl.errors.DivergenceError("no longer finite", run)

    monkeypatch.setattr(native.NativeEngine, "integrate", ends_early)
    found = fl.compare_trajectories(fl.load_scene(SPATIAL), engines=["native"], duration=0.02)
    assert not found.passed
    assert found.rows[0].q == 0.0
    assert str(found).endswith("native: no longer finite")


def test_motion_that_multiplies_rounding_may_differ_by_what_a_twin_does(monkeypatch) -> None:
    scene = fl.load_scene(SPATIAL)
    ours, other = (fl.simulate(scene, duration=0.01, solver=name) for name in ("articulated", "lu"))
    apart = np.abs(other.q - ours.q).max()
    assert 0 < apart < ANGLE_TOLERANCE
    monkeypatch.setattr(native.NativeEngine, "integrate", lambda *_: (other.t, other.q, other.qd))
    with monkeypatch.context() as without:
        without.setattr(trajectories, "_cross_check", lambda *_: pytest.fail("a cross-check where no engine is off"))
        calm = fl.compare_trajectories(scene, engines=["native"], duration=0.01)
    assert calm.rows[0].explained == ANGLE_TOLERANCE
    monkeypatch.setattr(trajectories, "ANGLE_TOLERANCE", 0.0)
    twins = fl.compare_trajectories(scene, engines=["native"], duration=0.01)
    assert twins.rows[0].explained == CROSS_CHECK_FACTOR * apart
    assert twins.passed
    assert "warning" not in str(twins)
    monkeypatch.setattr(trajectories, "MEANINGFUL_TOLERANCE", 0.0)
    assert "warning: this motion amplifies rounding so much" in str(twins)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--trajectory", "--file", "a.xml"], "--file a.xml: has no effect here; leave it out, or"),
        (["--trajectory", "--samples", "9"], "--samples 9: has no effect here"),
        (["--duration", "1"], "--duration 1.0: has no effect here; add --trajectory"),
        (["--trajectory", "--duration", "0"], "duration = 0.0: must be a finite number > 0"),
        (["--trajectory", "--engines", "bullet"], "engine = 'bullet': unknown"),
    ],
)
def test_what_has_no_effect_is_refused_by_name(options: list[str], told: str, capsys) -> None:
    assert main(["compare", str(SPATIAL), *options]) == 2
    assert told in capsys.readouterr().err
