"""Exported files represent the chain: the engines read back every number exactly or within rounding."""

import dataclasses
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import flexlink as fl
from flexlink import (
    Arm,
    Chain,
    Damping,
    Link,
    Mount,
    RigidBody,
    Section,
    load_scene,
    lump,
    modes,
    stable_step,
    tip_position,
    to_mjcf,
)
from flexlink.chain.rigid import matrix_from_rpy_deg, rpy_from_matrix
from flexlink.cli.main import main
from flexlink.dynamics import rounding
from flexlink.engines import load
from flexlink.engines import mujoco as mujoco_engine
from flexlink.engines.mujoco import MujocoEngine
from flexlink.engines.pinocchio import PinocchioEngine
from flexlink.errors import ArgumentError, SingularMassError
from flexlink.formats import FORMATS
from flexlink.formats.document import decimals, unique
from flexlink.kernels.geometry.kinematics import forward_kinematics
from tests.conftest import ALUMINIUM, MODELS, ROOT, chain_of, flexible, make_scene, nasty_scene
from tests.support.words import refused

EPS = np.finfo(float).eps

# A rotation matrix is quadratic in its quaternion: rounding in the root, the division and the normalization (together
# 4 eps/2 per component) becomes 4 eps, evaluation adds 2.
QUATERNION = 6 * EPS
# The same for a matrix from three angles of up to pi, each rounded (eps) and accurate to one ulp of atan2 (eps).
ROLL_PITCH_YAW = QUATERNION + 6 * EPS
# Principal moments and axes are backward stable (3 eps), the axes then pass through a quaternion from both sides.
# Pinocchio merges any body on a joint, even without mass, as c = (m · (1/m)) c: eps/2 in the factor, eps/2 in
# the product. It does so twice per joint (for the link and its frame), and for the tip's two frames at the last one.
FUSION = EPS

STRANGE_NAMES = ['a<b>&"c"', "it's", "Gelenk-äöü", "関節"]
HOSTILE_NAMES = [*STRANGE_NAMES, "tab\tand\nline", "control\x01\x00", "]]>", "<!--", "\ud800"]


PLAIN = [path for path in MODELS if (one := lump(load_scene(path))).is_serial and not one.slides.any()]
"""Scenes for which every number is compared; `test_trees_engines` covers trees and sliding joints."""


@pytest.fixture(params=[*PLAIN, None], ids=lambda path: path.stem if path else "nasty")
def chain(request: pytest.FixtureRequest) -> Chain:
    return lump(load_scene(request.param) if request.param else nasty_scene())


def scrambled(chain: Chain, rng: np.random.Generator) -> Chain:
    """The chain with all hinge numbers different, so that none can be taken for another."""
    hinges = chain.hinges.copy()
    for field in ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature"):
        hinges[field] = rng.uniform(0.1, 1.0, chain.n)
    return dataclasses.replace(chain, hinges=hinges)


@pytest.fixture
def odd(chain: Chain, rng: np.random.Generator) -> Chain:
    """Every scene's chain with scrambled hinge numbers."""
    return scrambled(chain, rng)


def test_pinocchio_reads_back_every_mass_centre_and_inertia(odd: Chain) -> None:
    model = PinocchioEngine(odd).model
    heavy = odd.bodies[:-1]["stop"].tolist()  # the last joint at each point; Pinocchio counts joints from 1
    for j, body in zip(heavy, odd.bodies[:-1], strict=True):
        inertia, fusions = model.inertias[j], 4 if j == odd.n else 2
        assert inertia.mass == body["mass"]
        assert_allclose(inertia.lever, body["center"], rtol=fusions * FUSION, atol=0)
        assert_allclose(inertia.inertia, body["inertia"], rtol=0, atol=EPS * body["inertia"].max())
    assert all(model.inertias[j].mass == 0 for j in range(1, model.njoints) if j not in heavy)


def test_pinocchio_reads_back_every_axis_and_placement(odd: Chain) -> None:
    engine = PinocchioEngine(odd)
    model, tip = engine.model, engine.model.frames[engine.tip]
    for body in odd.bodies[:-1]:
        for k in range(body["first"], body["stop"]):
            placement, first = model.jointPlacements[k + 1], k == body["first"]
            assert model.joints[k + 1].shortname() == "JointModelR" + "XYZ"[odd.hinges["axis"][k]]
            assert_array_equal(placement.translation, body["translation"] if first else np.zeros(3))
            wanted = body["rotation"] if first else np.eye(3)
            assert_allclose(placement.rotation, wanted, rtol=0, atol=ROLL_PITCH_YAW)
    assert tip.parentJoint == odd.n
    assert_array_equal(tip.placement.translation, odd.bodies["translation"][-1])
    assert_allclose(tip.placement.rotation, odd.bodies["rotation"][-1], rtol=0, atol=ROLL_PITCH_YAW)


