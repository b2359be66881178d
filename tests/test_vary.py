"""One way to vary a scene: values by path, in the words of its file; what comes out is checked like a file."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from conftest import MODELS, ROOT, flexible, make_scene

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.variants import Variants
from tests.words import refused

PAPER = ROOT / "models" / "paper_fig5.toml"


@pytest.fixture
def paper() -> fl.Scene:
    return fl.load_scene(PAPER)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_scene_varied_by_nothing_is_the_same_to_the_bit(path: Path) -> None:
    scene = fl.load_scene(path)
    assert scene.varied({}) == scene
    assert scene.varied({"run.step": scene.run.step, "link.1.length": scene.arm.links[0].length}) == scene


def test_a_change_is_what_the_file_would_be_if_it_said_so(paper: fl.Scene, tmp_path: Path) -> None:
    """Every kind of path, against the same values written into the file by hand."""
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


def test_the_scene_itself_stays_as_it_is(paper: fl.Scene) -> None:
    paper.varied({"link.*.segments": 9, "initial.joint_deg.*": 1.0})
    assert paper == fl.load_scene(PAPER)


def test_a_star_means_the_links_on_which_the_key_has_an_effect(paper: fl.Scene) -> None:
    links = paper.varied({"link.*.lumping": "gauss", "link.*.joint.viscous": 2.0, "link.*.hub.mass": 3.0}).arm.links
    assert [link.lumping for link in links] == [paper.arm.links[0].lumping, "gauss", "gauss"]
    assert [link.joint.viscous for link in links] == [0.0, 2.0, 2.0]  # the waist is locked
    assert [link.hub.mass for link in links] == [3.0, 3.0, 3.0]
    thick = fl.Section(shape="circle", diameter=0.1)
    assert [k.section for k in paper.varied({"section.thick": thick, "link.*.section": "thick"}).arm.links] == [
        None, "thick", "thick",
    ]  # fmt: skip
    assert paper.varied({"initial.joint_deg.*": 5.0}).initial.joint_deg == (5.0, 5.0, 5.0)


def test_changes_are_made_one_after_the_other(paper: fl.Scene) -> None:
    """So that a link may be made rigid, and another one flexible."""
    changes: dict[str, object] = {"link.fore.segments": 1, "link.fore.flex": "rigid", "link.*.segments": 9}
    assert [link.segments for link in paper.varied(changes).arm.links] == [1, 9, 1]


def test_none_leaves_a_key_out_so_that_its_default_holds(paper: fl.Scene) -> None:
    scene = paper.varied({"link.upper.damping": fl.Damping(ratio=0.1, at_hz=1.0), "run.method": "RK10"})
    assert scene.varied({"link.upper.damping": None, "run.method": None}) == paper
    with refused(fl.errors.SceneError, "missing-key"):
        paper.varied({"name": None})


def test_a_motion_is_found_by_its_link_and_all_are_replaced_at_once() -> None:
    rest = fl.PrescribedMotion(link="a.b", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    scene = make_scene(flexible("a.b"), flexible("c"), motion=(rest,))
    assert scene.varied({"motion.'a.b'.acceleration_deg": [2.0]}).motion[0].acceleration_deg == (2.0,)
    assert scene.varied({"motion": ()}).motion == ()
    assert scene.varied({'link."a.b".length': 2.0}).arm.links[0].length == 2.0


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"run.stp": 1}, r"run\.stp = 1: 'stp' is unknown here; allowed are method, .*; did you mean 'step'\?"),
        ({"rum.step": 1}, r"rum\.step = 1: 'rum' is unknown here; allowed are name, .*; did you mean 'run'\?"),
        ({"link.uper.length": 1.0}, r"link\.uper\.length = 1\.0: 'uper' is unknown here; .*; did you mean 'upper'\?"),
        (
            {"link.4.length": 1.0},
            r".*: '4' is unknown here; allowed are waist, upper, fore, a number from 1 to 3 or",
        ),
        ({"link.0.length": 1.0}, r"link\.0\.length = 1\.0: '0' is unknown here"),
        ({"material.aluminum.young": 1.0}, r".*'aluminum' is unknown here; .* did you mean 'aluminium'\?"),
        ({"run.step.x": 1}, r"run\.step\.x = 1: run\.step is one value; set it as a whole"),
        ({"gravity.w": 1.62}, r"gravity\.w = 1\.62: 'w' is unknown here; allowed are x, y, z"),
        ({"gravity.z.z": 1.62}, r"gravity\.z\.z = 1\.62: gravity\.z is one value"),
        ({"tip.inertia.x": 1.0}, r"tip\.inertia\.x = 1\.0: tip\.inertia is one value"),
        ({"motion.upper.times": [0.0]}, r"motion\.upper\.times = \[0\.0\]: 'upper': there is no motion"),
        ({"link.*.flex": "rigid", "link.*.segments": 1}, r"link\.\*\.segments = 1: '\*': there is no link on"),
        ({"run..step": 1}, r"run\.\.step = 1: not a path"),
        ({"": 1}, r" = 1: not a path"),
        ({"run.step": -1}, r"run\.step = -1: expected float > 0\.0"),
        ({"run.step": 3e-4}, r"run\.sample = 0\.005: must be a multiple of step = 0\.0003"),
        ({"initial.time": np.array(None)}, r"initial\.time = None: expected float"),
        ({"initial.joint_deg": {1.0, 2.0, 3.0}}, r"initial\.joint_deg = \{.*\}: a set has no order"),
        ({"name": b"bytes"}, r"name = b'bytes': expected str"),
        ({"tip": fl.RunSettings(step=1e-4)}, r"tip\.method = 'RK4': unknown key; allowed are mass, center, inertia"),
        ({"run": 5, "run.step": 1e-4}, r"run\.step = 0\.0001: run is one value"),
        ({"link": [5], "link.*.joint.viscous": 1.0}, r"link\.\*\.joint\.viscous = 1\.0: link\.\* is one value"),
        (
            {"link.*.segments": 8, "link.*.lumping": "gauss"},
            r"link\.upper\.segments = 8, so 7 hinges: rule 'gauss'",
        ),
        ({"link.*.lumping": "gaus"}, r"link\.upper\.lumping = 'gaus': unknown; .* did you mean 'gauss'\?"),
        ({"run.method": "RK7"}, r"run\.method = 'RK7': unknown; allowed are"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line_that_helps(paper: fl.Scene, changes: dict, wanted: str) -> None:
    with pytest.raises(fl.errors.SceneError, match=f"^({wanted})") as caught:
        paper.varied(changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("names", [["upper", "a.b", "c'd", "2", "*"], ["1", "4", "3", "5", "2"], list("abcde")])
def test_a_message_names_a_link_by_the_path_that_sets_it_and_by_the_number_of_its_coordinates(names: list) -> None:
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
            fl.InitialState(joint_deg=[*[0.0] * (number - 1), "x"])  # names are not known yet
        assert f".{number} " in str(caught.value)


def test_a_message_names_a_number_of_a_link_by_the_path_that_sets_it() -> None:
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


def test_simulate_s_keywords_are_changes_of_the_run(paper: fl.Scene) -> None:
    short = paper.varied({"run.duration": 0.01, "run.method": "RK2", "run.step": 5e-6})
    run = fl.simulate(paper, duration=0.01, method="RK2", step=5e-6)
    np.testing.assert_array_equal(fl.simulate(short).q, run.q)


@pytest.mark.parametrize("command", ["info", "simulate", "modes", "export", "compare"])
def test_every_command_that_takes_a_scene_takes_changes(command: str, tmp_path: Path, capsys) -> None:
    wrong = ["--set", "link.*.segmens=3"]
    assert main([command, str(PAPER), *wrong]) == 2
    said = capsys.readouterr().err
    assert f"{PAPER}: link.*.segmens = 3: 'segmens' is unknown here" in said
    assert "did you mean 'segments'?" in said


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


def test_an_option_of_the_command_is_the_last_word(tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", str(PAPER), "--duration", "0.01", "--set", "run.duration=5.0", "--out", str(out)]) == 0
    assert np.load(out)["t"][-1] == 0.01


@pytest.mark.parametrize("text", ["run.step", "=1", "run.step=", "run.step=1\nx=2", "gravity=[1, 2", "name='a"])
def test_a_setting_that_is_none_is_refused_in_one_line(text: str, capsys) -> None:
    assert main(["info", str(PAPER), "--set", text]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"flexlink: --set {' '.join(text.split())}: ")


def test_settings_of_a_run_that_scenes_share_are_still_checked_with_each_of_them(paper: fl.Scene) -> None:
    """The second scene has the settings of the first, and a table that their steps do not fit."""
    steps = {"run.step": 2e-4}
    held = fl.Drive(kind="table", times=(0.0, 1e-4), torques=((0.0, 0.0, 0.0),) * 2, hold=True)
    driven = paper.varied({"drive": held})
    assert driven.run is paper.run
    assert paper.varied(steps).run is paper.varied(steps).run
    with refused(fl.errors.SceneError, "not-a-multiple"):
        driven.varied(steps)


def test_a_number_and_a_truth_are_not_one_setting(paper: fl.Scene) -> None:
    """1 and True are equal, and only one of them is a duration."""
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
    "segments alone": [{"link.upper.segments": n, "link.fore.length": 1.5} for n in (5, 4)],
    "words": [{"run.method": name, "tip.mass": m} for name in ("RK10", "RK4", "no") for m in (0.0, 1.0)],
    "tolerance": [{"run.tolerance": 1e-4, "tip.mass": 1.0}, {"run.tolerance": -1.0, "tip.mass": 1.0}],
    "step": [{"run.step": h, "run.duration": T} for h in (1e-4, 3e-4) for T in (0.1, 0.2)],
    "a whole and its part": [{"initial.joint_deg": [0.0, 1.0, 2.0], "initial.joint_deg.upper": 5.0}],
    "not there": [{"link.upper.damping.ratio": 0.1}, {"link.upper.damping.ratio": 0.2}],
}


@pytest.mark.parametrize("variants", VARIANTS.values(), ids=VARIANTS)
def test_variants_are_what_varied_makes_of_the_same_values(variants: list[dict[str, Any]]) -> None:
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
