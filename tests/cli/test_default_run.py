"""A scene without a step and a method runs with a default tolerance and a note; with either, its steps are fixed."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.scene import scene_from
from tests.conftest import flexible, make_scene
from tests.support.words import line, refused, reviewed

GRAVITY = (0.0, -9.81, 0.0)
NOTE = "no-step-given"


def arm(**run: Any) -> fl.Scene:
    return make_scene(flexible("a", segments=3), gravity=GRAVITY, run=fl.RunSettings(**run))


@pytest.mark.parametrize(
    ("given", "method", "step"),
    [({"step": 1e-4}, "RK4", 1e-4), ({"method": "RK10"}, "RK10", 1e-4), ({"method": "Radau5"}, "Radau5", 1e-4),
     ({"method": "RK2", "step": 2e-5}, "RK2", 2e-5)],
)  # fmt: skip
def test_a_scene_that_names_a_step_or_a_method_has_fixed_steps(given: Any, method: str, step: float) -> None:
    run = fl.RunSettings(**given)
    assert (run.controlled, run.method, run.fixed_step, run.spacing) == (False, method, step, 0.005)


@pytest.mark.parametrize(
    "given",
    [{}, {"step": 1e-4}, {"step": 0.01}, {"method": "RK10"}, {"method": "auto"}, {"tolerance": 1e-4}, {"sample": 0.01},
     {"duration": 0.0123}, {"relative_tolerance": 1e-3}, {"relative_tolerance": 1e-3, "accuracy": "deflection"},
     {"step": 3e-4, "duration": 0.3}],
)  # fmt: skip
def test_a_scene_file_contains_only_the_settings_of_its_scene(given: Any) -> None:
    scene = arm(**given)
    document = tomllib.loads(scene.to_toml())
    assert scene_from(document) == scene
    assert document.get("run", {}).keys() - {"method"} == given.keys() - {"method"}


@pytest.mark.parametrize(
    ("first", "then", "is_default", "step"),
    [
        ({}, {"run.step": 1e-3}, False, 1e-3),
        ({"run.step": 1e-3}, {"run.step": None, "run.method": None}, True, None),
        ({}, {"run.method": "RK10"}, False, None),
        ({"run.tolerance": 1e-4}, {"run.tolerance": None}, True, None),
        ({"run.tolerance": 1e-4}, {"run.step": 1e-3}, False, 1e-3),
        ({"run.step": 1e-3}, {"run.tolerance": 1e-4}, False, None),
        ({"run.step": 1e-3}, {"run.relative_tolerance": 1e-3}, False, None),
        ({"run.step": 1e-3}, {"run.method": "Radau9", "run.tolerance": 1e-4}, False, None),
    ],
)  # fmt: skip
def test_a_tolerance_replaces_a_step_and_a_step_the_default_tolerance(first, then, is_default, step) -> None:
    run = arm().varied(first).varied(then).run
    assert (run.by_default, run.step) == (is_default, step)
    assert run.controlled == (is_default or not {"run.tolerance", "run.relative_tolerance"}.isdisjoint(then))
    assert run.method == (then.get("run.method") or ("auto" if run.controlled else "RK4"))


@pytest.mark.parametrize(
    ("given", "sample"),
    [({"step": 1e-4}, 0.005), ({"step": 0.01}, 0.01), ({"step": 0.003, "duration": 3.0}, 0.006),
     ({"step": 0.002, "duration": 3.0}, 0.004), ({"duration": 0.0123}, 0.0123 / 2), ({"duration": 0.001}, 0.001),
     ({"step": 5e-4, "duration": 0.0035}, 0.0035), ({"duration": 0.0}, 0.005), ({"step": 0.3, "duration": 0.0}, 0.3)],
)  # fmt: skip
def test_the_default_sample_fits_step_and_duration(given: Any, sample: float) -> None:
    run = fl.RunSettings(**given)
    assert run.spacing == pytest.approx(sample, rel=1e-12)
    assert (run.samples - 1) * run.between == pytest.approx(run.duration, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "id"),
    [
        ({"run.step": 0.003}, "not-a-multiple"),
        ({"run.method": "RK4", "run.sample": 1.5e-4}, "not-a-multiple"),
        ({"run.method": "RK4", "initial.time": 1e-5}, "not-a-multiple"),
        ({"run.method": "auto", "run.step": 1e-3}, "method-and-step"),
        (
            {"drive": {"kind": "pd", "kp": [1.0], "kd": [1.0], "target_deg": [0.0], "rate": 300.0}},
            "not-a-multiple",
        ),
    ],
)  # fmt: skip
def test_error_messages_mark_default_values_as_defaults(changes: Any, id: str) -> None:
    with refused(fl.errors.SceneError, id):
        arm().varied(changes)


def test_a_note_gives_the_default_tolerance_or_step(tmp_path: Path, capsys: Any) -> None:
    path = arm(duration=0.01).save(tmp_path / "arm.toml")
    (note,) = fl.simulate(fl.load_scene(path)).notes
    assert all(part in note for part in ("1.46 mm", "0.001 ", "auto"))
    assert note.id == NOTE
    reviewed(NOTE, note)
    assert main(["simulate", str(path)]) == 0
    assert line(capsys.readouterr().err, "1.46 mm").startswith(f"note: {note}")
    assert main(["simulate", str(path), "--step", "1e-4"]) == 0
    assert "1.46 mm" not in capsys.readouterr().err
    assert fl.simulate(fl.load_scene(path), tolerance=1e-4).notes == ()
    (fixed,) = fl.simulate(fl.load_scene(path), method="RK10").notes
    assert "0.0001 s" in fixed and "RK10" in fixed
    assert fixed.id == NOTE
    reviewed(NOTE, fixed)


def test_the_message_about_a_refused_step_suggests_a_tolerance_first() -> None:
    with refused(fl.errors.UnstableStepError, "unstable-step") as caught:
        fl.simulate(arm(step=0.01))
    _, _, remedies = str(caught.value).partition("; ")
    in_file, option, smaller, insist = map(
        remedies.find, ("relative_tolerance = 1e-3", "--relative-tolerance 1e-3", "step = 0.001", "--insist")
    )
    assert -1 < in_file < option < smaller < insist


def test_a_controller_without_a_rate_needs_fixed_steps() -> None:
    with refused(fl.errors.ArgumentError, "controller-needs-rate"):
        fl.simulate(arm(duration=0.01), control=lambda t, q, qd: [0.0])


def test_sensitivities_with_default_tolerance_and_with_small_fixed_steps_agree() -> None:
    scene = arm(duration=0.05)
    found, fixed = (fl.sensitivities(s, ("tip.mass",)) for s in (scene, scene.varied({"run.step": 2e-5})))
    assert np.abs(found.tip - fixed.tip).max() <= min(4 * found.tip_error[0], 1e-4 * np.abs(fixed.tip).max())


def test_simulators_sweeps_and_engines_use_the_default_steps(tmp_path: Path) -> None:
    scene = arm(duration=0.02)
    assert fl.Simulator(scene).step(duration=0.0123).t == 0.0123
    rows = fl.sweep(fl.Sweep(scene=scene, grid={"tip.mass": [0.0, 1.0]}, quantity={"z": {"of": "tip y [m]"}}))
    assert np.isfinite(rows.column("z")).all()
    assert "RK4" in fl.compare_trajectories(scene, engines=["native"]).steps