def test_pinocchio_reads_back_every_joint_number_exactly(odd: Chain) -> None:
    engine = PinocchioEngine(odd)
    for field in ("stiffness", "rest", "damping", "coulomb", "coulomb_width"):
        assert_array_equal(getattr(engine, field), odd.hinges[field], field)
    assert_array_equal(engine.model.armature, odd.hinges["armature"])
    assert_array_equal(engine.model.gravity.linear, odd.gravity)


def test_mujoco_reads_back_every_axis_and_placement(chain: Chain) -> None:
    engine = MujocoEngine(chain)
    engine.mass_matrix(np.zeros(chain.n))  # places all bodies at zero angles
    nb = len(chain.bodies)
    rotations, points, axes = forward_kinematics(chain.arrays, np.zeros(chain.n))
    turn = nb * QUATERNION  # rotations are multiplied along the chain
    reach = np.linalg.norm(chain.bodies["translation"], axis=1).sum()
    anchors = np.repeat(points, chain.bodies["stop"] - chain.bodies["first"], axis=0)
    assert_allclose(engine.data.xaxis, axes, rtol=0, atol=turn)
    assert_allclose(engine.data.xanchor, anchors, rtol=0, atol=turn * reach)
    assert_allclose(engine.data.site_xpos[0], points[-1], rtol=0, atol=turn * reach)
    assert_allclose(engine.data.site_xmat[0].reshape(3, 3), rotations[-1], rtol=0, atol=turn)


def test_mujoco_places_an_arm_correctly_after_massless_rotations() -> None:
    """M and torques do not depend on the base position, so tip positions are compared."""
    turns = [
        Link(name=f"gimbal {k}", length=0.1 * k, mount=Mount(xyz=(0.1, -0.2, 0.3), rpy_deg=(30.0 * k, 40.0, -50.0)))
        for k in range(3)
    ]
    chain = lump(make_scene(*turns, flexible("arm", "xyz", mount=Mount(rpy_deg=(0.0, 60.0, 10.0)))))
    engine, posture = MujocoEngine(chain), np.zeros(chain.n)
    engine.mass_matrix(posture)  # places all bodies
    reach = np.linalg.norm(chain.bodies["translation"], axis=1).sum()
    assert_allclose(
        engine.data.site_xpos[0], tip_position(chain, posture), rtol=0, atol=len(chain.bodies) * QUATERNION * reach
    )


def test_mujoco_places_bodies_outboard_of_massive_bodies_exactly(chain: Chain) -> None:
    model, bodies = MujocoEngine(chain).model, chain.bodies
    heavy = bodies["mass"] > 0
    for i, b in enumerate(np.flatnonzero(heavy), start=1):
        if b > 0 and heavy[b - 1]:
            hinges = range(model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i])
            assert list(hinges) == list(range(bodies["first"][b], bodies["stop"][b]))
            assert_array_equal(model.body_pos[i], bodies["translation"][b])
            assert_allclose(rotation(model.body_quat[i]), bodies["rotation"][b], rtol=0, atol=QUATERNION)
            assert_array_equal(model.jnt_axis[hinges], np.eye(3)[chain.hinges["axis"][hinges]])
            assert not model.jnt_pos[hinges].any()


def test_mujoco_reads_back_every_joint_number_exactly(odd: Chain) -> None:
    engine = MujocoEngine(odd)
    model = engine.model
    read = {
        "stiffness": model.jnt_stiffness, "rest": model.qpos_spring, "damping": model.dof_damping,
        "coulomb": engine.coulomb, "coulomb_width": engine.coulomb_width, "armature": model.dof_armature,
    }  # fmt: skip
    for field, values in read.items():
        assert_array_equal(values, odd.hinges[field], field)
    assert_array_equal(model.opt.gravity, odd.gravity)


def test_joints_keep_their_names_and_order_in_both_engines(chain: Chain) -> None:
    names = [chain.joint_name(k) for k in range(chain.n)]
    assert list(PinocchioEngine(chain).model.names)[1:] == names
    assert mujoco_joint_names(chain) == names


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("name", HOSTILE_NAMES, ids=ascii)
def test_any_name_gives_valid_xml(name: str, format: str) -> None:
    chain = dataclasses.replace(lump(make_scene(flexible(name, "yz", 3), flexible("fore"))), name=name)
    root = ET.fromstring(FORMATS[format].write(chain))
    readable = "".join("\ufffd" if c in "\x00\x01\ud800" else c for c in name)
    assert readable in (root.get("name"), root.get("model"), *(model.get("name") for model in root.iter("model")))
    assert any(joint.get("name", "").startswith(readable) for joint in root.iter("joint"))


