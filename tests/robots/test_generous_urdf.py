"""URDF files of other programs: read wherever their numbers are defined, and every part that is left out is named."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import ArgumentError
from flexlink.robots.importing import ImportResult
from flexlink.robots.robot_file import read_robot
from tests.support.urdf_texts import RandomRobot, link, saved, words
from tests.support.words import line, refused, reviewed

ODDITIES = {
    "dynamics": "K D mu_coulomb mu_viscous spring_stiffness spring_reference rotor_inertia armature cfm_damping",
    "limit": "acceleration jerk drake:acceleration soft_lower", "mass": "uncertainty", "origin": "quat",
    "joint": "group command_effort current gear_velocity class", "link": "type gravcomp self_collide",
    "axis": "xyz_expressed_in", "inertial": "density", "robot": "scale units", "mimic": "backlash",
    "joint/": "drake:rotor_inertia drake:gear_ratio safety_controller calibration spring hardwareInterface screw_pitch",
    "link/": "visual collision self_collision_checking gravity turnGravityOff velocity_decay mu1 kp",
    "robot/": "gazebo transmission material drake:linear_spring_damper loop_joint mujoco ros2_control sensor:camera",
    "gazebo/": "springStiffness springReference implicitSpringDamper dampingFactor kd maxVel mu2 provideFeedback",
    "transmission/": "mechanicalReduction rotorInertia motorTorqueConstant actuator joint_coupling",
    "collision/": "drake:mu_dynamic friction ode geometry",
}  # fmt: skip
"""Attributes and, with a slash, elements of URDF, SDFormat, Drake, RaiSim, MuJoCo, Gazebo, by the element around."""


def sprinkled(seed: int, tmp_path: Path) -> tuple[Path, list[str]]:
    """A random robot with a few oddities, and their names."""
    random, text, names = np.random.default_rng(seed), RandomRobot(seed).text(), []
    for place, oddities in ODDITIES.items():
        for name in random.permutation(oddities.split())[:3].tolist():
            new = f"<{name}>{random.uniform(1, 9):.3g}</{name}>" if "/" in place else f' {name}="0.5"'
            ends = r"(?<!/)>" if "/" in place else r"(?=/?>)"
            starts = [found.end() for found in re.finditer(rf"<{place.rstrip('/')}\b[^>]*?{ends}", text)]
            if starts:
                at = int(random.choice(starts))
                text = text[:at] + new + text[at:]
                names.append(name)
    path = saved(tmp_path, text, f"sprinkled{seed}")
    return path, names


def told(found: ImportResult) -> str:
    return "\n".join([*found.notes, *found.warnings])


@pytest.mark.parametrize("seed", range(10))
def test_every_element_and_attribute_that_is_left_out_is_named_and_changes_nothing(seed: int, tmp_path: Path) -> None:
    """Parts of an element that is left out, as the geometry of a collision, go with it unless they act on motion."""
    path, names = sprinkled(seed, tmp_path)
    found = fl.import_urdf(path)
    mute = [name for name in names if not re.search(rf"[< ]{name}>", told(found))]
    assert set(mute) <= {"provideFeedback", "maxVel", "ode", "geometry", "actuator"}
    plain = saved(tmp_path, RandomRobot(seed).text(), "plain")
    assert found.scene == fl.import_urdf(plain).scene


@pytest.mark.parametrize("attribute", ["K", "rotor_inertia"])
def test_a_stiffness_and_a_rotor_are_offered_by_options_that_work(attribute: str, tmp_path: Path, capsys) -> None:
    path, out = tmp_path / "robot.urdf", tmp_path / "robot.toml"
    path.write_text(RandomRobot(1).text().replace('damping="0.5"', f'damping="0.5" {attribute}="70"'), encoding="utf-8")
    (warning,) = (one for one in fl.import_urdf(path).warnings if one.id == "left-out")
    reviewed(f"import: offered {attribute}", warning)
    left_out = [one for one in fl.import_urdf(path, armature={"j5": 0.1}).warnings if one.id == "left-out"]
    assert left_out == [warning] * (attribute == "K")
    options = shlex.split(re.search(r"--.*?(?=, times| \(|$)", warning)[0].replace("=I", "=0.5"))
    assert main(["import", str(path), "-o", str(out), *options]) == 0
    joint = next(link.joint for link in fl.load_scene(out).arm.links if link.name == "p5")
    assert {"K": joint.gear_stiffness, "rotor_inertia": joint.armature}[attribute] == 70


def test_a_stiffness_of_zero_is_not_offered(tmp_path: Path) -> None:
    path = saved(tmp_path, RandomRobot(1).text().replace('damping="0.5"', 'damping="0.5" K="0"'))
    assert {one.id for one in fl.import_urdf(path).warnings} <= {"mimic-fixed"}


def fingers(tmp_path: Path, names: str = "abc") -> Path:
    """A hand on a fixed palm: `a` slides, the slide `b` and the hinge `c` follow it, `d` turns on `b`."""
    random = np.random.default_rng(2)
    parts = [link(name, random) for name in ("palm", *names)]
    kinds = {"a": ("prismatic", ""), "b": ("prismatic", -0.5), "c": ("revolute", 3.0), "d": ("revolute", "")}
    for name in names:
        kind, ratio = kinds[name]
        rule = f'<mimic joint="to_a" multiplier="{ratio}" offset="0.1"/>' if ratio else ""
        place = f'<origin xyz="{words(random.normal(size=3))}" rpy="{words(random.normal(size=3))}"/>'
        parent, axis = "b" if name == "d" else "palm", words(random.normal(size=3))
        ends = f'<parent link="{parent}"/><child link="{name}"/><axis xyz="{axis}"/>'
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="0.2" friction="0.1"/>'
        parts.append(f'<joint name="to_{name}" type="{kind}">{place}{ends}{limit}{rule}</joint>')
    path = saved(tmp_path, f'<robot name="hand">{"".join(parts)}</robot>', "hand")
    return path


def coupled(path: Path) -> pin.Model:
    """Pinocchio's model of the hand, with one coordinate."""
    return pin.buildModelFromUrdf(str(path), mimic=True)


