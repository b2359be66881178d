"""An imported arm moves like the robot; a link made flexible keeps its mass, centre of mass and inertia."""

import contextlib
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia, body_with
from flexlink.cli import import_robot
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.describe.directions import line_of
from flexlink.diagnosis.quantities import random_states
from flexlink.dynamics.rounding import acceleration_error, in_units, of_bias_torque, of_mass_matrix
from flexlink.robots.collection import KnownArm
from flexlink.robots.flexible import FlexibleLink, _prism, bent, cut, largest_mass, payload, rounded_down
from flexlink.robots.importing import ImportResult, clamped_frequency, import_urdf
from flexlink.robots.kinematic_tree import Mimic, Robot, positions_of
from flexlink.robots.paths import Part, Paths, Tip
from flexlink.robots.robot_file import read_robot
from tests.support.urdf_texts import RandomRobot, saved
from tests.support.words import line, refused, reviewed
from validation.physics.source_urdf import Original

SEEDS = range(4)


@pytest.fixture
def robot(tmp_path: Path):
    """Return a function that writes a random robot and imports it."""

    def write(seed: int, **flexible: FlexibleLink) -> tuple[RandomRobot, Path, ImportResult]:
        described, path = RandomRobot(seed), tmp_path / f"{seed}.urdf"
        path.write_text(described.text(), encoding="utf-8")
        found = import_urdf(
            path, base=described.base, tip=described.tip, posture=described.posture, locked=described.locked,
            flexible=flexible,
        )  # fmt: skip
        return described, path, found

    return write


@pytest.mark.parametrize("seed", SEEDS)
def test_an_imported_arm_moves_like_the_robot_in_pinocchio(seed: int, robot) -> None:
    """Mass matrix, torques and accelerations agree, also with branches and mimic, fixed, locked and sliding joints."""
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


def test_friction_initial_angles_and_rotors_are_imported(robot) -> None:
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
    summary = str(imported)
    assert " j1 at 0.4, " in summary
    assert line(summary, "p3: ", " a3, p4, c3, a4, c4, ")
    reviewed("import: summary", summary)


def test_a_moving_link_without_inertia_is_named(tmp_path: Path) -> None:
    whole = Path("examples/reach_arm.urdf")
    assert not [note for note in import_urdf(whole).notes if note.id == "no-mass"]
    text = whole.read_text(encoding="utf-8")
    before, forearm, after = text.partition('<link name="forearm"')
    without = re.sub("<inertial>.*?</inertial>", "", after, count=1, flags=re.DOTALL)
    path = saved(tmp_path, before + forearm + without, "without")
    (note,) = (note for note in import_urdf(path).notes if note.id == "no-mass")
    reviewed(note.id, note)
    assert not [note for note in import_urdf(path).notes if note.id == "no-beam"]


def test_imports_and_robots_have_a_short_representation(robot) -> None:
    _, path, imported = robot(0)
    for shown, names in (
        (repr(imported), ("'random'", "3 joints", "p1", "p9")),
        (repr(read_robot(path)), ("'random'", "28 links", "27 joints")),
    ):
        assert all(name in shown for name in names)
        reviewed("repr", shown)


