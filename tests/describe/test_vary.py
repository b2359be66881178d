"""Scene.varied() changes values by path, with the keys of the file, and checks the result like a file."""

import math
import random
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.variants import Variants
from flexlink.dynamics.notes import notes
from tests.conftest import MODELS, ROOT, flexible, make_scene
from tests.support.words import refused, refused_line, reviewed

PAPER = ROOT / "models" / "paper_fig5.toml"


@pytest.fixture
def paper() -> fl.Scene:
    return fl.load_scene(PAPER)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_scene_without_changes_is_identical(path: Path) -> None:
    scene = fl.load_scene(path)
    assert scene.varied({}) == scene
    assert scene.varied({"run.step": scene.run.step, "link.1.length": scene.arm.links[0].length}) == scene


def test_changes_equal_the_same_values_in_the_file(paper: fl.Scene, tmp_path: Path) -> None:
    """Every kind of path is compared with a file that contains the same values."""
    raw = tomllib.loads(PAPER.read_text(encoding="utf-8"))
    raw["material"]["aluminium"]["young"] = 35e9
    raw["link"][1] |= {"segments": 9, "lumping": "gauss", "damping": {"ratio": 0.01, "at_hz": 4.0}}
    raw["link"][2] |= {"segments": 9, "mount": {"rpy_deg": [0.0, 0.0, 30.0], "xyz": [0.0, 0.0, 0.1]}}
    raw["gravity"] = [0.5, 0.0, 9.81]
    raw["initial"] |= {"joint_deg": [0.0, -80.0, -45.0], "rate_deg": [0.0, 3.0, 0.0]}
    raw["section"]["thin"] = {"shape": "circle", "diameter": 0.01}
    raw["run"]["step"] = 5e-5
    raw["drive"] = {"kind": "constant", "torque": [0.0, 2.0, 2.0]}
    by_hand = tmp_path / "by_hand.toml"
    by_hand.write_text(tomli_w.dumps(raw), encoding="utf-8")
    changes: dict[str, object] = {
        "run.step": np.float64(5e-5), "material.aluminium.young": 35e9, "link.*.segments": np.int64(9),
        "link.upper.lumping": "gauss", "link.2.damping": fl.Damping(ratio=0.01, at_hz=4.0),
        "link.'fore'.mount.rpy_deg": np.array([0.0, 0.0, 30.0]), "initial.joint_deg.fore": -45,
        "initial.rate_deg.upper": 3.0, "section.thin": {"shape": "circle", "diameter": 0.01},
        "drive": {"kind": "constant"}, "drive.torque.*": 2.0, "gravity.x": 0.5, "link.fore.mount.xyz.z": 0.1,
    }  # fmt: skip
    assert paper.varied(changes) == fl.load_scene(by_hand)


def test_the_scene_itself_does_not_change(paper: fl.Scene) -> None:
    paper.varied({"link.*.segments": 9, "initial.joint_deg.*": 1.0})
    assert paper == fl.load_scene(PAPER)


def test_a_star_selects_every_link_on_which_the_key_has_an_effect(paper: fl.Scene) -> None:
    links = paper.varied({"link.*.lumping": "gauss", "link.*.joint.viscous": 2.0, "link.*.hub.mass": 3.0}).arm.links
    assert [link.lumping for link in links] == [paper.arm.links[0].lumping, "gauss", "gauss"]
    assert [link.joint.viscous for link in links] == [0.0, 2.0, 2.0]  # the waist is locked
    assert [link.hub.mass for link in links] == [3.0, 3.0, 3.0]
    thick = fl.Section(shape="circle", diameter=0.1)
    thicker = paper.varied({"section.thick": thick, "link.*.section": "thick"})
    assert [link.section for link in thicker.arm.links] == [None, "thick", "thick"]
    start = paper.varied({"initial.joint_deg.*": 5.0}).initial
    assert start.joint_deg == (5.0, 5.0, 5.0)


