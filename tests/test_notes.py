"""What a scene says without effect is noted, and what has an effect is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS, flexible, make_scene

import flexlink as fl
from flexlink.cli.main import main
from flexlink.dynamics.notes import notes

STILL = make_scene(fl.Link(name="a"), flexible("b"))
"""All axes along z, as is the default gravity."""

UPRIGHT = fl.Mount(rpy_deg=(-90.0, 0.0, 0.0))


def test_gravity_along_all_axes_is_noted_because_it_moves_nothing() -> None:
    (note,) = notes(STILL)
    assert note.startswith("gravity = [0.0, 0.0, 9.81]: is parallel to the axes of all joints")
    chain = fl.lump(STILL)
    q = np.linspace(0.1, 0.9, chain.n)
    assert not fl.gravity_torque(chain, q).any()


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -1e-300), (0.0, 0.0, 1e308)])
def test_its_size_does_not_matter(gravity: tuple[float, ...]) -> None:
    assert len(notes(make_scene(fl.Link(name="a"), flexible("b"), gravity=gravity))) == 1


def test_axes_that_a_mount_turns_are_parallel_up_to_its_rounding() -> None:
    turned = fl.Mount(rpy_deg=(33.0, 12.0, 5.0))
    axis = fl.lump(make_scene(fl.Link(name="a", mount=turned), flexible("b"))).axes[0]
    links = fl.Link(name="a", mount=turned), flexible("b")
    assert len(notes(make_scene(*links, gravity=tuple(9.81 * axis)))) == 1
    assert not notes(make_scene(*links, gravity=tuple(9.81 * axis + [0, 1e-9, 0])))


@pytest.mark.parametrize(
    "fields",
    [
        {"gravity": (0.0, 1e-9, 9.81)},
        {"gravity": (0.0, 0.0, 0.0)},  # said on purpose
        {"initial": fl.InitialState(joint_deg=(0, 0), rate_deg=(0, 1))},
        {"wrench": fl.Wrench(force=(0, 1, 0))},
        {"drive": fl.Drive(kind="constant", torque=(0, 1))},
        {"drive": fl.Drive(kind="table", times=(0, 1), torques=((0, 0), (0, 1)))},
        {"drive": fl.Drive(kind="pd", kp=(0, 1), kd=(0, 0), target_deg=(0, 10))},
        {"motion": [fl.PrescribedMotion(link="a", times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])]},
    ],
)
def test_an_arm_that_something_else_moves_needs_no_note(fields: dict) -> None:
    assert notes(make_scene(fl.Link(name="a"), flexible("b"), **fields)) == ()


def test_links_that_bend_out_of_the_plane_feel_gravity_along_the_joints() -> None:
    assert notes(make_scene(flexible("b", "yz"))) == ()
    assert notes(make_scene(flexible("b", mount=UPRIGHT))) == ()


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_the_scenes_of_the_repository_mean_what_they_say(path: Path) -> None:
    assert notes(fl.load_scene(path)) == ()


def test_what_has_no_effect_is_noted_by_key_and_value() -> None:
    bar = {"length": 1.0, "material": "aluminium", "section": "square"}
    scene = make_scene(
        fl.Link(name="a", mount=UPRIGHT, damping=fl.Damping(ratio=0.01, at_hz=4.0), **bar),
        fl.Link(name="b", joint=fl.Joint(locked=True, viscous=2.0, armature=0.1), **bar),
        initial=fl.InitialState(joint_deg=(0, 0), passive="static"),
        motion=[fl.PrescribedMotion(link="a", times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])],
        drive=fl.Drive(kind="constant", torque=(5.0, 0.0)),
    )
    assert notes(scene) == (
        "initial.passive = 'static': has no effect, no link bends",
        "drive.torque: has no effect on 'a', whose motion is prescribed",
        "link.a.damping.ratio = 0.01: has no effect, 'a' is rigid",
        "link.b.joint.viscous = 2.0: has no effect, the joint of 'b' is locked",
        "link.b.joint.armature = 0.1: has no effect, the joint of 'b' is locked",
    )


@pytest.mark.parametrize("passive", ["zero", "static"])
def test_a_rigid_arm_has_one_static_posture(passive: str) -> None:
    link = fl.Link(name="a", length=1.0, material="aluminium", section="square", mount=UPRIGHT)
    scene = make_scene(link, initial=fl.InitialState(joint_deg=(30.0,), passive=passive))
    q, _ = fl.initial_state(scene, fl.lump(scene))
    assert q == pytest.approx([np.radians(30.0)], rel=1e-15, abs=0)


def test_info_prints_notes_beside_its_result(tmp_path: Path, capsys) -> None:
    path = tmp_path / "still.toml"
    path.write_text(make_scene(flexible("b")).to_toml(), encoding="utf-8")
    assert main(["info", str(path)]) == 0
    streams = capsys.readouterr()
    assert "note: gravity = [0.0, 0.0, 9.81]: is parallel" in streams.err
    assert "note" not in streams.out
