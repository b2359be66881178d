"""Remedies that messages print are applied as printed, and succeed: the mistake is gone."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import flexlink as fl
import tests.cli.test_from_files as files
from flexlink.cli.main import main
from flexlink.describe.plausibility.hints import hints
from flexlink.dynamics.notes import defaults, notes
from tests.conftest import ROOT, flexible, make_scene
from tests.describe import test_hints, test_scene
from tests.support.words import reviewed


@pytest.mark.parametrize(("mistake", "path", "unit"), test_hints.PLANTED, ids=lambda x: x if isinstance(x, str) else "")
def test_the_value_that_a_hint_prints_removes_it(mistake: dict[str, Any], path: str, unit: str) -> None:
    scene = test_hints.CRANE.varied(mistake)
    (hint,) = hints(scene)
    printed = re.search(r"in SI (\[.*?\]|[-+.\de]+)|in degrees (\[.*\])|would be ([\d.]+)|rate is ([\d.]+)", hint)
    if printed is None or "\n" in hint:
        pytest.skip("names another key, or only the unit")
    value = tomllib.loads(f"x = {next(filter(None, printed.groups())).replace('e+', 'e')}")["x"]
    mended = scene.varied(of_parts(scene, path, value))
    assert [each for each in hints(mended) if each.startswith(f"{path} = ")] == []


def of_parts(scene: fl.Scene, path: str, value: Any) -> dict[str, Any]:
    """The change of a path whose last part may be a list that the hint prints as one number."""
    (before,) = scene.values_at(path.partition("[")[0])
    if "[" in path or (isinstance(before, list) and not isinstance(value, list)):
        return {path.partition("[")[0]: [item * 1e-3 for item in before] if "[" in path else [value] * len(before)}
    tube = {"section.tube.inner": scene.arm.sections["tube"].inner * 1e-3} if path == "section.tube.outer" else {}
    return {path: value, **tube}


SUGGESTED = [what for what, (*_, id, parts) in test_scene.BAD.items() if "'?" in str(parts) and id != "unknown-link"]


@pytest.mark.parametrize("what", SUGGESTED)
def test_a_suggested_name_makes_the_scene_right(what: str, tmp_path: Path) -> None:
    old, new, *_ = test_scene.BAD[what]
    path = tmp_path / "scene.toml"
    path.write_text(test_scene.PAPER.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(fl.errors.FlexlinkError) as caught:
        fl.load_scene(path)
    suggested = re.search(r"did you mean '(\w+)'\?", str(caught.value))
    (wrong,) = re.findall(r"(?:\.|: )(\w+) = [^:]*: unknown key|= '(\w+)'", str(caught.value))[:1]
    changed = new.replace(wrong[0] or wrong[1], suggested[1])
    path.write_text(test_scene.PAPER.replace(old, changed, 1), encoding="utf-8")
    fl.load_scene(path)


@pytest.mark.parametrize("what", ["a joint misspelt", "no time"])
def test_a_renamed_column_is_read(what: str, tmp_path: Path) -> None:
    table, text, _ = files.MISTAKES[what]
    message = refusal(tmp_path, table, text)
    wanted, there = re.findall(r"no column '(.*?)'.*if '(.*?)' is meant", message)[0]
    written(tmp_path, table, text.replace(there, wanted))


def test_a_column_of_zeros_drives_no_other_joint(tmp_path: Path) -> None:
    table, text, _ = files.MISTAKES["a driven joint is left out"]
    wanted, value = re.findall(r"no column '(.*?)'.*column of (zeros)", refusal(tmp_path, table, text))[0]
    assert value
    head, *rows = text.splitlines()
    scene = written(tmp_path, table, "\n".join([f"{head},{wanted}", *(f"{row},0" for row in rows)]))
    assert scene.drive.torques == ((1.0, 0.0),)


def test_degrees_in_a_column_of_radians_are_noted_and_the_new_head_mends_it(tmp_path: Path) -> None:
    table, text = files.MOTION, files.GOOD.replace("[deg]", "[rad]")
    (hint,) = hints(written(tmp_path, table, text))
    reviewed("likely-degrees", hint)
    right, wrong = re.findall(r"write (\[\w+\]).* instead of (\[\w+\])", hint)[0]
    mended = written(tmp_path, table, text.replace(wrong, right))
    assert hints(mended) == () and max(mended.motion[0].angle_deg) == pytest.approx(19.0)


def written(folder: Path, table: str, text: str) -> fl.Scene:
    (folder / "run.csv").write_text(text, encoding="utf-8")
    (folder / "scene.toml").write_text(f"{make_scene(*files.LINKS).to_toml()}\n{table}", encoding="utf-8")
    return fl.load_scene(folder / "scene.toml")


def refusal(folder: Path, table: str, text: str) -> str:
    with pytest.raises(fl.errors.FlexlinkError) as caught:
        written(folder, table, text)
    return str(caught.value)


def test_times_in_milliseconds_called_seconds_are_mended_by_the_printed_head(tmp_path: Path) -> None:
    text = "t [s],q upper [deg]\n" + "".join(f"{10 * k},{k}\n" for k in range(20))
    head = re.search(r"name the column (t \[ms\])", refusal(tmp_path, files.MOTION, text))[1]
    assert written(tmp_path, files.MOTION, text.replace("t [s]", head)).motion[0].times[-1] == pytest.approx(0.19)


@pytest.mark.parametrize("segments", [0, 1, -3])
def test_the_number_of_segments_that_a_refusal_names_is_accepted(segments: int) -> None:
    with pytest.raises(fl.errors.SceneError) as caught:
        flexible("a", segments=segments)
    assert flexible("a", segments=int(re.search(r"such as (\d+)", str(caught.value))[1])).segments > 2


@pytest.mark.parametrize("beyond", [3e-6, 8e-3])
def test_noise_at_a_stop_passes_with_a_warning_of_the_run(beyond: float) -> None:
    cart = fl.Link(name="cart", joint=fl.Joint(kind="prismatic", limits_m=(0.0, 8.0)), hub=files.HUB)
    move = fl.PrescribedMotion(link="cart", times=(0.0,), position_m=(-beyond,), rate_m=(0.0,), acceleration_m=(0.0,))
    run = fl.simulate(make_scene(cart, motion=(move,), initial=fl.InitialState(joint_m=(-beyond,))), duration=0.01)
    (warning,) = run.warnings
    assert warning.id.endswith("past-limits")


def test_the_wider_limits_that_a_refusal_prints_hold_the_complete_motion() -> None:
    rows = {
        "times": (0.0, 1.0, 2.0),
        "angle_deg": (0.0, 46.0, 60.0),
        "rate_deg": (0,) * 3,
        "acceleration_deg": (0,) * 3,
    }
    moved = make_scene(fl.Link(name="a", hub=files.HUB), motion=(fl.PrescribedMotion(link="a", **rows),))
    with pytest.raises(fl.errors.SceneError) as caught:
        moved.varied({"link.a.joint.limits_deg": [-90.0, 45.0]})
    wider = tomllib.loads(f"x = {str(caught.value).partition('widen it to ')[2]}")["x"]
    mended = moved.varied({"link.a.joint.limits_deg": wider})
    assert mended.arm.links[0].joint.limits == (-90.0, 60.0)


CRANE = test_hints.CRANE.varied({"sensor": [], "wrench": fl.Wrench()})
NOTED = {
    "springs-start-slack": CRANE.varied({"drive": {**test_hints.PD, "target_deg": [90.0, -45.0], "gravity": "static"}}),
    "joint-unheld": CRANE.varied({"drive.torque": [9000.0, 0.0], "initial.joint_deg": [0.0, 0.0]}),
    "base-falls": CRANE.varied({"base": {"kind": "free", "mass": 10.0, "inertia": [1, 1, 1]}}),
    "few-hinges": CRANE.varied({"link.boom.segments": 3, "sensor": list(test_hints.CRANE.sensor)}),
}  # fmt: skip
"""Scenes with a note whose remedy is a value."""


@pytest.mark.parametrize("id", NOTED)
def test_the_value_in_a_note_removes_it(id: str) -> None:
    scene = NOTED[id]
    (note,) = (each for each in notes(scene) if each.id == id)
    values = {
        "springs-start-slack": lambda text: {"initial.passive": re.search(r"passive = '(\w+)'$", text)[1]},
        "joint-unheld": lambda text: {"link.jib.joint.locked": re.search("joint.locked = (true)", text)[1] == "true"},
        "base-falls": lambda text: {"gravity": tomllib.loads(f"x = {text.rpartition('set ')[2]}")["x"]},
        "few-hinges": lambda text: {"link.boom.segments": int(re.search(r"use (\d+) segments", text)[1])},
    }
    mended = scene.varied(values[id](note))
    assert id not in {each.id for each in (*defaults(mended), *notes(mended))}


def test_the_steps_that_replace_an_unstable_one_run() -> None:
    scene = make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0)).varied({"run.duration": 0.02, "run.sample": 0.01})
    with pytest.raises(fl.errors.UnstableStepError) as caught:
        fl.simulate(scene, step=1e-2)
    printed = dict(re.findall(r"\b(relative_tolerance|step) = ([\d.e-]+)", str(caught.value)))
    assert len(printed) == 2
    for key, value in printed.items():
        assert fl.simulate(scene, **{key: float(value)}).t[-1] == pytest.approx(0.02)


@pytest.mark.parametrize("name", ["rk45", "ode45"])
def test_the_method_that_is_meant_by_a_name_in_another_program_runs(name: str, capsys) -> None:
    command = ["simulate", str(ROOT / "models" / "paper_fig5.toml"), "--duration", "0.005", "--method"]
    assert main([*command, name]) == 2
    assert main([*command, re.search(r"mean '(\w+)'", capsys.readouterr().err)[1]]) == 0


def test_every_key_of_a_file_with_two_letters_exchanged_is_put_right_by_the_suggestion(tmp_path: Path) -> None:
    text = (ROOT / "models" / "t3_spatial.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    keys = {key for key in re.findall(r"^(\w{4,})\s*=", text, re.MULTILINE) if key[1] != key[2]}
    assert len(keys) > 15
    for key in keys:
        path.write_text(text.replace(key, key[0] + key[2] + key[1] + key[3:]), encoding="utf-8")
        with pytest.raises(fl.errors.SceneError) as caught:
            fl.load_scene(path)
        suggested = re.search(r"did you mean '(\w+)'", str(caught.value))
        assert suggested[1] == key


VALUES = {
    "hinges-of-rule": ({"link.upper.segments": 4, "link.upper.lumping": "gauss"}, r"segments", r"are (\d+) or"),
    "segments-of-rule": ({"link.upper.segments": 3, "link.upper.lumping": "gregory"}, "segments", r"least (\d+) seg"),
    "rigid-segments": ({"link.upper.flex": "rigid", "link.upper.segments": 3}, "flex", r"set flex = '(\w+)'"),
}
"""Changes of the paper's scene that are refused, the key of the remedy, and its value."""