TOGETHER: dict[str, dict[str, object]] = {
    "rigid": {"link.*.flex": "rigid", "link.*.segments": 1, "tip.mass": 2.0},
    "one rigid": {"link.fore.flex": "rigid", "link.*.segments": 9, "link.upper.segments": 7},
    "one bends": {"link.waist": {"name": "waist", "length": 0.3}, "link.waist.flex": "yz", "link.waist.segments": 3,
                  "link.waist.material": "aluminium", "link.waist.section": "thin", "link.waist.lumping": "midpoint",
                  "section.thin": {"shape": "circle", "diameter": 0.01}, "section.thin.diameter": 0.02},
    "unlocked": {"link.waist.joint.locked": False, "drive": {"kind": "constant"}, "drive.torque.*": 2.0,
                 "drive.torque.fore": 1.0, "initial.rate_deg.*": 3.0},
    "whole and part": {"initial.joint_deg": [0.0, 1.0, 2.0], "initial.joint_deg.*": 4.0, "initial.joint_deg.fore": 5.0},
    "slides": {"link.fore.joint": {"kind": "prismatic"}, "link.fore.joint.axis": [1, 0, 0], "initial.joint_m.*": 0.1,
               "initial.joint_deg": None},
    "steps": {"run": {"method": "RK4", "duration": 0.1}, "run.step": 1e-4, "gravity": [0, 0, 1], "gravity.x": 1.0},
}  # fmt: skip


@pytest.mark.parametrize("changes", TOGETHER.values(), ids=TOGETHER)
def test_changes_of_one_call_apply_together_in_any_order(changes: dict[str, object], paper: fl.Scene) -> None:
    first = paper.varied(changes)
    orders = [random.Random(seed).sample(list(changes), len(changes)) for seed in range(12)]
    assert all(paper.varied({path: changes[path] for path in order}) == first for order in orders)


def test_a_link_made_rigid_loses_what_only_bending_needs(paper: fl.Scene) -> None:
    bends = paper.varied({"link.fore.damping": {"ratio": 0.1, "at_hz": 4.0}, "link.*.lumping": "gauss"})
    rigid = bends.varied({"link.*.flex": "rigid"})
    assert [link.segments for link in rigid.arm.links] == [1, 1, 1]
    assert notes(rigid) == notes(paper.varied({"link.*.flex": "rigid"}))
    assert fl.lump(rigid).bodies.tobytes() == fl.lump(paper.rigidified()).bodies.tobytes()
    links = paper.varied(TOGETHER["one rigid"]).arm.links
    assert [link.segments for link in links] == [1, 7, 1]


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_rigidified_scene_keeps_its_task(path: Path) -> None:
    scene = fl.load_scene(path)
    rigid = scene.rigidified()
    assert not any(link.elastic for link in rigid.arm.links)
    for name in ("name", "about", "gravity", "air_density", "drive", "motion", "wrench", "sensor", "run"):
        assert getattr(rigid, name) == getattr(scene, name)
    if any(link.flex != "rigid" for link in scene.arm.links) and scene.initial.q is None:
        varied = scene.varied({"link.*.flex": "rigid", "initial.passive": "zero", "uncertain": {}})
        turns = any(link.turns_rigidly or link.joint.viscous_lag for link in scene.arm.links)
        assert turns or varied == rigid


def test_a_rigidified_scene_has_no_strain_gauges_but_a_warning(paper: fl.Scene) -> None:
    gauge, force = (
        fl.Sensor(name="ε", kind="strain", link="upper", x=0.1, fibre=(0.01, 0.0)),
        fl.Sensor(name="at", kind="joint", link="fore"),
    )
    with pytest.warns(UserWarning) as caught:
        rigid = paper.varied({"sensor": (gauge, force)}).rigidified()
    reviewed("strain-gauges-left-out", str(caught[0].message))
    assert rigid == paper.varied({"sensor": (force,)}).rigidified()


def test_none_restores_the_default_of_a_key(paper: fl.Scene) -> None:
    scene = paper.varied({"link.upper.damping": fl.Damping(ratio=0.1, at_hz=1.0), "run.method": "RK10"})
    without = scene.varied({"link.upper.damping": None, "run.method": None})
    assert without == paper
    with refused(fl.errors.SceneError, "missing-key"):
        paper.varied({"name": None})


