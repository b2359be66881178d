"""Imported robots: the arm moves as the robot does, and a link that bends keeps mass, centre and inertia."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from urdf_texts import RandomRobot

import flexlink as fl
from flexlink.chain.rigid import Pose, SpatialInertia, body_with
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.describe.directions import line_of
from flexlink.diagnosis.states import random_states
from flexlink.dynamics.rounding import acceleration_error, in_units, of_bias_torque, of_mass_matrix
from flexlink.robots.cut import cut, largest_mass
from flexlink.robots.flexible import FlexibleLink, _prism, bent, payload
from flexlink.robots.importing import ImportResult, import_urdf
from flexlink.robots.positions import positions_of
from flexlink.robots.robot_file import read_robot
from flexlink.robots.tuning import clamped_frequency
from tests.words import refused
from validation.physics.source_urdf import Original

SEEDS = range(4)


@pytest.fixture
def robot(tmp_path: Path):
    """Writes a random robot, and imports it."""

    def write(seed: int, **flexible: FlexibleLink) -> tuple[RandomRobot, Path, ImportResult]:
        described, path = RandomRobot(seed), tmp_path / f"{seed}.urdf"
        path.write_text(described.text(), encoding="utf-8")
        found = import_urdf(
            path,
            base=described.base,
            tip=described.tip,
            posture=described.posture,
            locked=described.locked,
            flexible=flexible,
        )
        return described, path, found

    return write


@pytest.mark.parametrize("seed", SEEDS)
def test_an_imported_arm_moves_as_the_robot_does_in_pinocchio(seed: int, robot) -> None:
    """Branches, followers, fixed, locked and sliding joints included; mass matrix, torques and accelerations."""
    described, path, imported = robot(seed)
    chain = fl.lump(imported.scene)
    positions = {**described.posture, **described.locked}
    positions |= {f"d{k}": -0.7 * described.posture[f"b{k}"] + 0.2 for k in range(1, 10)}
    original = Original(path, list(described.free), positions, np.array(imported.scene.gravity))
    for s in random_states(chain, 5):
        M, T = original.mass_matrix(s.q), original.bias_torque(s.q, s.qd)
        assert in_units(fl.mass_matrix(chain, s.q) - M, of_mass_matrix(chain, s.q)).max() <= 1
        assert in_units(fl.bias_torque(chain, s.q, s.qd) - T, of_bias_torque(chain, s.q, s.qd)).max() <= 1
        theirs = original.acceleration(s.q, s.qd, s.tau - fl.friction_torque(chain, s.qd))
        ours = fl.forward_dynamics(chain, s.q, s.qd, s.tau)
        assert acceleration_error(chain, s.q, s.qd, s.tau, solutions=(ours, theirs)).max() <= 1


def test_friction_start_and_rotors_are_carried_over(robot) -> None:
    described, path, imported = robot(0)
    joints = {
        part.joint.name: link.joint for part, link in zip(imported.path.parts, imported.scene.arm.links, strict=False)
    }
    assert list(joints) == list(described.free)
    assert (joints["j5"].viscous, joints["j5"].coulomb) == (0.5, 0.25)
    assert imported.scene.initial.joint_deg[0] == pytest.approx(np.degrees(0.3), rel=1e-15)
    again = import_urdf(path, tip="p8", locked={"j4": 0.0}, armature={"j5": 0.2})
    assert [link.joint.armature for link in again.scene.arm.links if link.name == "p5"] == [0.2]
    assert len(again.path.parts) == 5
    assert "fixed at [rad, m]: j1 at 0.4, " in str(imported)
    assert "p3: includes a3, p4, c3, a4, c4, which" in str(imported)


def test_what_is_imported_is_shown_in_a_line(robot) -> None:
    _, path, imported = robot(0)
    assert repr(imported) == "<ImportResult 'random': 3 joints from p1 to p9>"
    assert repr(read_robot(path)) == "<Robot 'random': 28 links, 27 joints>"


def test_the_tip_is_where_the_link_is(robot) -> None:
    """Pinocchio's placement of the link's frame."""
    described, path, imported = robot(1)
    chain, q = fl.lump(imported.scene), np.array([0.1, -0.7, 1.3])
    import pinocchio as pin  # noqa: PLC0415

    original = Original(path, list(described.free), {**described.posture, **described.locked}, np.zeros(3))
    pin.framesForwardKinematics(original.model, original.data, original._posture(q))
    tip = original.data.oMf[original.model.getFrameId("p9 link")]
    assert fl.tip_position(chain, q) == pytest.approx(tip.translation, abs=1e-14)
    assert fl.frames(chain, q).rotations[-1] == pytest.approx(tip.rotation, abs=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_springs_that_do_not_bend_leave_the_arm_as_it_was(seed: int, robot) -> None:
    """The rigid block of M and T_GC, wherever the beam runs."""
    bends = {"line": ((0.02, 0.01, 0.0), (0.3, -0.1, 0.2)), "frequency_hz": 10.0, "flex": "xyz"}
    _, _, rigid = robot(seed)
    _, _, bent = robot(
        seed, p3=FlexibleLink(**bends), p8=FlexibleLink(frequency_hz=8.0, line=((0, 0, 0), (0.1, 0.2, 0.0)))
    )
    one, other = fl.lump(rigid.scene), fl.lump(bent.scene)
    for s in random_states(one, 3):
        q, qd = np.zeros((2, other.n))
        q[other.active], qd[other.active] = s.q, s.qd
        block = np.ix_(other.active, other.active)
        assert in_units(fl.mass_matrix(one, s.q) - fl.mass_matrix(other, q)[block], of_mass_matrix(other, q)).max() <= 1
        torque = fl.bias_torque(other, q, qd)[other.active]
        assert in_units(fl.bias_torque(one, s.q, s.qd) - torque, of_bias_torque(other, q, qd)).max() <= 1


def bodies(random: np.random.Generator) -> tuple[SpatialInertia, SpatialInertia, Pose, float]:
    """A link of some points, and a beam of 1 kg on some line."""
    points, masses = random.normal(size=(8, 3)) * random.uniform(0.01, 0.3, 3), random.uniform(0.1, 1.0, 8)
    points += random.normal(size=3) * 0.3
    center = masses @ points / masses.sum()
    link = body_with(masses.sum(), center, ((points - center).T * masses) @ (points - center))
    line = line_of(
        (tuple(random.normal(size=3) * 0.1), tuple(random.normal(size=3) * 0.5)), None, np.array([0, 0, 1.0])
    )
    pose, L = Pose(line.frame, line.start), line.length
    beam = body_with(1.0, np.array([L / 2, 0, 0]), np.diag([L**2 / 12, 1e-5, 2e-5])).moved(pose)
    return link, beam, pose, L


def test_a_cut_keeps_mass_centre_and_inertia_and_leaves_bodies_that_can_be(rng) -> None:
    """Rounding of second moments about points at most 3 m away: 1e-13."""
    for _ in range(100):
        link, beam, line, L = bodies(rng)
        mass = largest_mass(link, beam) * rng.uniform(0.01, 0.999)
        taken = SpatialInertia(mass, beam.center, beam.inertia * mass)
        parts = cut(link, taken, line, L)
        whole = parts[0].plus(parts[1]).plus(taken)
        assert whole.mass == pytest.approx(link.mass, rel=1e-14)
        assert whole.center == pytest.approx(link.center, abs=1e-13)
        assert whole.inertia == pytest.approx(link.inertia, abs=1e-13)
        for part in parts:
            assert np.linalg.eigvalsh(part.covariance)[0] >= -1e-14 * np.trace(part.inertia)


def test_the_largest_mass_is_the_one_beyond_which_the_rest_is_no_body(rng) -> None:
    for _ in range(100):
        link, beam, _, _ = bodies(rng)
        largest = largest_mass(link, beam)
        assert np.linalg.eigvalsh(link.moments - 0.999 * largest * beam.moments)[0] > 0
        assert np.linalg.eigvalsh(link.moments - 1.001 * largest * beam.moments)[0] < 0


def test_a_point_that_rounding_has_made_impossible_is_a_point() -> None:
    """As CAD writes it: −5e-20 kg m² of half a kilogram, 3 cm from its frame; 32 eps of its m c² are 3e-18."""
    center = np.array([0.0, 0.0, 0.03])
    assert (
        payload(SpatialInertia(0.526, center, np.diag([-5.42e-20, -5.42e-20, 0.0]))).matrix.tolist()
        == np.zeros((3, 3)).tolist()
    )
    with refused(fl.errors.SceneError, "inertia-impossible"):
        payload(SpatialInertia(0.526, center, np.diag([-5.42e-17, -5.42e-17, 0.0])))


def test_limits_of_1e16_are_none(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(
        RandomRobot(0).text().replace('lower="-3" upper="3"', 'lower="-1e16" upper="1e16"'), encoding="utf-8"
    )
    imported = import_urdf(path, tip="p8", locked={"j4": 0.0})
    assert {link.joint.limits_deg for link in imported.scene.arm.links} == {None}


def test_a_plate_has_no_room_for_what_stands_out_of_it() -> None:
    plate = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.02, 0.01, 0.0]))
    flat = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.01, 0.001, 0.0]))
    thick = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.01, 0.001, 1e-4]))
    assert largest_mass(plate, flat) == pytest.approx(1.0)
    assert largest_mass(plate, thick) == 0.0


@pytest.mark.parametrize("hertz", [5.0, 12.0, 40.0])
def test_a_link_gets_the_frequency_that_is_asked_for(hertz: float, robot) -> None:
    """f ∝ √E: one evaluation, one correction; at the start's posture, without gravity."""
    lines = {"p3": ((0, 0, 0), (0.1, 0.1, 0.2)), "p5": ((0, 0, 0), (0.2, 0.1, 0.0))}
    _, _, imported = robot(2, **{name: FlexibleLink(frequency_hz=hertz, line=line) for name, line in lines.items()})
    chain = fl.lump(imported.scene.varied({"gravity": [0.0, 0.0, 0.0]}))
    q, _ = fl.initial_state(imported.scene, chain)
    for name in lines:
        held = [joint for joint in chain.joint_names if not joint.startswith(f"{name}.")]
        found = fl.modes(chain, q, locked=held)
        assert found.hertz[0] == pytest.approx(hertz, rel=1e-9)