@pytest.mark.parametrize("name", STRANGE_NAMES, ids=ascii)
def test_engines_keep_unusual_joint_names(name: str) -> None:
    chain = lump(make_scene(flexible(name, "yz", 3)))
    names = [name, f"{name}.1.y", f"{name}.1.z", f"{name}.2.y", f"{name}.2.z"]
    assert list(PinocchioEngine(chain).model.names)[1:] == names
    assert mujoco_joint_names(chain) == names


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_colliding_names_get_different_suffixes(engine: str) -> None:
    names = ("upper", "upper.1.z", "universe", "world", "tip", "base_link", "tip_joint")
    chain = lump(make_scene(*(flexible(name, segments=2) for name in names)))
    assert load(engine, chain).n == chain.n == 2 * len(names)


def test_roll_pitch_yaw_are_exact_near_and_at_a_pitch_of_90_degrees(rng: np.random.Generator) -> None:
    for exponent in range(-16, 2):
        roll, yaw = rng.uniform(-180, 180, 2)
        R = matrix_from_rpy_deg((roll, 90 - 10.0**exponent, yaw))
        back = matrix_from_rpy_deg(tuple(np.degrees(rpy_from_matrix(R))))
        assert_allclose(back, R, rtol=0, atol=ROLL_PITCH_YAW)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_generated_models_are_up_to_date(path: Path, tmp_path: Path) -> None:
    assert main(["export", str(path), "--out", str(tmp_path)]) == 0
    for fresh in tmp_path.iterdir():
        file = ROOT / "models" / "generated" / fresh.name
        assert file.exists() and file.read_text("utf-8") == fresh.read_text("utf-8"), (
            f"{file.name} is stale; run: flexlink export models/*.toml --out models/generated"
        )


def test_every_generated_model_has_a_scene() -> None:
    wanted = {path.stem + format.ending for path in MODELS for format in FORMATS.values()}
    assert {path.name for path in (ROOT / "models" / "generated").iterdir()} == wanted


def test_export_is_the_same_every_time() -> None:
    for format in FORMATS.values():
        assert format.write(lump(nasty_scene())) == format.write(lump(nasty_scene()))


@pytest.mark.slow
def test_a_chain_too_long_for_mujoco_is_refused_and_the_longest_loads() -> None:
    with refused(ArgumentError, "engine-cannot-load"):
        MujocoEngine(lump(make_scene(flexible("long", segments=490))))
    assert MujocoEngine(lump(make_scene(flexible("long", segments=489)))).n == 489


def test_mujoco_refuses_a_last_link_without_mass() -> None:
    chain = lump(make_scene(flexible("upper"), Link(name="wrist")))
    with refused(ArgumentError, "engine-cannot-load"):
        MujocoEngine(chain)


def thin_strip(width: float, **fields: object) -> Chain:
    """A planar strip of 1 m × 10 mm × `width` in eight segments."""
    strip = Section(shape="rectangle", height=0.01, width=width)
    link = flexible("a", "yz", 9, length=1.0, section="strip", **fields)
    return chain_of(Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"strip": strip}), (0.0, 0.0, 9.81))


def test_segments_too_light_for_mujoco_are_refused_and_slightly_heavier_ones_load() -> None:
    """I_xx = ρ l (I_y + I_z) of the shortest segment crosses MuJoCo's lower limit, 1e-15 kg m²."""
    least = min(thin_strip(1e-3).bodies["inertia"][:-1, 0, 0]) / 1e-3  # proportional to the width of a thin strip
    for share, loads in ((1.01, True), (0.99, False)):
        chain = thin_strip(float(share * 1e-15 / least))
        if loads:
            assert MujocoEngine(chain).n == chain.n
        else:
            with refused(ArgumentError, "inertia-impossible"):
                to_mjcf(chain)
            assert PinocchioEngine(chain).n == chain.n  # Pinocchio loads the URDF file


def test_a_point_mass_is_refused_by_name() -> None:
    point_mass = lump(make_scene(Link(name="rod", length=1.0, mount=Mount()), tip=RigidBody(mass=1.0)))
    with refused(ArgumentError, "inertia-impossible"):
        to_mjcf(point_mass)


def test_an_inertia_that_no_body_can_have_is_refused_by_name() -> None:
    wheel, load = RigidBody(inertia=(0.0, 0.0, 1.1)), RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    flat = lump(make_scene(Link(name="rod", length=1.0, hub=wheel), tip=load))
    with refused(ArgumentError, "inertia-impossible"):
        to_mjcf(flat)
    assert PinocchioEngine(flat).n == 1


def test_a_refusal_by_mujoco_becomes_a_flexlink_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_engine, "to_mjcf", lambda *_, **__: "<mujoco><nonsense/></mujoco>")
    with refused(ArgumentError, "engine-cannot-load"):
        MujocoEngine(lump(make_scene(flexible("a"))))


