"""Scenes as TOML that a person would write: short, aligned, and equal when read back."""

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import flexlink as fl
from flexlink.describe.scene import scene_from
from flexlink.describe.writing import toml_of
from tests.conftest import MODELS, ROOT, make_scene
from validation.random_arms import random_arm

SCENES = sorted([*MODELS, *(ROOT / "validation" / "scenes").glob("*.toml")])


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_file_is_not_longer_than_the_one_it_was_read_from(path: Path) -> None:
    """The original is written by hand, with an empty line between tables; comments and rows of numbers do not count."""
    text = fl.load_scene(path).to_toml()
    by_hand = path.read_text(encoding="utf-8")
    assert len(re.sub(r"(?m)^ *([-+.e\d]+,|\])\n", "", text).split("\n")) <= len(by_hand.split("\n")) + 2
    exported, written = (set(tomllib.loads(each)) for each in (text, by_hand))
    assert {"gravity"} <= exported <= written | {"gravity"}


@given(seed=st.integers(0, 10**9))
def test_random_arms_read_back_equal(seed: int) -> None:
    scene = random_arm(seed)
    assert scene_from(tomllib.loads(scene.to_toml())) == scene


text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


@given(name=text, about=text, material=text, young=st.floats(min_value=5e-324, max_value=1e300))
def test_any_text_and_number_reads_back_equal(name: str, about: str, material: str, young: float) -> None:
    arm = fl.Arm(links=(fl.Link(name=name),), materials={material: fl.Material(young=young, density=1.0)})
    scene = fl.Scene(name=name, about=about, arm=arm, initial=fl.InitialState(joint_deg=(young,)))
    assert scene_from(tomllib.loads(scene.to_toml())) == scene


def test_a_shaped_reference_has_separate_tables() -> None:
    shaper = fl.InputShaper(kind="ZVD", frequency_hz=(1.5, 2.0), damping=(0.01, 0.0))
    reference = fl.Reference(profile="quintic", to_deg=(9.0,), duration=1.0, shaper=shaper)
    drive = fl.Drive(kind="pd", kp=(4.0,), kd=(1.0,), reference=reference)
    scene = make_scene(fl.Link(name="a"), drive=drive, run=fl.RunSettings())
    text_ = scene.to_toml()
    assert scene_from(tomllib.loads(text_)) == scene
    expected = """\
[drive]
kind = "pd"
kp   = [4.0]
kd   = [1.0]

[drive.reference]
profile  = "quintic"
to_deg   = [9.0]
duration = 1.0

[drive.reference.shaper]
kind         = "ZVD"
frequency_hz = [1.5, 2.0]
damping      = [0.01, 0.0]
"""
    assert text_[text_.index("[drive]") :] == expected


@pytest.mark.parametrize("name", ["ur5_flexible", "z1_flexible", "alex"])
def test_a_robot_scene_is_written_like_its_file(name: str) -> None:
    path = ROOT / "models" / "robots" / f"{name}.toml"
    written = fl.load_scene(path).to_toml()
    assert written == re.sub(r"^#.*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)


def test_names_with_dots_and_quotes_stay_one_key() -> None:
    odd = {"a.b": {"x": 1.0}, 'quoted "so"': {"x": 2}}
    text_ = toml_of({"name": "tab\tand \x7f", "flag": True, "section": odd})
    assert tomllib.loads(text_) == {"name": "tab\tand \x7f", "flag": True, "section": odd}