def test_the_tip_is_at_the_frame_of_its_link(robot) -> None:
    """The tip is compared with Pinocchio's placement of the link's frame."""
    described, path, imported = robot(1)
    chain, q = fl.lump(imported.scene), np.array([0.1, -0.7, 1.3])
    original = Original(path, list(described.free), {**described.posture, **described.locked}, np.zeros(3))
    pin.framesForwardKinematics(original.model, original.data, original._posture(q))
    tip = original.data.oMf[original.model.getFrameId("p9 link")]
    assert fl.tip_position(chain, q) == pytest.approx(tip.translation, abs=1e-14)
    assert fl.frames(chain, q).rotations[-1] == pytest.approx(tip.rotation, abs=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_link_made_flexible_leaves_the_rigid_motion_unchanged(seed: int, robot) -> None:
    """The rigid block of M and T_GC does not depend on the line of the beam."""
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
    """A rigid link made of point masses, and a beam of 1 kg along a random line."""
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


def test_splitting_a_link_conserves_mass_centre_and_inertia(rng) -> None:
    """Rounding of second moments about points up to 3 m away is 1e-13."""
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


def test_what_remains_of_a_link_before_or_beyond_its_beam_is_at_this_end_of_it() -> None:
    beam = body_with(0.1, np.array([0.5, 0.0, 0.0]), np.diag([0.1 / 12, 0.0, 0.0]))
    for x, masses in ((-0.5, [2.0, 0.0]), (1.5, [0.0, 2.0])):
        link = body_with(2.0, np.array([x, 0.0, 0.0]), np.eye(3)).plus(beam)
        assert [one.mass for one in cut(link, beam, HERE, 1.0)] == pytest.approx(masses)


def test_above_the_largest_beam_mass_the_remaining_body_is_impossible(rng) -> None:
    for _ in range(100):
        link, beam, _, _ = bodies(rng)
        largest = largest_mass(link, beam)
        assert np.linalg.eigvalsh(link.moments - 0.999 * largest * beam.moments)[0] > 0
        assert np.linalg.eigvalsh(link.moments - 1.001 * largest * beam.moments)[0] < 0


def test_rounding_errors_of_a_point_mass_are_corrected_and_larger_errors_kept() -> None:
    """CAD exports such values: −5e-20 kg m² for 0.5 kg at 3 cm from the frame; 32 eps m c² = 3e-18 is allowed."""
    center = np.array([0.0, 0.0, 0.03])
    assert (
        payload(SpatialInertia(0.526, center, np.diag([-5.42e-20, -5.42e-20, 0.0]))).matrix.tolist()
        == np.zeros((3, 3)).tolist()
    )
    larger = np.diag([-5.42e-17, -5.42e-17, 0.0])
    assert payload(SpatialInertia(0.526, center, larger)).matrix.tolist() == larger.tolist()


@pytest.mark.parametrize("upper", ["1e16", "3"])
def test_limits_of_1e16_mean_no_limits(tmp_path: Path, upper: str) -> None:
    path = saved(tmp_path, RandomRobot(0).text().replace('lower="-3" upper="3"', f'lower="-1e16" upper="{upper}"'))
    imported = import_urdf(path, tip="p8", locked={"j4": 0.0})
    assert {link.joint.limits_deg for link in imported.scene.arm.links} == {None}


def test_equal_limits_are_ignored_also_for_a_given_position(tmp_path: Path) -> None:
    path = saved(tmp_path, RandomRobot(0).text().replace('lower="-3" upper="3"', 'lower="0" upper="0"'))
    assert import_urdf(path, tip="p8", posture={"j3": 0.5}, locked={"j4": 0.2}).path.positions["j3"] == 0.5


def test_a_beam_ends_at_the_first_of_equal_branches() -> None:
    places = [Pose(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.0, 1.0, 2.0)]
    parts = [Part(cast("Any", None), "-", k > 0, place, NOTHING, ()) for k, place in enumerate(places)]
    tips = Tip("b", 2, places[0]), Tip("c", 3, places[0]), Tip("d", 3, places[1])
    first, _, last = Paths("base", tips, tuple(parts), {}, ()).beyond()
    assert first is places[1] and last is places[0]


def test_the_largest_mass_of_a_beam_is_printed_rounded_down() -> None:
    assert [rounded_down(mass) for mass in (1.99996, 0.0123456, 0.0)] == ["1.999", "0.01234", "0"]


def test_a_plate_cannot_contain_a_thicker_beam() -> None:
    plate = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.02, 0.01, 0.0]))
    flat = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.01, 0.001, 0.0]))
    thick = body_with(1.0, np.array([0.2, 0.0, 0.0]), np.diag([0.01, 0.001, 1e-4]))
    assert largest_mass(plate, flat) == pytest.approx(1.0)
    assert largest_mass(plate, thick) == 0.0


def test_a_rod_along_any_axis_can_be_a_beam() -> None:
    """Sines and cosines of multiples of 90° have rounding errors, which are no thickness."""
    beam = SpatialInertia(1.0, np.array([0.4, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0]) * 0.8**2 / 12)
    rod = SpatialInertia(1.7, beam.center, 1.7 * beam.inertia)
    for turns in np.ndindex(4, 4, 4):
        turned = Pose(Rotation.from_euler("xyz", np.multiply(turns, np.pi / 2)).as_matrix(), np.zeros(3))
        assert largest_mass(rod.moved(turned), beam.moved(turned)) == pytest.approx(1.7)