@pytest.mark.parametrize("slides", [False, True])
def test_a_follower_on_the_path_moves_by_a_tie_as_in_pinocchio(slides: bool, tmp_path: Path) -> None:
    """A palletizer's hand keeps its attitude; the truth has one coordinate less."""
    joints = [("upper", "base", "revolute", ""), ("fore", "upper", "prismatic" if slides else "revolute", "upper")]
    random = np.random.default_rng(3)
    parts, place = [link(name, random) for name in ("base", "upper", "fore", "hand")], "0.5 0.1 0"
    for name, parent, kind, leader in [*joints, ("hand", "fore", "revolute", "")]:
        rule = f'<mimic joint="to_{leader}" multiplier="-0.7" offset="0.3"/>' if leader else ""
        ends = f'<parent link="{parent}"/><child link="{name}"/><axis xyz="0 1 0.2"/><origin xyz="{place}"/>'
        limit = '<limit lower="-2" upper="3" effort="1" velocity="1"/>'
        parts.append(f'<joint name="to_{name}" type="{kind}">{ends}{limit}{rule}</joint>')
    path = saved(tmp_path, f'<robot name="arm">{"".join(parts)}</robot>', "arm")
    found = fl.import_urdf(path, tip="hand", posture={"to_upper": 0.4})
    reviewed("import: mimic-tied", line(str(found), "to_fore: moves by"))
    assert found.path.parts[1].joint.limits == pytest.approx((-2.3, 2.7))  # from its offset
    plain = saved(tmp_path, path.read_text(encoding="utf-8").replace('multiplier="-0.7"', ""), "plain")
    assert fl.import_urdf(plain, tip="hand").path.followers["to_fore"].multiplier == 1
    still = saved(tmp_path, path.read_text(encoding="utf-8").replace('"-0.7"', '"0"'), "still")
    with pytest.raises(ArgumentError, match=r"to_fore=0\.0"):
        fl.import_urdf(still, tip="hand")
    run = fl.simulate(found.scene, duration=0.5, sample=0.1, tolerance=1e-8)
    np.testing.assert_allclose(run.q[:, 1], -0.7 * run.q[:, 0], rtol=0, atol=1e-12)
    model = coupled(path)
    data = model.createData()

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        M = pin.crba(model, model.createData(), y[:2])  # which adds to the matrix of old data
        M = np.triu(M) + np.triu(M, 1).T
        return np.concatenate([y[2:], np.linalg.solve(M, -pin.nonLinearEffects(model, data, y[:2], y[2:]))])

    truth = solve_ivp(rates, (0.0, 0.5), [0.4, 0.0, 0.0, 0.0], t_eval=run.t, rtol=1e-11, atol=1e-12).y
    np.testing.assert_allclose(run.q[:, [0, 2]].T, truth[:2], rtol=0, atol=1e-6)
    pin.framesForwardKinematics(model, data, truth[:2, -1])
    np.testing.assert_allclose(run.tip[-1], data.oMf[model.getFrameId("hand")].translation, atol=1e-6)


def test_positions_and_limits_of_a_follower_count_from_its_offset(tmp_path: Path) -> None:
    """The file's limits are ±1 and its offset 0.1; its frame at 0 is that at the offset."""
    path = fingers(tmp_path)
    found = fl.import_urdf(path, tip=["a", "b", "c"], posture={"to_a": 0.2}).path
    own, *others = found.parts
    assert own.joint.limits == (-1.0, 1.0)
    assert [found.positions[name] for name in ("to_a", "to_b", "to_c")] == pytest.approx([0.2, -0.1, 0.6])
    for part in others:
        place = read_robot(path).joints[part.joint.name].pose(0.1)
        assert part.joint.limits == pytest.approx((-1.1, 0.9))
        np.testing.assert_allclose(np.column_stack(part.origin), np.column_stack(place), atol=1e-15)


