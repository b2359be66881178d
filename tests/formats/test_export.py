"""Exported files represent the chain: the engines read back every number exactly or within rounding."""

import dataclasses
import importlib.util
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

import flexlink as fl
from flexlink.chain.rigid import matrix_from_rpy_deg, rpy_from_matrix
from flexlink.cli.main import main
from flexlink.common.safe_xml import parse
from flexlink.dynamics import rounding
from flexlink.engines import load
from flexlink.engines import mujoco as mujoco_engine
from flexlink.engines.mujoco import MujocoEngine
from flexlink.engines.pinocchio import PinocchioEngine
from flexlink.errors import ArgumentError, SingularMassError
from flexlink.formats import FORMATS
from flexlink.formats.document import decimals, unique, xml_joint_names
from tests.conftest import ALUMINIUM, MODELS, ROOT, chain_of, flexible, make_scene, nasty_scene
from tests.support.words import refused

EPS = np.finfo(float).eps

# A rotation matrix is quadratic in its quaternion: rounding in the root, the division and the normalization, 4 eps/2 a
# component, becomes 4 eps; evaluation adds 2. Three angles of up to pi add 6: each is rounded, and atan2 is as well.
ROLL_PITCH_YAW = 12 * EPS

STRANGE_NAMES = ['a<b>&"c"', "it's", "Gelenk-äöü", "関節"]
HOSTILE_NAMES = [*STRANGE_NAMES, "tab\tand\nline", "control\x01\x00", "]]>", "<!--", "\ud800"]


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("name", HOSTILE_NAMES, ids=ascii)
def test_any_name_gives_valid_xml(name: str, format: str) -> None:
    chain = dataclasses.replace(fl.lump(make_scene(flexible(name, "yz", 3), flexible("fore"))), name=name)
    root = ET.fromstring(FORMATS[format].write(chain))
    readable = "".join("\ufffd" if c in "\x00\x01\ud800" else c for c in name)
    assert readable in (root.get("name"), root.get("model"), *(model.get("name") for model in root.iter("model")))
    assert any(joint.get("name", "").startswith(readable) for joint in root.iter("joint"))


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_colliding_names_get_different_suffixes(engine: str) -> None:
    names = ("upper", "upper.1.z", "universe", "world", "tip", "base_link", "tip_joint")
    chain = fl.lump(make_scene(*(flexible(name, segments=2) for name in names)))
    assert load(engine, chain).n == chain.n == 2 * len(names)
    assert "universe" not in xml_joint_names(chain), "Pinocchio's root has this name"


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
        assert format.write(fl.lump(nasty_scene())) == format.write(fl.lump(nasty_scene()))


@pytest.mark.slow
def test_a_chain_too_long_for_mujoco_is_refused_and_the_longest_loads() -> None:
    with refused(ArgumentError, "engine-cannot-load"):
        MujocoEngine(fl.lump(make_scene(flexible("long", segments=490))))
    assert MujocoEngine(fl.lump(make_scene(flexible("long", segments=489)))).n == 489


def thin_strip(width: float, **fields: object) -> fl.Chain:
    """A planar strip of 1 m × 10 mm × `width` in eight segments."""
    strip = fl.Section(shape="rectangle", height=0.01, width=width)
    link = flexible("a", "yz", 9, length=1.0, section="strip", **fields)
    return chain_of(
        fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"strip": strip}), (0.0, 0.0, 9.81)
    )


def test_segments_too_light_for_mujoco_are_refused_and_slightly_heavier_ones_load() -> None:
    """I_xx = ρ l (I_y + I_z) of the shortest segment crosses MuJoCo's lower limit, 1e-15 kg m²."""
    least = min(thin_strip(1e-3).bodies["inertia"][:-1, 0, 0]) / 1e-3  # proportional to the width of a thin strip
    for share, loads in ((1.01, True), (0.99, False)):
        chain = thin_strip(float(share * 1e-15 / least))
        if loads:
            assert MujocoEngine(chain).n == chain.n
        else:
            with refused(ArgumentError, "inertia-impossible"):
                fl.to_mjcf(chain)
            assert PinocchioEngine(chain).n == chain.n  # Pinocchio loads the URDF file


SOLID = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
WHEEL = fl.RigidBody(inertia=(0.0, 0.0, 1.1))


@pytest.mark.parametrize(
    ("call", "links", "tip", "id"),
    [
        (MujocoEngine, (flexible("upper"), fl.Link(name="wrist")), None, "engine-cannot-load"),  # the wrist has no mass
        (fl.to_mjcf, (fl.Link(name="rod", length=1.0),), fl.RigidBody(mass=1.0), "inertia-impossible"),  # a point mass
        (fl.to_mjcf, (fl.Link(name="rod", length=1.0, hub=WHEEL),), SOLID, "inertia-impossible"),  # no body has this
    ],
)
def test_bodies_that_mujoco_cannot_have_are_refused_by_name(call, links, tip, id) -> None:
    chain = fl.lump(make_scene(*links, tip=tip))
    with refused(ArgumentError, id):
        call(chain)
    assert PinocchioEngine(chain).n == chain.n


def test_a_refusal_by_mujoco_becomes_a_flexlink_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_engine, "to_mjcf", lambda *_, **__: "<mujoco><nonsense/></mujoco>")
    with refused(ArgumentError, "engine-cannot-load"):
        MujocoEngine(fl.lump(make_scene(flexible("a"))))