@pytest.mark.parametrize("hertz", [5.0, 12.0, 40.0])
def test_the_beam_stiffness_is_tuned_to_the_required_frequency(hertz: float, robot) -> None:
    """Since f ∝ √E, one evaluation and one correction suffice, in the initial configuration without gravity."""
    lines = {"p3": ((0, 0, 0), (0.1, 0.1, 0.2)), "p5": ((0, 0, 0), (0.2, 0.1, 0.0))}
    _, _, imported = robot(2, **{name: FlexibleLink(frequency_hz=hertz, line=line) for name, line in lines.items()})
    chain = fl.lump(imported.scene.varied({"gravity": [0.0, 0.0, 0.0]}))
    q, _ = fl.initial_state(imported.scene, chain)
    for name in lines:
        held = [joint for joint in chain.joint_names if not joint.startswith(f"{name}.")]
        found = fl.modes(chain, q, locked=held)
        assert found.hertz[0] == pytest.approx(hertz, rel=1e-9)


@pytest.mark.parametrize("name", ['3" pipe', "l.1", "*", "don't", "a=b", "é"])
def test_a_link_with_any_name_can_be_tuned(name: str, tmp_path: Path) -> None:
    text = RandomRobot(0).text().replace('"p3"', quoteattr(name))
    path = saved(tmp_path, text)
    imported = import_urdf(path, tip="p8", locked={"j4": 0.0}, flexible={name: FlexibleLink(frequency_hz=12.0)})
    assert clamped_frequency(imported.scene, name) == pytest.approx(12.0, rel=1e-6)


def test_a_beam_that_is_too_heavy_is_refused_with_the_largest_mass(robot) -> None:
    line = ((0, 0, 0), (0.1, 0.1, 0.2))
    with refused(ArgumentError, "beam-heavier-than-link") as caught:
        robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=900.0, line=line))
    fits = min(map(float, re.findall(r" (\S+) kg", str(caught.value))))  # the smallest mass in the message
    robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=fits, line=line))
    with refused(ArgumentError, "beam-heavier-than-link"):
        robot(3, p3=FlexibleLink(frequency_hz=9.0, mass=1.002 * fits, line=line))


def test_a_small_limit_on_the_beam_mass_gives_a_warning(robot) -> None:
    _, _, imported = robot(3, p3=FlexibleLink(frequency_hz=9.0, line=((2, 2, 2), (3, 3, 3))))
    (warning,) = imported.warnings
    assert warning.startswith("p3: ")
    assert float(re.search(r" (\S+) ?%", warning)[1]) < 10
    reviewed("import: room for a beam", warning, values=False)


def test_a_joint_that_mimics_a_moving_joint_gives_a_warning(tmp_path: Path) -> None:
    path = saved(tmp_path, RandomRobot(0).text().replace('joint="b2"', 'joint="j3"'))
    (warning,) = import_urdf(path, tip="p8", locked={"j4": 0.0}).warnings
    assert warning.startswith("d2: ") and " j3" in warning
    reviewed("import: mimic joint", warning)


def test_angles_in_degrees_give_warnings(tmp_path: Path) -> None:
    path, text = tmp_path / "robot.urdf", RandomRobot(0).text()
    text = text.replace('lower="-3" upper="3"', 'lower="-180" upper="180"', 1)
    path.write_text(re.sub('(<joint name="j3".*?rpy=)"[^"]*"', r'\1"90 0 0"', text), encoding="utf-8")
    for_places, for_limits = import_urdf(path, tip="p8", locked={"j4": 0.0}).warnings
    assert for_places.startswith("joint 'j3': ") and "'90 0 0'" in for_places
    assert for_limits.startswith("joint 'j1': ") and " 180:" in for_limits
    for warning in (for_places, for_limits):
        assert warning.id == "likely-degrees"
        reviewed("likely-degrees", warning)
    two_turns = saved(tmp_path, RandomRobot(0).text().replace('lower="-3" upper="3"', 'lower="-12" upper="12"'))
    assert not import_urdf(two_turns, tip="p8", locked={"j4": 0.0}).warnings  # nearly two turns