def test_a_motion_is_addressed_by_its_link_and_all_can_be_replaced_at_once() -> None:
    rest = fl.PrescribedMotion(link="a.b", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    scene = make_scene(flexible("a.b"), flexible("c"), motion=(rest,))
    faster = scene.varied({"motion.'a.b'.acceleration_deg": [2.0]})
    assert faster.motion[0].acceleration_deg == (2.0,)
    assert scene.varied({"motion": ()}).motion == ()
    assert scene.varied({'link."a.b".length': 2.0}).arm.links[0].length == 2.0


@pytest.mark.parametrize(
    ("changes", "id", "path", "named"),
    [
        ({"run.stp": 1}, "cannot-set", "run.stp = 1", "'step'?"),
        ({"rum.step": 1}, "cannot-set", "rum.step = 1", "'run'?"),
        ({"link.uper.length": 1.0}, "cannot-set", "link.uper.length = 1.0", "'upper'?"),
        ({"link.4.length": 1.0}, "cannot-set", "link.4.length = 1.0", " 1 to 3 "),
        ({"link.0.length": 1.0}, "cannot-set", "link.0.length = 1.0", "'0'"),
        ({"material.aluminum.young": 1.0}, "cannot-set", "material.aluminum.young = 1.0", "'aluminium'?"),
        ({"run.step.x": 1}, "cannot-set", "run.step.x = 1", "run.step "),
        ({"gravity.w": 1.62}, "cannot-set", "gravity.w = 1.62", " x, y, z"),
        ({"gravity.z.z": 1.62}, "cannot-set", "gravity.z.z = 1.62", "gravity.z "),
        ({"tip.inertia.x": 1.0}, "cannot-set", "tip.inertia.x = 1.0", "tip.inertia "),
        ({"motion.upper.times": [0.0]}, "cannot-set", "motion.upper.times = [0.0]", "'upper'"),
        ({"link.*.flex": "rigid", "link.*.segments": 9}, "cannot-set", "link.*.segments = 9", "'*'"),
        ({"link.fore.flex": "rigid", "link.fore.segments": 9}, "rigid-segments", "link.fore.segments = 9", "flex"),
        ({"run..step": 1}, "cannot-set", "run..step = 1", "run.step"),
        ({"": 1}, "cannot-set", " = 1", "run.step"),
        ({"run.step": -1}, "wrong-value", "run.step = -1", "> 0"),
        ({"run.step": 3e-4}, "not-a-multiple", "run.sample = 0.005", "step = 0.0003"),
        ({"initial.time": np.array(None)}, "wrong-value", "initial.time = None", ""),
        ({"initial.joint_deg": {1.0, 2.0, 3.0}}, "not-finite", "initial.joint_deg = {1.0, 2.0, 3.0}", "list"),
        ({"tip_mass": 1.0}, "cannot-set", "tip_mass = 1.0", "'tip.mass'?"),
        ({"link.upper.joint_axis": 1.0}, "cannot-set", "link.upper.joint_axis = 1.0", "'joint.axis'?"),
        ({"link.upper": {"length": 2.0}}, "missing-key", "link.2.name: missing", "change one by 'link.upper.length'"),
        ({"drive": {"kp": (9.0,) * 3}}, "key-of-another-kind", "drive.kp = (9.0, 9.0, 9.0)", "by 'drive.kp'"),
        ({"name": b"bytes"}, "wrong-value", "name = b'bytes'", ""),
        ({"tip": fl.RunSettings(step=1e-4)}, "unknown-key", "tip.method = 'RK4'", "belongs to run"),
        ({"run": 5, "run.step": 1e-4}, "cannot-set", "run.step = 0.0001", "run "),
        ({"link": [5], "link.*.joint.viscous": 1.0}, "cannot-set", "link.*.joint.viscous = 1.0", "link.* "),
        (
            {"link.*.segments": 8, "link.*.lumping": "gauss"},
            "hinges-of-rule", "link.upper.segments = 8", "'gauss'",
        ),
        ({"link.*.lumping": "gaus"}, "unknown-name", "link.upper.lumping = 'gaus'", "'gauss'?"),
        ({"run.method": "RK7"}, "unknown-name", "run.method = 'RK7'", "RK10"),
    ],
)  # fmt: skip
def test_a_wrong_change_is_refused_in_one_line_with_its_path(paper, changes, id, path, named) -> None:
    with refused(fl.errors.SceneError, id) as caught:
        paper.varied(changes)
    text = str(caught.value)
    assert text.startswith(path) and named in text[len(path) :]
    assert "\n" not in text


@pytest.mark.parametrize("names", [["upper", "a.b", "c'd", "2", "*"], ["1", "4", "3", "5", "2"], list("abcde")])
def test_a_message_names_a_link_by_its_path_or_number(names: list) -> None:
    scene = make_scene(*map(flexible, names))
    raw = scene.document()
    numbers = {joint.link for joint in fl.lump(scene).coordinates}
    assert numbers == set(range(1, len(names) + 1))
    for number, link in enumerate(raw["link"], 1):
        link["length"] = -1.0
        with refused(fl.errors.SceneError, "wrong-value") as caught:
            scene.varied({f"link.{number}.length": -1.0} if str(number) not in names else {"link": raw["link"]})
        path = str(caught.value).partition(" = ")[0]
        assert scene.varied({path: 5.0}).arm.links[number - 1].length == 5.0
        link["length"] = 1.0
        with refused(fl.errors.SceneError, "wrong-value") as caught:
            fl.InitialState(joint_deg=[*[0.0] * (number - 1), "x"])  # without an arm, the names of links are not known
        assert f".{number} " in str(caught.value)


def test_a_message_names_a_value_of_a_link_by_its_path() -> None:
    links = [fl.Link(name=name, length=1.0, joint=fl.Joint(limits_deg=(-9, 9))) for name in ("a", "b.c")]
    scene = make_scene(*links, drive=fl.Drive(kind="constant", torque=(0.0, 1.0)))
    for key, value, path in (
        ("initial.joint_deg", [0.0, 10.0], 'initial.joint_deg."b.c"'),
        ("drive.torque", [0.0, "x"], "drive.torque.2"),
        ("drive.torque", [np.nan, 0.0], "drive.torque.1"),
    ):
        with pytest.raises(fl.errors.SceneError) as caught:
            scene.varied({key: value})
        assert str(caught.value).partition(" = ")[0] == path
        scene.varied({path: 1.0})


def test_changes_are_a_dict_of_values_by_path(paper: fl.Scene) -> None:
    with refused(fl.errors.ArgumentError, "wrong-type"):
        paper.varied(["run.step"])  # type: ignore[arg-type]
    with refused(fl.errors.ArgumentError, "path-form"):
        paper.varied({3: 4})  # type: ignore[dict-item]
    with refused(fl.errors.ArgumentError, "path-form"):  # a wrong argument is no mistake in the file
        fl.load_scene(PAPER, changes={3: 4})  # type: ignore[dict-item]


def test_simulate_s_keywords_are_changes_of_the_run(paper: fl.Scene) -> None:
    short = paper.varied({"run.duration": 0.01, "run.method": "RK2", "run.step": 5e-6})
    run = fl.simulate(paper, duration=0.01, method="RK2", step=5e-6)
    np.testing.assert_array_equal(fl.simulate(short).q, run.q)


@pytest.mark.parametrize("command", ["info", "simulate", "modes", "export", "compare"])
def test_every_command_with_a_scene_accepts_changes(command: str, tmp_path: Path, capsys) -> None:
    wrong = ["--set", "link.*.segmens=3"]
    assert main([command, str(PAPER), *wrong]) == 2
    text = refused_line(capsys.readouterr().err, "cannot-set")
    path = f"{PAPER}: link.*.segmens = 3: "
    assert path in text
    assert "'segments'?" in text


def test_values_on_the_command_line_are_toml_or_a_bare_word(tmp_path: Path, capsys) -> None:
    changes = ["run.duration = 0.01", "link.*.segments=3", "link.upper.lumping=gauss", "link.fore.lumping='midpoint'",
               "gravity=[0, 0, 1.62]", "tip={mass = 2.0}"]  # fmt: skip
    out = tmp_path / "run.npz"
    assert main(["simulate", str(PAPER), "--out", str(out), *(part for c in changes for part in ("--set", c))]) == 0
    scene = fl.load_scene(PAPER).varied(
        {"run.duration": 0.01, "link.*.segments": 3, "link.upper.lumping": "gauss", "link.fore.lumping": "midpoint",
         "gravity": [0, 0, 1.62], "tip.mass": 2.0}
    )  # fmt: skip
    np.testing.assert_array_equal(np.load(out)["q"], fl.simulate(scene).q)


def test_an_option_of_the_command_overrides_set(tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", str(PAPER), "--duration", "0.01", "--set", "run.duration=5.0", "--out", str(out)]) == 0
    assert np.load(out)["t"][-1] == 0.01


def test_set_repairs_a_scene_that_is_refused_as_it_is(tmp_path: Path, capsys) -> None:
    raw = tomllib.loads(PAPER.read_text(encoding="utf-8"))
    raw["link"][1]["segments"], raw["initial"]["joint_deg"] = 1, [0.0]
    bad = tmp_path / "bad.toml"
    bad.write_text(tomli_w.dumps(raw), encoding="utf-8")
    segments, angles = ["--set", "link.upper.segments=5"], ["--set", "initial.joint_deg=[0, -80, 0]"]
    one_angle = ["--set", "initial.joint_deg.fore=3"]
    codes = [main(["info", str(bad), *repairs]) for repairs in ([], segments, segments + one_angle, segments + angles)]
    assert codes == [2, 2, 2, 0]
    refused_line(capsys.readouterr().err.splitlines()[-1], "cannot-set")
    changes = {"link.upper.segments": 5, "initial.joint_deg": [0, -80, 0]}
    assert fl.load_scene(bad, changes=changes) == fl.load_scene(PAPER, changes=changes)


@pytest.mark.parametrize("text", ["run.step", "=1", "run.step=", "run.step=1\nx=2", "gravity=[1, 2", "name='a"])
def test_a_setting_that_is_none_is_refused_in_one_line(text: str, capsys) -> None:
    assert main(["info", str(PAPER), "--set", text]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"flexlink: --set {' '.join(text.split())}: ")


def test_run_settings_that_scenes_share_are_checked_with_every_scene(paper: fl.Scene) -> None:
    """The second scene has the settings of the first, and a table whose times do not fit their steps."""
    steps = {"run.step": 2e-4}
    held = fl.Drive(kind="table", times=(0.0, 1e-4), torques=((0.0, 0.0, 0.0),) * 2, hold=True)
    driven = paper.varied({"drive": held})
    assert driven.run is paper.run
    assert paper.varied(steps).run is paper.varied(steps).run
    with refused(fl.errors.SceneError, "not-a-multiple"):
        driven.varied(steps)


def test_a_boolean_is_not_accepted_as_a_number(paper: fl.Scene) -> None:
    """1 == True, but only 1 is a duration."""
    assert paper.varied({"run.duration": 1}).run.duration == 1.0
    with refused(fl.errors.SceneError, "wrong-value"):
        paper.varied({"run.duration": True})


VARIANTS: dict[str, list[dict[str, Any]]] = {
    "numbers": [
        {"tip.mass": m, "material.aluminium.young": E} for m in (0.0, 1, -1.0, math.nan) for E in (7e10, math.inf, "x")
    ],
    "not finite": [{"material.aluminium.young": E, "tip.mass": m} for E in (7e10, math.inf) for m in (math.inf, 1.0)],
    "None": [{"tip.mass": None, "run.duration": 0.1}, {"tip.mass": 2.0, "run.duration": None}],
    "arrays": [{"gravity": np.array([0.0, 0.0, g]), "tip.mass": np.float64(g)} for g in (1.0, np.inf)],
    "components": [{"gravity.x": g, "tip.center.z": 0.1, "link.fore.mount.xyz.y": g} for g in (1.0, "x", np.nan)],
    "segments": [{"link.*.lumping": rule, "link.*.segments": n} for rule in ("gauss", "paper") for n in (3, 4, 1)],
    "one and all": [{"link.upper.segments": n, "link.*.segments": m} for n in (9, 4) for m in (3, 5)],
    "segments alone": [{"link.upper.segments": n, "link.fore.length": 1.5} for n in (5, 4)],
    "words": [{"run.method": name, "tip.mass": m} for name in ("RK10", "RK4", "no") for m in (0.0, 1.0)],
    "tolerance": [{"run.tolerance": 1e-4, "tip.mass": 1.0}, {"run.tolerance": -1.0, "tip.mass": 1.0}],
    "step": [{"run.step": h, "run.duration": T} for h in (1e-4, 3e-4) for T in (0.1, 0.2)],
    "a whole and its part": [{"initial.joint_deg": [0.0, 1.0, 2.0], "initial.joint_deg.upper": 5.0}],
    "not there": [{"link.upper.damping.ratio": 0.1}, {"link.upper.damping.ratio": 0.2}],
}


@pytest.mark.parametrize("variants", VARIANTS.values(), ids=VARIANTS)
def test_variants_equal_scenes_made_by_varied(variants: list[dict[str, Any]]) -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    scene = (
        scene if "link.*.lumping" in variants[0] else scene.varied({"link.*.lumping": "gauss", "link.*.segments": 5})
    )
    many = Variants(scene, list(variants[0]))

    def found(varied: Callable[[dict[str, Any]], fl.Scene], changes: dict[str, Any]) -> object:
        try:
            return varied(changes)
        except fl.FlexlinkError as error:
            return type(error), str(error)

    for changes in variants:
        assert found(many.varied, changes) == found(scene.varied, changes)