@pytest.mark.parametrize("name", ['3" pipe', "l.1", "*", "don't", "a=b", "é"])
def test_a_link_of_any_name_can_be_tuned(name: str, tmp_path: Path) -> None:
    text = RandomRobot(0).text().replace('"p3"', quoteattr(name))
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    imported = import_urdf(path, tip="p8", locked={"j4": 0.0}, flexible={name: FlexibleLink(frequency_hz=12.0)})
    assert clamped_frequency(imported.scene, name) == pytest.approx(12.0, rel=1e-6)


def test_a_beam_that_does_not_fit_is_refused_with_the_mass_that_does(robot) -> None:
    line = ((0, 0, 0), (0.1, 0.1, 0.2))
    with refused(ArgumentError, "beam-heavier-than-link") as caught:
        robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=900.0, line=line))
    fits = float(re.search(r"at most (\S+) kg", str(caught.value))[1])
    robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=fits, line=line))
    with refused(ArgumentError, "beam-heavier-than-link"):
        robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=1.002 * fits, line=line))


def test_little_room_for_a_beam_is_told(robot) -> None:
    _, _, imported = robot(3, p3=FlexibleLink(frequency_hz=9.0, line=((2, 2, 2), (3, 3, 3))))
    (warning,) = imported.warnings
    assert re.fullmatch(r"p3: only \d\.\d% of its mass fit into a beam along this line; check line", warning)