@pytest.mark.slow
@pytest.mark.parametrize("damping", [None, Damping(ratio=0.01, at_hz=1.0)])
def test_a_mass_matrix_close_to_singular_is_exported_or_refused_by_name(damping: Damping | None) -> None:
    """Near the bound, Cholesky factorization by columns once succeeded, but by rows it failed with a traceback."""
    known = 0
    for mass in np.logspace(13.0, 14.0, 41):
        link = flexible("a", "z", 5, length=1.6527754983443814, section="round", lumping="gauss", damping=damping)
        arm = Arm(
            links=(link,), materials={"aluminium": ALUMINIUM},
            sections={"round": Section(shape="circle", diameter=0.04)}, tip=RigidBody(mass=float(mass)),
        )  # fmt: skip
        chain = chain_of(arm, (0.0, 0.0, 9.81))
        for work in (to_mjcf, modes, stable_step):
            try:
                work(chain)
            except SingularMassError as error:
                assert error.id == "joint-without-inertia"
                known += 1
    assert 0 < known < 3 * 41


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def mujoco_joint_names(chain: Chain) -> list[str]:
    model = MujocoEngine(chain).model
    return [model.joint(k).name for k in range(model.njnt)]


def test_numbers_read_back_exactly_and_negative_zero_is_written_as_zero(rng: np.random.Generator) -> None:
    values = np.concatenate([rng.normal(size=50) * 10.0 ** rng.integers(-12, 12, 50), [0.1 + 0.2, 1 / 3, 5e-324]])
    assert [float(word) for word in decimals(values).split()] == values.tolist()
    assert decimals([-0.0, 0.0, -1.5]) == "0.0 0.0 -1.5"


def test_repeated_names_get_numbered_suffixes() -> None:
    assert unique(["a", "b", "a", "a", "a_2"]) == ["a", "b", "a_2", "a_3", "a_2_2"]


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_engines_read_products_of_inertia_in_the_right_order(engine: str, rng: np.random.Generator) -> None:
    pytest.importorskip(engine)
    chain = fl.lump(nasty_scene())
    bodies = chain.bodies.copy()
    B = rng.normal(size=(len(bodies), 3, 3))
    S = 0.1 * B @ B.transpose(0, 2, 1)  # ∫ x xᵀ dm; moments derived from it meet the triangle inequality
    full = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S
    heavy = bodies["mass"] > 0
    bodies["inertia"][heavy] = full[heavy]
    chain = dataclasses.replace(chain, bodies=bodies)
    q, qd = rng.uniform(-1, 1, (2, chain.n))
    other, M = load(engine, chain), fl.mass_matrix(chain, q)
    assert other.mass_matrix(q) == pytest.approx(M, rel=0, abs=1e-12 * np.abs(M).max())
    wanted = fl.bias_torque(chain, q, qd)
    assert other.bias_torque(q, qd) == pytest.approx(wanted, rel=0, abs=1e-12 * np.abs(wanted).max())


def test_pinocchio_reads_a_wheel_without_mass() -> None:
    pytest.importorskip("pinocchio")
    links = fl.Link(name="a", length=0.5, hub=fl.RigidBody(inertia=(0.1, 0.2, 0.3))), fl.Link(name="b", length=0.5)
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))))
    q = np.array([0.3, 0.7])
    M = fl.mass_matrix(chain, q)
    assert load("pinocchio", chain).mass_matrix(q) == pytest.approx(M, rel=0, abs=rounding.of_mass_matrix(chain, q))


def test_the_time_step_of_an_mjcf_file_is_at_most_half_the_largest_stable_one() -> None:
    for segments in (3, 5, 9):
        chain = fl.lump(make_scene(flexible("a", segments=segments), flexible("b", "xyz", segments)))
        option = ET.fromstring(fl.to_mjcf(chain)).find("option")
        assert option is not None
        limit = fl.stable_step(chain, np.linspace(0.1, 0.4, chain.n), method="RK4")
        assert 0.2 * limit < float(option.get("timestep", "nan")) <= 0.5 * limit
    stated = ET.fromstring(fl.to_mjcf(chain, timestep=1.2e-4)).find("option")
    assert stated is not None
    assert float(stated.get("timestep", "nan")) == 1.2e-4


def test_mujoco_does_not_reset_a_diverged_run(tmp_path, monkeypatch) -> None:
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log file to the working folder
    chain = fl.lump(make_scene(flexible("a")))
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))
    data = mujoco.MjData(model)
    data.qvel[:] = 1e9  # after a step the speed exceeds 1e10, the limit at which MuJoCo resets a run
    for _ in range(5):
        mujoco.mj_step(model, data)
    assert data.time == pytest.approx(5 * model.opt.timestep)  # no reset, which would set the time to 0
