"""Capsules, colours, motors and a keyframe in exported files do not change the motion of the arm."""

import dataclasses
import math
from xml.etree import ElementTree
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import flexlink as fl
from flexlink.common.safe_xml import parse
from flexlink.formats.document import COLOURS, THICKNESS, capsules
from tests.conftest import ROOT, chain_of, make_scene, nasty_scene, random_state
from tests.support.words import refused
from validation.random_arms import random_arm

WRITERS = [fl.to_urdf, fl.to_mjcf, fl.to_sdf]


def test_shapes_and_motors_do_not_change_the_motion_in_mujoco_by_one_bit(chain, rng) -> None:
    q, qd = random_state(chain, rng)
    bare = parse(fl.to_mjcf(chain, shapes=False), "bare")
    for element in bare.findall("actuator"):
        bare.remove(element)
    texts = ET.tostring(bare, encoding="unicode"), fl.to_mjcf(chain, initial=(q, qd))
    models, accelerations = [mujoco.MjModel.from_xml_string(text) for text in texts], []
    for model in models:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = models[1].key_qpos[0], models[1].key_qvel[0]
        mujoco.mj_forward(model, data)
        accelerations.append(data.qacc.tolist())
    assert (models[1].nu, models[1].nkey) == (len(chain.active), 1)
    assert accelerations[0] == accelerations[1]


def test_mujoco_starts_at_the_keyframe_and_drives_the_driven_joints(rng: np.random.Generator) -> None:
    chain = fl.lump(nasty_scene())
    q, qd = random_state(chain, rng)
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain, initial=(q, qd)))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    assert (data.qpos.tolist(), data.qvel.tolist()) == (q.tolist(), qd.tolist())
    data.ctrl[:] = range(1, model.nu + 1)
    mujoco.mj_forward(model, data)
    torque = np.zeros(chain.n)
    torque[chain.active] = data.ctrl
    assert data.qfrc_actuator.tolist() == torque.tolist()


def test_shapes_lie_on_the_segments_without_mass_or_contact(rng: np.random.Generator) -> None:
    chain = fl.lump(nasty_scene())
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert model.body_mass.tolist() == [0.0, *(mass for mass in chain.bodies["mass"] if mass), 0.0]
    data = mujoco.MjData(model)
    data.qpos[:] = q = rng.uniform(-1, 1, chain.n)
    mujoco.mj_forward(model, data)
    points = fl.frames(chain, q).points
    middles = [(a + b) / 2 for a, b, mass in zip(points, points[1:], chain.bodies["mass"], strict=False) if mass]
    assert data.geom_xpos == pytest.approx(np.array(middles), abs=1e-14 * np.abs(points).max() * len(points))


@pytest.mark.parametrize("write", WRITERS)
def test_shapes_can_be_left_out_and_change_nothing_else(write) -> None:
    chain = fl.lump(nasty_scene())
    with_shapes, bare = parse(write(chain), "with"), parse(write(chain, shapes=False), "without")
    tags = {element.tag for element in with_shapes.iter()} - {element.tag for element in bare.iter()}
    assert tags & {"visual", "geom"}
    assert not tags & {"link", "joint", "inertial", "collision"}
    with refused(fl.errors.ArgumentError, "wrong-type"):
        write(chain, shapes="no")


@pytest.mark.parametrize("write", WRITERS)
def test_every_link_has_a_different_colour(write) -> None:
    text = write(fl.lump(fl.load_scene(ROOT / "models" / "t3_spatial.toml")))
    for colour in COLOURS[:3]:
        assert " ".join(map(repr, colour)) in text


def test_a_capsule_is_as_thick_as_a_solid_rod_of_its_inertia() -> None:
    round_bar = fl.Section(shape="circle", diameter=0.05)
    link = fl.Link(name="rod", length=1.25, material="aluminium", section="round")
    arm = fl.Arm(links=(link,), materials={"aluminium": fl.Material(young=7e10, density=2700.0)},
                 sections={"round": round_bar})  # fmt: skip
    (capsule,) = capsules(chain_of(arm))
    assert capsule is not None
    assert capsule.radius == pytest.approx(0.025, rel=4 * np.finfo(float).eps)
    assert capsule.length == 1.25


def test_a_link_without_mass_or_length_is_drawn_thin_or_not_at_all() -> None:
    chain = fl.lump(make_scene(fl.Link(name="a"), fl.Link(name="b", length=2.0), tip=fl.RigidBody(mass=1.0)))
    nothing, thin = capsules(chain)
    assert nothing is None
    assert thin is not None
    assert thin.radius == THICKNESS[0] * 2.0


def test_cylinders_and_capsules_of_any_direction_lie_along_their_segment(rng: np.random.Generator) -> None:
    """Roll, pitch and yaw in URDF and SDF rotate Z, the long axis of the shape, onto the segment."""
    chain = fl.lump(nasty_scene())
    bodies = chain.bodies.copy()
    bodies["translation"] = rng.normal(size=(len(bodies), 3))
    for capsule in capsules(dataclasses.replace(chain, bodies=bodies)):
        assert capsule is not None
        *middle, roll, pitch, yaw = capsule.pose
        along = np.array([math.sin(pitch) * math.cos(yaw), math.sin(pitch) * math.sin(yaw), math.cos(pitch)])
        assert roll == 0
        assert along * capsule.length == pytest.approx(capsule.end, abs=1e-15 * 8 * capsule.length)
        assert (2 * np.array(middle)).tolist() == capsule.end.tolist()


def test_an_invalid_keyframe_is_refused_by_name() -> None:
    chain = fl.lump(nasty_scene())
    q = np.zeros(chain.n)
    for initial, message in {
        (1.0,): "initial has 1 items: expected q and qd",
        ((0.0,), (0.0,)): rf"initial\[0\] has shape \(1,\); expected \({chain.n},\)",
        (tuple(q), tuple(q + np.nan)): r"initial\[1\]\[0\] = nan is not finite",
        "ab": "initial = 'ab': expected a sequence",
    }.items():
        with pytest.raises(fl.errors.ArgumentError, match=message):
            fl.to_mjcf(chain, initial=initial)


def test_a_segment_as_short_as_rounding_error_gets_no_shape() -> None:
    """The segment is 1e-17 m long, shorter than MuJoCo accepts for a shape."""
    chain = fl.lump(random_arm(41))
    mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))


def test_rates_of_a_keyframe_are_in_the_order_of_its_angles() -> None:
    names = (("a", "base"), ("b", "base"), ("c", "a"))
    links = (fl.Link(name=name, on=on, length=1.0, material="aluminium", section="square") for name, on in names)
    chain = fl.lump(make_scene(*links))
    (key,) = ElementTree.fromstring(fl.to_mjcf(chain, initial=([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]))).iter("key")
    assert key.get("qpos") == key.get("qvel") == "1.0 3.0 2.0"