@pytest.mark.parametrize("id", VALUES)
def test_the_value_in_a_refusal_is_accepted(id: str) -> None:
    changes, key, pattern = VALUES[id]
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    with pytest.raises(fl.errors.SceneError) as caught:
        scene.varied(changes)
    assert caught.value.id == id
    value = re.search(pattern, str(caught.value))[1]
    scene.varied({**changes, f"link.upper.{key}": int(value) if value.isdecimal() else value})


def test_a_column_without_a_unit_gets_a_head_that_is_read(tmp_path: Path) -> None:
    bare = files.GOOD.replace("q upper [deg]", "q upper")
    head = re.search(r"as in '(.*?)'", refusal(tmp_path, files.MOTION, bare))[1]
    assert written(tmp_path, files.MOTION, bare.replace("q upper", head)) == written(tmp_path, files.MOTION, files.GOOD)


def test_a_robot_given_as_a_scene_is_imported_by_the_printed_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/><axis xyz="0 0 1"/>'
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    robot = f'<robot name="r"><link name="a"/><link name="b">{body}</link>{joint}</robot>'
    (tmp_path / "arm.urdf").write_text(robot, encoding="utf-8")
    assert main(["info", "arm.urdf"]) == 2
    command = re.search(r"flexlink (import \S+)", capsys.readouterr().err)[1]
    assert main([*command.split(), "-o", "scene.toml"]) == 0
    assert main(["info", "scene.toml"]) == 0
