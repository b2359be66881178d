"""Mistakes of new users are reported at once, with the remedy."""

import copy
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import flexlink as fl
from flexlink.cli.main import build_parser, main
from flexlink.describe.scene import scene_from
from flexlink.engines.read_back import require_joints
from tests.conftest import ROOT
from tests.robots.test_hostile_urdf import joint, robot
from tests.support import words

T3 = tomllib.loads((ROOT / "models" / "t3_spatial.toml").read_text(encoding="utf-8"))
LIMIT = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
PD = {"kind": "pd", "kp": [1.0] * 3, "kd": [1.0] * 3, "target_deg": [0.0] * 3}
Edit = Callable[[dict[str, Any]], Any]
PAPER = str(ROOT / "models" / "paper_fig5.toml")
PYTHON = re.compile(r"\b(float|str|int|joint_m'\?|the default)\b")
"""Python terms that a user need not know, and former wrong hints."""


def edited(*edits: Edit) -> dict[str, Any]:
    """The spatial arm with edits."""
    raw = copy.deepcopy(T3)
    for edit in edits:
        edit(raw)
    return raw


def refused(*edits: Edit) -> str:
    with pytest.raises(fl.errors.SceneError) as caught:
        scene_from(edited(*edits))
    return str(caught.value)


def at(*keys: Any, **values: Any) -> Edit:
    """An edit that puts values into the table at these keys."""

    def edit(raw: dict[str, Any]) -> None:
        for key in keys:
            raw = raw[key]
        raw.update(values)

    return edit


def test_all_mistakes_of_a_file_are_reported_at_once() -> None:
    message = refused(
        at("link", 0, lenght=1.0), at("link", 1, flex=True), at("link", 2, material="stell"), at(gravty=1),
        lambda raw: raw["material"]["aluminium"].pop("density"), lambda raw: raw.pop("name"), at("run", step="fast"),
    )  # fmt: skip
    keys = [text.split(" = ")[0].split(":")[0] for text in message.split("; also ")]
    assert keys == ["gravty", "name", "material.aluminium.density", "link.waist.lenght", "link.upper.flex", "run.step"]
    assert "'stell'" in refused(at("link", 2, material="stell"), at(gravty=1))


@pytest.mark.parametrize(
    ("edit", "id", "named"),
    [
        (at("link", 1, joint={"type": "prismatic"}), "unknown-key", ""),
        (at("link", 1, kind="telescopic"), "unknown-key", ""),
        (at("link", 1, joint="prismatic"), "wrong-value", ""),
        (at("link", 1, joint={"type": "revolute"}), "unknown-key", ""),
        (at(contact={"ground": 0.0}), "unknown-key", ""),
        (at(loop=[{}]), "unknown-key", ""),
        (at(weld=[{"links": ["fore", "base"]}]), "unknown-key", ""),
        (at("link", 2, on=["upper", "base"]), "wrong-value", ""),
        (at("link", 2, parent="waist"), "unknown-key", ""),
        (at("link", 1, joint={"axis": "x"}), "wrong-value", ""),
        (at(gravity=-9.81), "wrong-value", ""),
        (at("link", 1, mount={"xyz": 0.3}), "wrong-value", ""),
        (at(link={"name": "boom"}), "wrong-value", ""),
        (at("link", 1, damping=0.01), "wrong-value", ""),
        (at(drive={"kind": "pd", "kp": 300}), "wrong-value", ""),
        (at(run={"step": 1e-4, "tolerance": 1e-3}), "both-given", ""),
        (at("tip", mass="3kg"), "wrong-value", "in kg"),
        (at("link", 1, length="4 m"), "wrong-value", "in m"),
        (at("initial", joint_deg=["30 deg", 0, 0]), "wrong-value", "in deg"),
        (at("tip", mass="three"), "wrong-value", "in kg"),
        (at("link", 1, segments="5"), "wrong-value", "integer"),
        (at("link", 1, segments=2.5), "wrong-value", "integer"),
        (at("link", 1, joint={"viscous": [1.0]}), "wrong-value", "N m s/rad"),
        (at("initial", joint=[0.0, 0.0, 0.0]), "unknown-key", "'joint_deg'"),
        (at(motor={"inertia": 0.1}), "unknown-key", "joint.armature"),
        (at("material", "aluminium", E=70e9), "unknown-key", "young"),
        (at("material", "aluminium", rho=2700.0), "unknown-key", "density"),
        (at("link", 1, mass=2.0), "unknown-key", "hub"),
        (at("link", 1, flex="z", segments=1), "too-few-segments", "2"),
        (at("link", 1, flex="y"), "wrong-value", "z along the joint's axis"),
        (at("link", 1, mount=[0, 0, 1]), "wrong-value", "xyz, rpy_deg"),
        (at("link", 1, section_tip=0.08), "wrong-value", "[section.NAME]"),
        (at(drive={**PD, "shaper": {}}), "unknown-key", "drive.reference"),
        (at(wrench={"force": [0, 0, 1], "link": "fore"}), "unknown-key", "on"),
        (at(wrench={"force": [0, 0, 1], "hold": True}), "needs-another-key", "times and forces"),
        (at(run={"outputs": "loads"}), "wrong-value", "['loads']"),
        (at(tip=200.0), "wrong-value", "mass, center, inertia"),
        (at("tip", inertia=2.5), "wrong-value", "xx, yy, zz"),
        (at(payload={"mass": 2.0}), "unknown-key", "tip.mass"),
        (at("initial", joint_rad=[0.0, 0.3, 0.0]), "unknown-key", "'joint_deg', in degrees"),
        (at(drive={**PD, "ki": [1.0] * 3}), "key-of-another-kind", "'cascade'"),
        (
            at(drive={**PD, "reference": {"profile": "quintic", "to_deg": [0.0] * 3, "duration": 1.0}}),
            "both-given",
            "reference is also",
        ),
        (at(drive={"kind": "constant", "torques": [1.0] * 3}), "wrong-value", "torque = "),
        (at(wrench={"times": [0.0, 1.0], "force": [[0.0] * 3, [1.0] * 3]}), "wrong-value", "forces"),
    ],
)
def test_the_error_of_a_typical_beginner_mistake_names_the_remedy(edit: Edit, id: str, named: str) -> None:
    with words.refused(fl.errors.SceneError, id) as caught:
        scene_from(edited(edit))
    assert named in str(caught.value)
    assert "'motion'" not in str(caught.value)
    assert not PYTHON.search(str(caught.value))