WRONG = {
    "base": ({"base": "p99"}, "unknown-name", ("base = 'p99'", " p0, ")),
    "tip": ({"tip": "P8"}, "unknown-name", ("'p8'",)),
    "turned round": ({"base": "p8", "tip": "p1"}, "unknown-link", ("base = 'p8'",)),
    "no tip": ({"tip": []}, "unknown-link", ("tip = []",)),
    "following": ({"tip": "c2", "locked": {"b2": 0.0}}, "mimic", ("'d2'", "'p0'", "'c2'", "'b2'")),
    "no joints": ({"base": "p1", "tip": "p2"}, "no-movable-joint", ("'p1'", "'p2'")),
    "unknown joint": ({"posture": {"j99": 0.0}}, "unknown-name", ("posture = 'j99'",)),
    "fixed": ({"posture": {"j2": 0.0}}, "joint-type-in-file", ("posture: ", "'j2'")),
    "follower": ({"posture": {"d2": 0.0}}, "mimic", ("posture: ", "'d2'", "'b2'")),
    "limits": ({"posture": {"j3": 3.1}}, "out-of-range", ("posture: ", "'j3' = 3.1 rad (177.617°)", "-3.0 rad (")),
    "limits of a slide": ({"locked": {"j4": 3.1}}, "out-of-range", ("locked: ", "'j4' = 3.1 m")),
    "given twice": ({"posture": {"j4": 0.1}, "locked": {"j4": 0.2}}, "both-given", ("'j4'", "posture", "locked")),
    "too high": (
        {"locked": {"j4": 0.0}, "flexible": {"p3": FlexibleLink(frequency_hz=1e200)}},
        "frequency-out-of-reach", ("'p3'", "frequency_hz = 1e+200", "inf Pa"),
    ),
    "too low": (
        {"locked": {"j4": 0.0}, "flexible": {"p3": FlexibleLink(frequency_hz=1e-200)}},
        "frequency-out-of-reach", ("'p3'", "frequency_hz = 1e-200", " 0 Pa"),
    ),
    "no number": ({"posture": {"j3": "x"}}, "out-of-range", ("posture: ", "'j3' = 'x'")),
    "NaN": ({"posture": {"j3": float("nan")}}, "out-of-range", ("posture: ", "'j3' = nan")),
    "not on the path": ({"locked": {"b2": 0.1, "j4": 0.0}}, "unknown-joint", ("locked: ", "'b2'", "'p0'", "'p8'")),
    "armature of nothing": ({"locked": {"j4": 0.0}, "armature": {"j4": 1.0}}, "unknown-joint", ("'j4'",)),
    "negative armature": ({"locked": {"j4": 0.0}, "armature": {"j5": -1.0}}, "out-of-range", ("'j5' = -1.0",)),
    "folded": ({"locked": {"j4": 0.0}, "flexible": {"p4": FlexibleLink(frequency_hz=1.0)}},
               "flexible-link-fixed", ("'p4'", "'p3'")),
    "elsewhere": ({"locked": {"j4": 0}, "flexible": {"x": FlexibleLink(frequency_hz=1.0)}}, "unknown-link", ("'x'",)),
    "no line": (
        {"locked": {"j4": 0}, "flexible": {"p3": FlexibleLink(frequency_hz=1.0, line=((0, 0, 0), (0, 0, 0)))}},
        "no-length", ("flexible: ", "'p3'", "line = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))"),
    ),
    "no dict": ({"flexible": ["p3"]}, "wrong-type", ("flexible = ['p3']", "dict", "list")),
    "no Flexible": ({"locked": {"j4": 0.0}, "flexible": {"p3": 12.0}}, "wrong-type", ("'p3' = 12.0", "FlexibleLink")),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_options_that_do_not_fit_the_robot_are_refused_by_name(name: str, tmp_path: Path) -> None:
    path = saved(tmp_path, RandomRobot(0).text())
    options, id, parts = WRONG[name]
    with refused(FlexlinkError, id) as caught:
        import_urdf(path, **{"tip": "p8", **options})
    assert all(part in str(caught.value) for part in parts)
    assert "\n" not in str(caught.value)


def test_a_flexible_link_needs_its_stiffness() -> None:
    with refused(fl.errors.SceneError, "missing-key"):
        FlexibleLink(mass=1.0)


def test_a_joint_whose_limits_exclude_zero_starts_in_the_middle_of_them(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    text = RandomRobot(0).text().replace('lower="-3"', 'lower="1"')
    path.write_text(text, encoding="utf-8")
    imported = import_urdf(path, tip="p8", locked={"j4": 1.0})
    assert imported.path.positions["j3"] == 2.0
    (note,) = (text for text in imported.notes if text.startswith("j3: "))
    assert " 2 rad" in note
    reviewed("import: initial angle", note)


def test_a_beam_is_a_solid_box_along_its_line() -> None:
    """Moments are m/12 times sums of squared sides: 2 m long, 0.3 m along local y, 0.1 m along local z."""
    section = fl.Section(shape="rectangle", height=0.3, width=0.1)
    found = _prism(section, 12.0, line_of(((0, 0, 0), (2, 0, 0)), (0, 1, 0), np.array([0, 0, 1.0])))
    up = _prism(section, 12.0, line_of(((0, 0, 0), (0, 0, 2)), (0, 1, 0), np.array([0, 0, 1.0])))
    y, z = line_of(((0, 0, 0), (2, 0, 0)), (0, 1, 0), np.array([0, 0, 1.0])).frame[:, 1:].T
    sides = np.abs(np.column_stack([[1.0, 0.0, 0.0], y, z])) @ [2.0, 0.3, 0.1]
    squares = sides**2
    assert np.diag(found.inertia) == pytest.approx(squares.sum() - squares)
    assert sorted(np.linalg.eigvalsh(up.inertia)) == pytest.approx(sorted(squares.sum() - squares))
    assert found.center == pytest.approx([1.0, 0.0, 0.0])


def test_a_beam_of_the_largest_mass_is_refused_since_nothing_remains(tmp_path: Path) -> None:
    """The largest beam in a rod of 1 kg is the rod itself, so that no mass remains for the bodies at its ends."""
    rod = body_with(1.0, np.array([0.5, 0.0, 0.0]), np.diag([1 / 12 + 1e-3, 2e-3, 2e-3]))
    part = SimpleNamespace(body=rod, link="rod", joint=SimpleNamespace(axis=np.array([0, 0, 1.0])))
    link = fl.Link(name="rod")
    section = fl.Section(shape="rectangle", height=0.01, width=0.01)
    largest = largest_mass(rod, _prism(section, 1.0, line_of(((0, 0, 0), (1, 0, 0)), None, part.joint.axis)))
    for mass, fits in ((0.999 * largest, True), (largest, False)):
        specified = FlexibleLink(section=section, mass=mass)
        with contextlib.nullcontext() if fits else refused(ArgumentError, "beam-heavier-than-link"):
            bent(cast("Any", part), link, specified, np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("lower", "upper", "stays"),
    [
        (-1.0, 3.0, 0.0), (0.0, 2.0, 0.0), (1.0, 3.0, 2.0), (-3.0, -1.0, -2.0),
        (3.0, 1.0, 0.0), (-1.0, -3.0, 0.0),  # reversed limits mean no limits
    ],
)  # fmt: skip
def test_an_unspecified_joint_angle_is_zero_or_the_middle_of_its_limits(lower, upper, stays) -> None:
    joint = SimpleNamespace(name="j", limits=(lower, upper), mimic=None)
    robot = SimpleNamespace(joints={"j": joint}, position=lambda joint, leaders: leaders[joint.name])
    assert positions_of(cast("Any", robot), {}) == {"j": stays}


@pytest.mark.parametrize("key", ["locked", "posture"])
def test_a_position_on_the_command_line_replaces_the_stored_one(key: str) -> None:
    given = {"locked": [], "posture": [], "flexible": [], "armature": []} | {key: ["b=90"]}
    options = SimpleNamespace(base=None, tip=None, free_base=False, **given)
    known = KnownArm(file="arm.urdf", **{key: {"a": 0.1, "b": 0.2}})
    arguments = import_robot._arguments(cast("Any", SimpleNamespace(joints={})), known, cast("Any", options))
    assert arguments[key] == {"a": 0.1, "b": np.pi / 2}


def test_a_joint_that_mimics_a_mimic_follows_the_leader_of_both() -> None:
    mimics = {"a": None, "b": Mimic("a", 3.0, 5.0), "c": Mimic("b", 2.0, 1.0)}
    joints = {name: SimpleNamespace(name=name, mimic=mimic) for name, mimic in mimics.items()}
    robot = cast("Any", SimpleNamespace(joints=joints))
    robot.rule = partial(Robot.rule, robot)
    assert Robot.position(robot, cast("Any", joints["c"]), {"a": 0.5}) == 2 * (3 * 0.5 + 5) + 1
    assert Robot.position(robot, cast("Any", joints["c"]), {"a": 0.5, "b": 0.4}) == 2 * 0.4 + 1  # b is locked
