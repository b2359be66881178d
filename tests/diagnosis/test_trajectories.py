"""compare_trajectories() makes a run in several engines and reports engines that differ or cannot run the scene."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.diagnosis import native, trajectories
from flexlink.diagnosis.trajectories import ANGLE_TOLERANCE, CROSS_CHECK_FACTOR
from flexlink.engines import base
from tests.conftest import flexible, make_scene
from tests.support.words import line, refused, refused_line, reviewed

pytestmark = pytest.mark.slow
SPATIAL = Path(__file__).parents[2] / "models" / "t3_spatial.toml"
BOTH = ("pinocchio", "mujoco")


@pytest.fixture
def engines() -> tuple[str, ...]:
    """Engines that the tests need."""
    for name in BOTH:
        pytest.importorskip(name)
    return BOTH


def test_a_scene_with_a_wrench_has_the_same_run_in_every_engine(engines, capsys) -> None:
    table = "wrench={ frame='tip', times=[0, 0.01], moments=[[0, 0, 1], [1, 0, 0]], smooth=true }"
    options = ["--duration", "0.02", "--engines", *engines, "--set", table]
    assert main(["compare", str(SPATIAL), "--trajectory", *options]) == 0
    shown = capsys.readouterr().out
    first = shown.splitlines()[0]
    assert all(part in first for part in ("0.02 s", "RK4", "5e-05 s"))
    assert shown.count(" ok ") == 2
    reviewed("trajectories: compared steps", first)


def test_a_missing_wrench_in_an_engine_is_reported_with_joint_and_time(engines, monkeypatch, capsys) -> None:
    monkeypatch.setattr("flexlink.engines.mujoco.base", SimpleNamespace(**vars(base)))  # the other engine has it
    monkeypatch.setattr(base, "wrench_function", lambda _: None)
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


def test_a_scene_without_fixed_explicit_steps_is_compared_in_stable_steps(engines) -> None:
    for changes, own in (
        ({"run.tolerance": 1e-4}, ("auto",)), ({"run.method": "Radau5", "run.step": 5e-3}, ("Radau5", "0.005 s")),
    ):  # fmt: skip
        scene = fl.load_scene(SPATIAL).varied({**changes, "run.duration": 0.02, "run.sample": 0.01})
        found = fl.compare_trajectories(scene, engines=engines[:1])
        assert found.passed
        steps, _, reason = found.steps.partition("(")
        assert "RK4" in steps
        assert all(part in reason for part in own)
        reviewed("trajectories: stable steps", found.steps)


def test_an_engine_that_cannot_run_a_scene_is_named_with_the_reason(engines) -> None:
    motion = fl.PrescribedMotion(
        link="a", times=(0.0, 1.0), angle_deg=(0.0, 20.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    scene = make_scene(flexible("a", segments=2), motion=(motion,)).varied({"run.duration": 0.05})
    found = fl.compare_trajectories(scene)
    assert [row.engine for row in found.rows] == ["pinocchio"]
    assert found.passed
    (reason,) = (reason for reason in found.refused if reason.startswith("mujoco: "))
    assert "'a'" in reason
    assert reason in str(found)
    reviewed("engine-does-not-support", reason)
    with refused(fl.errors.ArgumentError, "engine-does-not-support"):
        fl.compare_trajectories(scene, engines=["mujoco"])


def test_a_run_that_diverges_in_an_engine_disagrees_and_its_samples_are_compared(monkeypatch) -> None:
    def ends_early(_: native.NativeEngine, scene: fl.Scene) -> None:
        run = fl.simulate(scene, duration=0.01)
        raise fl.errors.DivergenceError("infinite", run)

    monkeypatch.setattr(native.NativeEngine, "integrate", ends_early)
    found = fl.compare_trajectories(fl.load_scene(SPATIAL), engines=["native"], duration=0.02)
    assert not found.passed
    assert found.rows[0].q == 0.0
    assert str(found).endswith("native: infinite")


def test_a_missing_engine_is_left_out_unless_it_is_named_or_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def differs(ours: fl.Trajectory, scene: fl.Scene, name: str, _: None) -> trajectories.RunDifference:
        if name in absent:
            raise fl.errors.MissingDependencyError(name)
        return real(ours, scene, "native", None)

    real, absent, scene = trajectories._difference, ["mujoco"], fl.load_scene(SPATIAL)
    monkeypatch.setattr(trajectories, "_difference", differs)
    monkeypatch.setattr(trajectories, "ENGINES", ("native", "mujoco", "pinocchio"))
    assert len(fl.compare_trajectories(scene, duration=0.01).rows) == 1
    with pytest.raises(fl.errors.MissingDependencyError):
        fl.compare_trajectories(scene, engines=["mujoco", "pinocchio"], duration=0.01)
    absent.append("pinocchio")
    with pytest.raises(fl.errors.MissingDependencyError):
        fl.compare_trajectories(scene, duration=0.01)


def test_in_chaotic_motion_engines_may_differ_as_much_as_two_of_our_runs(monkeypatch) -> None:
    scene = fl.load_scene(SPATIAL)
    ours, other = (fl.simulate(scene, duration=0.01, solver=name) for name in ("articulated", "lu"))
    apart = np.abs(other.q - ours.q).max()
    assert 0 < apart < ANGLE_TOLERANCE
    monkeypatch.setattr(native.NativeEngine, "integrate", lambda *_: (other.t, other.q, other.qd))
    with monkeypatch.context() as without:
        without.setattr(trajectories, "_cross_check", lambda *_: pytest.fail("a cross-check, but all engines agree"))
        calm = fl.compare_trajectories(scene, engines=["native"], duration=0.01)
    assert calm.rows[0].explained == ANGLE_TOLERANCE
    monkeypatch.setattr(trajectories, "ANGLE_TOLERANCE", 0.0)
    twins = fl.compare_trajectories(scene, engines=["native"], duration=0.01)
    assert twins.rows[0].explained == CROSS_CHECK_FACTOR * apart
    assert twins.passed
    assert "warning: " not in str(twins)
    monkeypatch.setattr(trajectories, "MEANINGFUL_TOLERANCE", 0.0)
    reviewed("trajectories: motion amplifies errors", line(str(twins), "warning: "))


@pytest.mark.parametrize(
    ("options", "id", "named"),
    [
        (["--trajectory", "--file", "a.xml"], "no-effect", "--file: "),
        (["--trajectory", "--samples", "9"], "no-effect", "--samples: "),
        (["--duration", "1"], "no-effect", "--duration: "),
        (["--trajectory", "--duration", "0"], "out-of-range", "duration = 0.0: "),
        (["--trajectory", "--engines", "bullet"], "unknown-name", "engine = 'bullet': "),
    ],
)
def test_options_without_effect_and_wrong_values_are_refused(options: list[str], id: str, named: str, capsys) -> None:
    assert main(["compare", str(SPATIAL), *options]) == 2
    assert named in refused_line(capsys.readouterr().err, id)