def test_a_value_with_a_unit_on_the_command_line_is_refused(capsys: Any) -> None:
    assert main(["info", PAPER, "--set", "tip.mass=3kg"]) == 2
    words.refused_line(capsys.readouterr().err, "wrong-value")
    commands = (
        ("simulate", "--tolerance", "1kg"),
        ("simulate", "--set", "tip.mass", "3"),
        ("simulate", "--methd", "RK4"),
    )
    for command, *wrong in (*commands, ("advise", "--band", "fast")):
        with pytest.raises(SystemExit) as ended:
            main([command, PAPER, *wrong])
        assert ended.value.code == 2
        words.reviewed("parser", capsys.readouterr().err)


@pytest.mark.parametrize(("given", "metres"), [("1mm", 1e-3), ("1e-3", 1e-3), ("2.5e2 µm", 2.5e-4), ("0.5 m", 0.5)])
def test_a_length_on_the_command_line_may_have_a_unit(given: str, metres: float) -> None:
    options = build_parser(["simulate"]).parse_args(["simulate", PAPER, "--tolerance", given])
    assert options.tolerance == pytest.approx(metres, rel=1e-15)


def test_an_example_that_is_missing_here_is_copied_by_the_printed_command(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["info", Path(PAPER).name]) == 2
    printed = words.refused_line(capsys.readouterr().err, "cannot-read")
    *command, copied = printed.partition("by: flexlink ")[2].split()
    assert main([*command, copied]) == 0
    assert main(["info", copied]) == 0