@pytest.mark.slow
@pytest.mark.parametrize("damping", [None, fl.Damping(ratio=0.01, at_hz=1.0)])
def test_a_mass_matrix_close_to_singular_is_exported_or_refused_by_name(damping: fl.Damping | None) -> None:
    """Near the bound, Cholesky factorization by columns once succeeded, but by rows it failed with a traceback."""
    known = 0
    for mass in np.logspace(13.0, 14.0, 41):
        link = flexible("a", "z", 5, length=1.6527754983443814, section="round", lumping="gauss", damping=damping)
        arm = fl.Arm(
            links=(link,), materials={"aluminium": ALUMINIUM},
            sections={"round": fl.Section(shape="circle", diameter=0.04)}, tip=fl.RigidBody(mass=float(mass)),
        )  # fmt: skip
        chain = chain_of(arm, (0.0, 0.0, 9.81))
        for work in (fl.to_mjcf, fl.modes, fl.stable_step):
            try:
                work(chain)
            except SingularMassError as error:
                assert error.id == "joint-without-inertia"
                known += 1
    assert 0 < known < 3 * 41


def test_numbers_read_back_exactly_and_negative_zero_is_written_as_zero(rng: np.random.Generator) -> None:
    values = np.concatenate([rng.normal(size=50) * 10.0 ** rng.integers(-12, 12, 50), [0.1 + 0.2, 1 / 3, 5e-324]])
    assert [float(word) for word in decimals(values).split()] == values.tolist()
    assert decimals([-0.0, 0.0, -1.5]) == "0.0 0.0 -1.5"


def test_repeated_names_get_numbered_suffixes() -> None:
    assert unique(["a", "b", "a", "a", "a_2"]) == ["a", "b", "a_2", "a_3", "a_2_2"]


def test_pinocchio_reads_a_wheel_without_mass() -> None:
    links = fl.Link(name="a", length=0.5, hub=fl.RigidBody(inertia=(0.1, 0.2, 0.3))), fl.Link(name="b", length=0.5)
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))))
    q = np.array([0.3, 0.7])
    M = fl.mass_matrix(chain, q)
    assert PinocchioEngine(chain).mass_matrix(q) == pytest.approx(M, rel=0, abs=rounding.of_mass_matrix(chain, q))


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
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log file to the working folder
    chain = fl.lump(make_scene(flexible("a")))
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))
    data = mujoco.MjData(model)
    data.qvel[:] = 1e9  # after a step the speed exceeds 1e10, the limit at which MuJoCo resets a run
    for _ in range(5):
        mujoco.mj_step(model, data)
    assert data.time == pytest.approx(5 * model.opt.timestep)  # no reset, which would set the time to 0


drake = pytest.mark.skipif(importlib.util.find_spec("pydrake") is None, reason="needs Drake")
COLLIDING = ("a", "a_link", "a_child", "a.1.z", "world", "__it__", "tip", "x::y", "x.y", 'a<b>&"c"', "関節")


COUNT_MOTORS = """
import sys
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(sys.stdin.read(), "sdf")
plant.Finalize()
print(plant.num_actuators())
"""
"""Program for a separate process, which some files abort."""


@drake
@pytest.mark.slow
def test_drake_finds_a_motor_at_every_driven_joint_and_warns_only_of_gravity() -> None:
    chain = fl.lump(nasty_scene())
    command = [sys.executable, "-c", COUNT_MOTORS]
    done = subprocess.run(command, input=fl.to_sdf(chain), capture_output=True, text=True, check=True)
    assert int(done.stdout) == len(chain.active)
    assert all("world" in warning and "gravity" in warning for warning in done.stderr.splitlines())


@drake
@pytest.mark.slow
def test_drake_reads_any_names() -> None:
    chain = dataclasses.replace(fl.lump(make_scene(*(flexible(name, segments=2) for name in COLLIDING))), name="world")
    assert load("drake", chain).n == chain.n


def test_a_rotor_has_a_motor_in_the_file_and_a_spring_without_a_rotor_has_none() -> None:
    """Drake drops the rotor of a joint whose effort is 0."""
    chain = fl.lump(nasty_scene())
    hinges = chain.hinges.copy()
    hinges["armature"][2] = 0.3
    rotors = dataclasses.replace(chain, hinges=hinges)
    for k, joint in enumerate(parse(fl.to_sdf(rotors), "nasty").iter("joint")):
        rotor = joint.findtext("{http://drake.mit.edu}rotor_inertia", "0.0")
        assert float(rotor) == rotors.hinges["armature"][k]
        driven = joint.findtext("axis/limit/effort") != "0"
        assert driven == (k in rotors.active or float(rotor) != 0)


def test_every_link_has_its_mass_even_if_it_is_zero() -> None:
    """SDFormat assumes 1 kg for a link without a mass."""
    chain = fl.lump(nasty_scene())
    masses = [float(link.findtext("inertial/mass", "nan")) for link in parse(fl.to_sdf(chain), "nasty").iter("link")]
    heavy = {body["stop"] - 1: body["mass"] for body in chain.bodies[:-1]}
    assert masses == [heavy.get(k, 0.0) for k in range(chain.n)]