def test_a_follower_of_a_joint_that_moves_is_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(RandomRobot(0).text().replace('joint="b2"', 'joint="j3"'), encoding="utf-8")
    warnings = import_urdf(path, tip="p8", locked={"j4": 0.0}).warnings
    assert warnings == ("d2: mimics j3, which moves; here d2 does not",)


WRONG = {
    "base": ({"base": "p99"}, "base = 'p99': unknown; allowed are p0, "),
    "tip": ({"tip": "P8"}, "did you mean 'p8'"),
    "turned round": ({"base": "p8", "tip": "p1"}, "is not reached from base = 'p8'"),
    "no tip": ({"tip": []}, "tip = []: name a link, or leave it out for the whole robot"),
    "following": ({"tip": "c2"}, "joint 'd2', between 'p0' and 'c2', mimics 'b2'"),
    "no joints": ({"base": "p1", "tip": "p2"}, "no movable joint between 'p1' and 'p2'"),
    "unknown joint": ({"posture": {"j99": 0.0}}, "posture = 'j99': unknown"),
    "fixed": ({"posture": {"j2": 0.0}}, "posture: joint 'j2' is fixed"),
    "follower": ({"posture": {"d2": 0.0}}, "posture: joint 'd2' mimics 'b2'"),
    "limits": ({"posture": {"j3": 3.1}}, "posture: 'j3' = 3.1 rad (177.617°): must be between -3.0 rad ("),
    "limits of a slide": ({"locked": {"j4": 3.1}}, "locked: 'j4' = 3.1 m: must be between "),
    "stated twice": ({"posture": {"j4": 0.1}, "locked": {"j4": 0.2}}, "joint 'j4': is in posture and in locked"),
    "too high": (
        {"locked": {"j4": 0.0}, "flexible": {"p3": FlexibleLink(frequency_hz=1e200)}},
        "link 'p3': frequency_hz = 1e+200: needs young = inf Pa",
    ),
    "too low": (
        {"locked": {"j4": 0.0}, "flexible": {"p3": FlexibleLink(frequency_hz=1e-200)}},
        "link 'p3': frequency_hz = 1e-200: needs young = 0 Pa",
    ),
    "no number": ({"posture": {"j3": "x"}}, "posture: 'j3' = 'x': expected a finite number"),
    "NaN": ({"posture": {"j3": float("nan")}}, "posture: 'j3' = nan: expected a finite number"),
    "beside the path": ({"locked": {"b2": 0.1, "j4": 0.0}}, "locked: joint 'b2' is not between 'p0' and 'p8'"),
    "armature of nothing": ({"locked": {"j4": 0.0}, "armature": {"j4": 1.0}}, "joint 'j4' does not move in this arm"),
    "negative armature": ({"locked": {"j4": 0.0}, "armature": {"j5": -1.0}}, "armature: 'j5' = -1.0: expected"),
    "folded": ({"locked": {"j4": 0.0}, "flexible": {"p4": FlexibleLink(frequency_hz=1.0)}}, "is fixed to 'p3'"),
    "elsewhere": ({"locked": {"j4": 0}, "flexible": {"x": FlexibleLink(frequency_hz=1.0)}}, "'x' is not between base"),
    "no line": (
        {"locked": {"j4": 0}, "flexible": {"p3": FlexibleLink(frequency_hz=1.0, line=((0, 0, 0), (0, 0, 0)))}},
        "flexible: link 'p3': line = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)): is 0 m long",
    ),
    "no dict": ({"flexible": ["p3"]}, "flexible = ['p3']: expected a dict, got list"),
    "no Flexible": ({"locked": {"j4": 0.0}, "flexible": {"p3": 12.0}}, "expected a Flexible"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_the_robot_is_refused_by_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(RandomRobot(0).text(), encoding="utf-8")
    given, message = WRONG[name]
    with pytest.raises(FlexlinkError, match=re.escape(message)) as caught:
        import_urdf(path, **{"tip": "p8", **given})
    assert "\n" not in str(caught.value)


def test_a_flexible_link_needs_to_know_its_stiffness() -> None:
    with refused(fl.errors.SceneError, "missing-key"):
        FlexibleLink(mass=1.0)


def test_a_joint_that_cannot_be_at_zero_starts_in_the_middle(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    text = RandomRobot(0).text().replace('lower="-3"', 'lower="1"')
    path.write_text(text, encoding="utf-8")
    imported = import_urdf(path, tip="p8", locked={"j4": 1.0})
    assert imported.path.positions["j3"] == 2.0
    assert "j3: starts at 2 rad, the middle of its limits, which exclude 0" in imported.notes


def test_a_beam_is_a_solid_box_turned_along_its_line() -> None:
    """m/12 times the sums of squares of its sides, 2 m long, 0.3 m along its local y and 0.1 m along z."""
    section = fl.Section(shape="rectangle", height=0.3, width=0.1)
    found = _prism(section, 12.0, line_of(((0, 0, 0), (2, 0, 0)), (0, 1, 0), np.array([0, 0, 1.0])))
    up = _prism(section, 12.0, line_of(((0, 0, 0), (0, 0, 2)), (0, 1, 0), np.array([0, 0, 1.0])))
    y, z = line_of(((0, 0, 0), (2, 0, 0)), (0, 1, 0), np.array([0, 0, 1.0])).frame[:, 1:].T
    sides = np.abs(np.column_stack([[1.0, 0.0, 0.0], y, z])) @ [2.0, 0.3, 0.1]
    squares = sides**2
    assert np.diag(found.inertia) == pytest.approx(squares.sum() - squares)
    assert sorted(np.linalg.eigvalsh(up.inertia)) == pytest.approx(sorted(squares.sum() - squares))
    assert found.center == pytest.approx([1.0, 0.0, 0.0])


def test_a_beam_of_the_very_largest_mass_is_refused_for_what_it_would_leave(tmp_path: Path) -> None:
    """Of a rod of 1 kg, which is its own largest beam: nothing is left at its ends."""
    rod = body_with(1.0, np.array([0.5, 0.0, 0.0]), np.diag([1 / 12 + 1e-3, 2e-3, 2e-3]))
    part = SimpleNamespace(body=rod, link="rod", joint=SimpleNamespace(axis=np.array([0, 0, 1.0])))
    link = fl.Link(name="rod")
    section = fl.Section(shape="rectangle", height=0.01, width=0.01)
    largest = largest_mass(rod, _prism(section, 1.0, line_of(((0, 0, 0), (1, 0, 0)), None, part.joint.axis)))
    for mass, fits in ((0.999 * largest, True), (largest, False)):
        asked = FlexibleLink(section=section, mass=mass)
        with contextlib.nullcontext() if fits else refused(ArgumentError, "beam-heavier-than-link"):
            bent(cast("Any", part), link, asked, np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("lower", "upper", "stays"), [(-1.0, 3.0, 0.0), (0.0, 2.0, 0.0), (1.0, 3.0, 2.0), (-3.0, -1.0, -2.0)]
)
def test_a_joint_of_which_nothing_is_said_is_at_zero_or_in_the_middle_of_limits_without_it(
    lower: float, upper: float, stays: float
) -> None:
    joint = SimpleNamespace(name="j", limits=(lower, upper), mimic=None)
    robot = SimpleNamespace(joints={"j": joint}, position=lambda joint, leaders: leaders[joint.name])
    assert positions_of(cast("Any", robot), {}) == {"j": stays}