@pytest.mark.parametrize(
    ("line", "keys"),
    [("simulate {0} --out r.csv --plot r.png --duration 5ms", "warnings"), ("modes {0} --plot m.png", "modes"),
     ("export {0} -o files", "files notes"), ("loop {1} --plot l.png --kind poles", "poles"), ("info {0}", "scene"),
     ("import {2}", "scene notes warnings"), ("examples crane", "lines"),
     pytest.param("report {0} --set run.duration=0.01 -o page", "page verdicts failures", marks=pytest.mark.slow)],
)  # fmt: skip
def test_json_is_one_document_also_beside_files(line: str, keys: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    command = line.format(PAPER, ROOT / "models" / "ptp_move.toml", ROOT / "examples" / "reach_arm.urdf").split()
    assert main([*command, "--json"]) in (0, 1)
    assert set(keys.split()) <= json.loads(capsys.readouterr().out).keys()


def test_a_path_with_a_wrong_key_names_the_remedy() -> None:
    for path, value, named in (
        ("initial.joint.upper", 30.0, "'joint_deg'"),
        ("link.upper.mass", 2.0, "hub"),
        ("link.upper.material.young", 2e11, "material.aluminium.young"),
    ):
        with words.refused(fl.errors.SceneError, "cannot-set") as caught:
            scene_from(T3).varied({path: value})
        assert named in str(caught.value)


def test_a_fit_of_a_key_that_is_not_a_number_is_refused() -> None:
    flex, tapped = fl.fits.FitParameter(path="link.upper.flex"), fl.fits.FitModes(hertz=(5.5,), deviation=(0.02,))
    problem = fl.fits.FitProblem(scene=scene_from(T3), parameter=(flex,), modes=(tapped,))
    with words.refused(fl.errors.SceneError, "parameter-start") as caught:
        fl.fit(problem)
    assert "young" in str(caught.value)


def test_initial_angles_of_links_instead_of_joints_are_refused_by_their_number() -> None:
    move = fl.load_scene(ROOT / "models" / "ptp_move.toml")
    with words.refused(fl.errors.SceneError, "one-per-joint") as caught:
        fl.simulate(move, q0=[0.3, -0.6])
    assert "11" in str(caught.value)


def test_a_scene_given_instead_of_a_sweep_plan_is_explained(tmp_path: Path) -> None:
    path = tmp_path / "crane.toml"
    path.write_text(tomli_w.dumps(T3), encoding="utf-8")
    for load in (fl.Sweep.load, fl.fits.FitProblem.load):
        with words.refused(fl.errors.SceneError, "is-a-scene") as caught:
            load(path)
        assert "'crane.toml'" in str(caught.value)


def test_a_robot_file_given_instead_of_a_scene_is_explained(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(robot("ab", joint("j", "a", "b", LIMIT)), encoding="utf-8")
    with words.refused(fl.errors.SceneError, "is-xml") as caught:
        fl.load_scene(path)
    assert "flexlink import" in str(caught.value)


def test_lists_of_the_wrong_length_are_reported_together() -> None:
    message = refused(at("initial", joint_deg=[0.0]), at(drive={"kind": "constant", "torque": [1.0]}))
    assert message.split("; also ")[1].startswith("drive.torque = (1.0,): ")


def test_each_mistake_is_reported_once() -> None:
    assert refused(at("run", step=-1.0)).count("run.step") == 1


def test_the_command_line_prints_one_line_for_each_mistake(tmp_path: Path, capsys: Any) -> None:
    raw = copy.deepcopy(T3)
    raw["gravty"] = raw.pop("gravity")
    raw["run"]["step"] = -1.0
    path = tmp_path / "arm.toml"
    path.write_text(tomli_w.dumps(raw), encoding="utf-8")
    assert main(["info", str(path)]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith(f"flexlink: {path}: gravty = ")
    assert "run.step = -1.0" in second and second.endswith("[unknown-key]")


def test_the_initial_state_may_be_left_out() -> None:
    raw = copy.deepcopy(T3)
    raw.pop("initial")
    scene = scene_from(raw)
    assert scene.initial.joint_deg == (0.0, 0.0, 0.0)
    assert scene == scene_from({**raw, "initial": {"joint_deg": [0.0] * 3}})
    assert scene_from({**raw, "initial": {"passive": "static"}}).initial.joint_deg == (0.0, 0.0, 0.0)


def test_error_messages_mark_a_missing_angle_as_a_default() -> None:
    raw = copy.deepcopy(T3)
    raw.pop("initial")
    raw["link"][1].setdefault("joint", {})["limits_deg"] = [10.0, 20.0]
    with words.refused(fl.errors.SceneError, "outside-limits"):
        scene_from(raw)


def test_a_joint_of_an_unsupported_type_is_refused_by_name() -> None:
    with words.refused(fl.errors.ArgumentError, "joint-type-in-file"):
        require_joints([("j", "ball")])


def test_export_creates_its_folder(tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    assert main(["export", PAPER, "--format", "urdf", "--out", str(out)]) == 0
    assert (out / "paper_fig5.urdf").is_file()
    assert main(["export", PAPER, "--out", str(out / "paper_fig5.urdf")]) == 2