def test_followers_on_a_fixed_base_move_with_their_leader(tmp_path: Path) -> None:
    """Viscous and dry friction: 0.2 (1 + 0.5² + 3²) and 0.1 (1 + 0.5 + 3)."""
    path = fingers(tmp_path)
    found, model = fl.import_urdf(path, gravity=(0.0, 0.0, 0.0)), coupled(path)
    M = pin.crba(model, model.createData(), np.zeros(1))
    assert fl.mass_matrix(fl.lump(found.scene), [0.3]) == pytest.approx(M, rel=1e-12)
    joint = found.scene.arm.links[0].joint
    assert (joint.viscous, joint.coulomb) == (pytest.approx(0.2 * 10.25), pytest.approx(0.45))
    assert not found.warnings
    reviewed("import: carried", line(str(found), "to_b: mimics to_a"))


@pytest.mark.parametrize("name", ["b", "c"])
def test_the_largest_weight_of_a_follower_is_stated(name: str, tmp_path: Path) -> None:
    """The truth is what Pinocchio's gravity torque has more than ours, over a turn of the hinge."""
    path = fingers(tmp_path, f"a{name}")
    found, model = fl.import_urdf(path), coupled(path)
    chain, data = fl.lump(found.scene), model.createData()
    lost = [
        pin.computeGeneralizedGravity(model, data, q) - fl.bias_torque(chain, q, [0.0])
        for q in np.linspace(-1.1, 1.1, 5001)[:, None]
    ]
    (warning,) = found.warnings
    stated = float(re.search(r"up to (\S+) N", warning)[1])
    assert stated == pytest.approx(np.abs(lost).max(), rel=1e-3)
    reviewed("mimic-weight", warning)


@pytest.mark.parametrize(
    ("names", "options", "still"),
    [("abc", {"free_base": True}, {"to_b", "to_c"}), ("abc", {"locked": {"to_b": 0.0}}, set()), ("abcd", {}, {"to_b"})],
)
def test_followers_that_cannot_move_with_their_leader_are_named(tmp_path: Path, names, options, still) -> None:
    warnings = fl.import_urdf(fingers(tmp_path, names), **options).warnings
    assert {warning.partition(":")[0] for warning in warnings if warning.id == "mimic-fixed"} == still


def edit(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new)


ACCEPTED = {
    "no name": edit('name="random"', 'name=""'),
    "blank lines before the declaration": lambda text: f'\n\n<?xml version="1.0"?>{text}',
    "a prefix without namespace": edit("</robot>", '<gazebo><sensor:camera name="x"/></gazebo></robot>'),
    "a comment like xacro": edit("<robot", "<!-- ${x} xacro:include --><robot"),
    "reversed limits": edit('lower="-3" upper="3"', 'lower="1" upper="-1"'),
    "no limits": edit('<limit lower="-3" upper="3" effort="1" velocity="1"/>', ""),
}


@pytest.mark.parametrize("name", ACCEPTED)
def test_files_that_other_programs_read_are_read_as_well(name: str, tmp_path: Path) -> None:
    random, path = RandomRobot(3), tmp_path / "robot.urdf"
    path.write_text(ACCEPTED[name](random.text()), encoding="utf-8")
    found = fl.import_urdf(path)
    plain = saved(tmp_path, random.text(), "plain")
    chain, other, q = fl.lump(found.scene), fl.lump(fl.import_urdf(plain).scene), np.linspace(-1, 1, 15)
    assert (fl.mass_matrix(chain, q) == fl.mass_matrix(other, q)).all()
    if "limits" in name:
        assert not np.isfinite(chain.hinges["lower"]).any()
        reviewed("limits-equal", line(str(found), "j1: "))


def test_a_link_without_inertial_cannot_bend_and_the_message_states_why(tmp_path: Path) -> None:
    path = fingers(tmp_path, "a")
    path.write_text(re.sub(r'(name="a">)<inertial>.*?</inertial>', r"\1", path.read_text("utf-8")), encoding="utf-8")
    with refused(ArgumentError, "no-mass"):
        fl.import_urdf(path, armature={"to_a": 1.0}, flexible={"a": fl.FlexibleLink(frequency_hz=5.0)})


def test_the_log_of_an_export_names_what_a_urdf_cannot_hold(tmp_path: Path, caplog) -> None:
    caplog.set_level("INFO")
    found = fl.import_urdf(fingers(tmp_path, "a"), armature={"to_a": 1.0}, gravity=(0.0, 0.0, 0.0))
    fl.to_urdf(fl.lump(found.scene))
    (record,) = caplog.records
    reviewed("log: to_urdf", record.getMessage())
