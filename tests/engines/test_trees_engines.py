"""Trees, prismatic joints and free bases: files represent all of them, and other engines that load them agree."""

import re

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.dynamics.placement import frames
from flexlink.engines import load
from flexlink.formats import FORMATS
from flexlink.formats.mjcf import depth_first
from flexlink.formats.small_mass import with_small_mass
from tests.engines.test_engines import engine
from tests.formats.test_reading import EVERY, assert_same
from tests.support.beams import satellite
from tests.support.words import refused
from validation.random_arms import random_tree

EPS = np.finfo(float).eps


@pytest.fixture(scope="module")
def chain() -> fl.Chain:
    return fl.lump(satellite())


@EVERY
def test_files_read_back_to_the_same_tree(format, chain: fl.Chain) -> None:
    for one in (chain, *(fl.lump(random_tree(seed)) for seed in range(4))):
        read = format.read(format.write(one))
        assert_same(read, one)
        assert read.tips == one.tips


@EVERY
def test_small_masses_are_added_between_joints_of_a_tree_but_not_to_its_base(format, chain: fl.Chain) -> None:
    filled = with_small_mass(chain, mass=1e-6)
    read = format.read(format.write(filled))
    assert_same(read, filled)
    assert read.tips == filled.tips
    assert filled.mass - chain.mass == pytest.approx(5e-6, rel=1e-6)  # the boom's motor, and x and y of its two hinges
    q = np.linspace(-0.5, 0.5, chain.n)
    assert fl.mass_matrix(filled, q) == pytest.approx(fl.mass_matrix(chain, q), abs=1e-4)


def test_a_keyframe_places_the_base_by_a_quaternion_and_joints_branch_by_branch(chain: fl.Chain) -> None:
    scene = satellite()
    q, qd = fl.initial_state(scene, chain)
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain, initial=(q, qd)))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    for name, number in chain.tips.items():
        called = "tip" if name == "right" else name
        assert data.body(called).xpos == pytest.approx(frames(chain, q).points[number], abs=1e-14)
    assert model.nv == chain.n == len(depth_first(chain))
    assert data.qvel[3:6] == pytest.approx(np.radians([5.0, -3.0, 8.0]), rel=1e-14)  # ω in axes of the base
    q[3:6], h = (0.4, -0.7, 1.1), 1e-5
    texts = [fl.to_mjcf(chain, initial=(q + step * qd, qd), timestep=1e-3) for step in (-h, 0.0, h)]
    before, now, after = (mujoco.MjModel.from_xml_string(text).key(0) for text in texts)
    turn = (Rotation(before.qpos[[4, 5, 6, 3]]).inv() * Rotation(after.qpos[[4, 5, 6, 3]])).as_rotvec()
    assert turn / (2 * h) == pytest.approx(now.qvel[3:6], rel=1e-8)


def test_mujoco_refuses_branches_where_nothing_has_mass() -> None:
    links = (fl.Link(name="cart"), *(
        fl.Link(name=name, on="cart", hub=fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))) for name in ("a", "b")
    ))  # fmt: skip
    chain = fl.lump(fl.Scene(name="t", arm=fl.Arm(links=links), initial=fl.InitialState(joint_deg=(0.0,) * 3)))
    with refused(fl.errors.ArgumentError, "joint-without-inertia"):
        fl.to_mjcf(chain)
    assert_same(FORMATS["urdf"].read(fl.to_urdf(chain)), chain)


@EVERY
@pytest.mark.parametrize(
    ("pattern", "wrong"),
    [
        (r'loaded(="|" data=")3"', r'loaded\g<1>9"'),
        (r'base(="|" data=")[-0-9.e]+ ', r"base\g<1>2.0 "),
        (r'(link="|flexlink.tip.panel" data=")1', r"\g<1>2"),
    ],
    ids=["a link that is not there", "a stretched attitude", "another link's tip"],
)
def test_an_invalid_base_or_tip_is_refused_in_one_line(format, pattern, wrong, chain: fl.Chain) -> None:
    text, count = re.subn(pattern, wrong, format.write(chain), count=1)
    assert count == 1
    with refused(fl.errors.DataFileError, "file-content"):
        format.read(text)


def test_nearly_aligned_inertia_axes_are_permuted_for_mujoco() -> None:
    """MuJoCo drops rotations and offsets below 1e-6, although their effect on M exceeds rounding by far."""
    for inertia, center in {((0.1, 0.2, 0.25, 0, 0, 1e-8), (0, 0, 0)), ((0.1, 0.2, 0.25), (5e-7, 0, 0))}:
        hub = fl.RigidBody(mass=1e5, center=center, inertia=inertia)
        links = fl.Link(name="a", hub=hub), fl.Link(name="b", joint=fl.Joint(axis=(0.0, 1.0, 0.0)), hub=hub)
        chain = fl.lump(fl.Scene(name="t", arm=fl.Arm(links=links), initial=fl.InitialState(joint_deg=(0.0, 0.0))))
        q = np.array([0.3, 0.7])
        M = fl.mass_matrix(chain, q)
        assert load("mujoco", chain).mass_matrix(q) == pytest.approx(M, abs=4 * EPS * M.max())


@pytest.mark.parametrize("name", [engine("pinocchio"), engine("mujoco"), engine("exudyn")])
def test_a_base_that_rotates_far_changes_coordinates_or_is_refused(name: str) -> None:
    scene = satellite().varied({"initial.base.spin_deg": (900.0, -700.0, 300.0), "run.duration": 0.1})
    chain = fl.lump(scene)
    other = load(name, chain)
    if name == "exudyn":
        for one in (scene, scene.varied({"initial.base.spin_deg": (-900.0, 0.0, 0.0)})):
            with refused(fl.errors.ArgumentError, "base-turned-too-far") as caught:
                other.integrate(one)
            assert re.search(r" 69° .* t = 0\.0\d s", str(caught.value))
        return
    (_, q, qd), (_, others, rates) = (each.integrate(scene) for each in (load("native", chain), other))
    assert np.abs(q[-1, 3:6]).max() > 1.0
    assert np.abs(others - q).max() <= 1e-12
    assert np.abs(rates - qd).max() <= 1e-10
    M = other.mass_matrix(q[0])  # back in the initial coordinates
    assert pytest.approx(fl.mass_matrix(chain, q[0]), abs=1e-13 * np.abs(M).max()) == M
