"""compare(scene, file=…): what is wrong in a file of somebody else's is named, and nothing in one that is right."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import planted
import planted_abroad
import pytest
from conftest import MODELS, ROOT
from handwritten import CRANE, HANDS, SERVED
from planted import PLANTED, Planted
from planted_abroad import ABROAD, Abroad
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.cli.main import main
from flexlink.diagnosis import joint_axes
from flexlink.diagnosis.diagnosis import Diagnosis, diagnose_file
from flexlink.diagnosis.foreign_files import READERS, load_file
from flexlink.diagnosis.stable_steps import LARGEST
from flexlink.diagnosis.states import mixed_states
from flexlink.engines.read_back import of_chain, to_chain
from flexlink.formats import FORMATS
from flexlink.robots.collection import known_arm
from tests.words import refused

SCENES = sorted([*MODELS, *(ROOT / "validation" / "scenes").glob("*.toml")])
SPATIAL = fl.load_scene(ROOT / "models" / "t3_spatial.toml")
drake = pytest.mark.skipif(find_spec("pydrake") is None, reason="needs Drake: the extra 'witness'")
MADE = [pytest.param(form, marks=drake if form == "sdf" else ()) for form in READERS]


def bent_at_rest(scene: fl.Scene) -> fl.Chain:
    """Springs slack at 0.1 rad, so that a rest angle can be lost."""
    chain = fl.lump(scene)
    hinges = chain.hinges.copy()
    hinges["rest"][hinges["stiffness"] > 0] = 0.1
    return dataclasses.replace(chain, hinges=hinges)


CHAIN = bent_at_rest(SPATIAL)


def written(folder: Path, form: str, edit: planted.Edit | None = None, chain: fl.Chain = CHAIN) -> Path:
    """Our own file of a chain, edited."""
    root = ET.fromstring(FORMATS[form].write(chain))
    if edit is not None:
        edit(root)
    path = folder / f"theirs{FORMATS[form].ending}"
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


def diagnosed(
    path: Path,
    chain: fl.Chain = CHAIN,
    engine: str | None = None,
    scene: fl.Scene | None = None,
    base: np.ndarray | None = None,
) -> Diagnosis:
    states = [state._replace(wrench=np.zeros(6)) for state in mixed_states(chain, 8)]
    return diagnose_file(chain, load_file(path, chain.n, engine, base=base, here=True), states, scene=scene)


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=drake if case.form == "sdf" else ()) for case in PLANTED],
    ids=lambda case: f"{case.form}, {case.mistake}",
)
def test_a_planted_mistake_is_the_only_one_named_and_explains_all_that_differs(case: Planted, tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, case.form, case.edit))
    (finding,) = found.findings
    assert case.named in str(finding)
    differing = {row.quantity for row in found.rows if not row.passed}
    assert found.explained is (True if differing else None)
    if finding.faulty is not None:
        assert differing <= set(finding.affects)


@pytest.mark.parametrize("form", MADE)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_in_our_own_file_nothing_is_named(path: Path, form: str, tmp_path: Path) -> None:
    scene = fl.load_scene(path).varied({"motion": ()})
    chain = fl.lump(scene)
    if form == "mjcf" and path.stem == "stepped_beam":  # a table: no inertia about the beam's axis
        with refused(fl.errors.ArgumentError, "inertia-impossible"):
            written(tmp_path, form, chain=chain)
        return
    found = diagnosed(written(tmp_path, form, chain=chain), chain, scene=scene)
    assert found.passed and not found.findings and not found.left_out, str(found)
    law = {"pd": ["servo stiffness, servo damping"]}.get(scene.drive.kind, [])
    law += ["torque limit"] * (scene.drive.effort is not None)
    told = [f"not in the file, taken from the scene: {', '.join(law)}"] if law else []
    if form == "urdf" and not any(not name.startswith("base.") for name in chain.joint_names):  # no joint says them
        told.append(
            "not in the file, taken from the scene: spring stiffness, rest angle, width of the Coulomb torque, armature"
        )
    if form != "mjcf" and len(chain.couplings):  # whose tendons hold them
        told.append("springs and dampers between two joints are computed by us, with the numbers of the file")
    assert list(found.notes) == told


@pytest.fixture(scope="module")
def cranes(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, fl.Scene]:
    """The crane that others have written, with torques, and with servos."""
    path = tmp_path_factory.mktemp("crane") / "crane.toml"
    path.write_text(CRANE, encoding="utf-8")
    scene = fl.load_scene(path)
    return {False: scene, True: scene.varied(SERVED)}


def by_hand(
    name: str,
    cranes: dict[bool, fl.Scene],
    folder: Path,
    edit: planted.Edit | None = None,
    beside: fl.Scene | None = None,
) -> Diagnosis:
    """Of the crane in somebody's own words, edited, beside its scene or another one."""
    hand = HANDS[name]
    scene = cranes[hand.habit.servos]
    chain = fl.lump(scene)
    root = ET.fromstring(ET.tostring(hand.write(chain, hand.habit, scene)))  # with namespaces as a reader has them
    if edit is not None:
        edit(root)
    path = folder / "by_hand.xml"
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return diagnosed(path, chain, scene=beside or scene)


def needs_drake(name: str) -> tuple[pytest.MarkDecorator, ...]:
    return (drake,) if HANDS[name].form == "sdf" else ()


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs_drake(name)) for name in HANDS])
def test_a_right_file_in_somebody_s_own_words_raises_no_alarm(name: str, cranes, tmp_path: Path) -> None:
    found = by_hand(name, cranes, tmp_path)
    assert found.passed and not found.left_out and str(found).splitlines()[0].endswith(": all 6 quantities agree")
    assert {finding.remedy.partition(" ")[0] for finding in found.findings} <= {"set"}  # integrator, autoreset
    assert not any(finding.counts or finding.faulty is not None for finding in found.findings)


@pytest.mark.parametrize(
    ("case", "name"),
    [
        pytest.param(case, name, marks=needs_drake(name), id=f"{name}, {case.mistake}")
        for case in ABROAD
        for name in case.hands
    ],
)
def test_a_mistake_in_somebody_s_own_words_is_named_first(case: Abroad, name: str, cranes, tmp_path: Path) -> None:
    found = by_hand(name, cranes, tmp_path, case.edit)
    assert case.named in str(found.findings[0]), str(found)
    assert not found.passed and found.explained is not False
    assert "differ" in str(found).splitlines()[0] and "not explain" not in str(found)
    assert "not analysed" not in str(found) or case.named == planted_abroad.ELSEWHERE


def along_axes(root: ET.Element) -> None:
    for joint in root.iter("joint"):
        joint.set("pos", planted.numbers(planted.vector(joint, "pos") + 0.3 * planted.vector(joint, "axis")))


def endless(root: ET.Element) -> None:
    for joint in root.findall("joint[@type='revolute']"):
        joint.set("type", "continuous")
        joint.remove(joint.find("limit"))


def two_bodies(root: ET.Element) -> None:
    """Half of the last hinge's body as a body of its own, welded to it."""
    body = list(root.iter("body"))[-2]
    inertial = body.find("inertial")
    for name in ("mass", "diaginertia"):
        inertial.set(name, planted.numbers(planted.vector(inertial, name) / 2))
    ET.SubElement(body, "body", name="half").append(ET.fromstring(ET.tostring(inertial)))


@pytest.mark.parametrize(("form", "edit"), [
    ("mjcf", along_axes), ("mjcf", two_bodies), ("urdf", endless), ("mjcf", planted.unnamed),
], ids=lambda value: getattr(value, "__name__", value))  # fmt: skip
def test_the_same_arm_in_other_words_is_right(form: str, edit: planted.Edit, tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, form, edit))
    assert found.passed and not found.findings, str(found)


def test_joints_of_other_names_are_matched_by_their_order_and_it_is_told(tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, "mjcf", planted.unnamed))
    assert found.notes == ("joint names differ; joints are matched by their order",)


def plain_urdf(root: ET.Element) -> None:
    for parent in (root, *root.findall("joint")):
        for own in parent.findall("flexlink"):
            parent.remove(own)


def test_what_a_plain_urdf_cannot_say_is_taken_from_the_scene_and_told(tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, "urdf", plain_urdf))
    assert found.passed and not found.findings
    (note,) = found.notes
    assert note.startswith("not in the file, taken from the scene: gravity, spring stiffness, rest angle, ")


def test_mujoco_reads_urdf_too(tmp_path: Path) -> None:
    chain = fl.lump(fl.load_scene(ROOT / "validation" / "scenes" / "double_pendulum_rods.toml"))
    wrong = planted.scaled(".//mass", "value", 1.1, only=1)
    right, other = (diagnosed(written(tmp_path, "urdf", edit, chain), chain, "mujoco") for edit in (None, wrong))
    assert right.passed and not right.findings, str(right)
    assert "mass of joint" in str(other.findings[0]) and other.explained


def test_a_file_that_mujoco_has_written_has_lost_digits(tmp_path: Path) -> None:
    path = tmp_path / "saved.xml"
    mujoco.mj_saveLastXML(str(path), mujoco.MjModel.from_xml_string(fl.to_mjcf(CHAIN)))
    found = diagnosed(path)
    (finding,) = found.findings
    assert (
        re.search(r"correct to only about [56] digits: digits were lost in writing", str(finding)) and found.explained
    )


@pytest.mark.parametrize("name", ["ur5", "xarm7"])
def test_a_robot_s_own_urdf_agrees_with_its_scene_whatever_it_calls_its_joints(name: str) -> None:
    try:
        path = known_arm(name).path
    except fl.errors.MissingDependencyError as error:
        pytest.skip(str(error))
    chain = fl.lump(fl.load_scene(ROOT / "models" / "robots" / f"{name}.toml"))
    found = diagnosed(path, chain)
    assert found.passed and not found.findings, str(found)


def without_drive(cranes: dict[bool, fl.Scene]) -> fl.Scene:
    return cranes[False].varied({"drive.kind": "none", "drive.torque": None})


def test_eleven_mistakes_at_once_are_named_one_by_one(cranes, tmp_path: Path) -> None:
    hinge, body, option = planted_abroad.HINGE, planted.BODY, planted.OPTION
    edits = {
        "joint 'jib' rotates about (": planted_abroad.axis_exchanged(hinge, 4, "axis"),
        "joint 'jib.2.z' is 1000 times as far": planted.scaled(body, "pos", 1e3, only=5),
        "joint 'boom' displaced by 0.07 m, with all links behind it": planted.frame_moved(body, "pos", 1, (0, 0.07, 0)),
        "a part is missing (payload": planted_abroad.one(planted.INERTIAL, -1, mass="2"),
        "inertia of joint 'slew': ": planted.scaled(planted.INERTIAL, "fullinertia", 4, only=0),
        "doubled or halved": planted.scaled(hinge, "stiffness", 2),
        "remove springref from joint 'boom.2.z'": planted_abroad.one(hinge, 3, springref="0.1"),
        "add damping to these joints": planted.each("default/default/joint", damping=None),
        "armature of 3 joints": planted.each(hinge, armature=None),
        "gravcomp cancels gravity on 1 body; remove it": planted_abroad.one(body, 2, gravcomp="1"),
        "0.002 s > ": planted.each(option, timestep="0.002"),
    }  # fmt: skip
    found = by_hand("degrees", cranes, tmp_path, planted.both(*edits.values()))
    counting = [str(finding) for finding in found.findings if finding.counts]
    for named in edits:
        assert [named in told for told in counting].count(True) == 1, named
    assert len(counting) == len(edits) and found.explained, str(found)


def test_beside_a_scene_without_a_drive_actuators_are_told_and_not_compared(cranes, tmp_path: Path) -> None:
    geared = planted.each(planted_abroad.MOTOR, gear="50", forcerange="-1 1")
    found = by_hand("degrees", cranes, tmp_path, geared, without_drive(cranes))
    first, *_, last = str(found).splitlines()
    assert found.passed and first == "mujoco: all 6 quantities agree; not compared: actuators"
    motors = "motors at 'slew' (gear 50), 'boom' (gear 50), 'jib' (gear 50)"
    limits = "torque limits at 'slew' (±50 N m), 'boom' (±50 N m), 'jib' (±50 N m)"
    assert last.strip() == f"not compared, because the scene has no drive: {motors}; {limits}"
    plain = by_hand("welded", cranes, tmp_path, beside=without_drive(cranes))
    assert plain.passed and not plain.left_out


def test_servos_push_a_scene_without_a_drive(cranes, tmp_path: Path) -> None:
    found = by_hand("servos", cranes, tmp_path, beside=without_drive(cranes))
    assert not found.passed and "actuators act without a command" in str(found.findings[0])


def through_a_tendon(root: ET.Element) -> None:
    motor = root.findall(planted_abroad.MOTOR)[-1]
    rope = ET.SubElement(ET.SubElement(root, "tendon"), "fixed", name="rope")
    ET.SubElement(rope, "joint", joint=motor.attrib["joint"], coef="1")
    motor.attrib = {"name": "winch", "tendon": "rope"}


def test_an_actuator_that_cannot_be_compared_is_named_as_such(cranes, tmp_path: Path) -> None:
    found = by_hand("degrees", cranes, tmp_path, through_a_tendon)
    assert "the scene's drive has no motor here; add a motor at joint 'jib'" in str(found)
    assert "are not compared: 'winch' (trntype tendon)" in str(found)
    assert found.left_out == ("actuators",)


def test_limits_beyond_what_the_drive_asks_for_change_nothing_and_below_they_do(cranes, tmp_path: Path) -> None:
    for limit, told in ((150.0, False), (149.0, True)):  # N m; the boom's drive asks for 150
        edit = planted.each(planted_abroad.MOTOR, forcerange=f"{-limit} {limit}", forcelimited="true")
        found = by_hand("degrees", cranes, tmp_path, edit)
        assert found.passed is not told
        assert ("torque limit of joint 'boom': ±149 N m instead of none" in str(found)) is told


def test_a_table_asks_for_its_largest_torques(cranes, tmp_path: Path) -> None:
    torques = ((20.0, -150.0, -60.0), (-30.0, 10.0, 5.0))
    scene = cranes[False].varied(
        {"drive.kind": "table", "drive.torque": None, "drive.times": (0.0, 1.0), "drive.torques": torques}
    )
    for limits, told in (("-150 30", False), ("-149 30", True), ("-150 29", False), ("-150 19", True)):
        edit = planted.each(planted_abroad.MOTOR, forcerange=limits, forcelimited="true")
        assert by_hand("degrees", cranes, tmp_path, edit, scene).passed is not told


def test_limits_of_the_scene_are_those_of_the_file_or_taken_from_it(cranes, tmp_path: Path) -> None:
    limited = {False: cranes[False].varied({"drive.effort": (10.0, 100.0, 30.0)}), True: cranes[True]}
    found = by_hand("degrees", limited, tmp_path)
    assert "torque limit of 3 joints ('slew', 'boom', 'jib'): ±500 N m instead of ±10 N m: another limit" in str(found)
    found = by_hand("welded", limited, tmp_path)
    assert found.passed and "not in the file, taken from the scene: width of the Coulomb torque, torque limit" in str(
        found
    )


def test_actuators_that_are_switched_off_are_none(cranes, tmp_path: Path) -> None:
    motors = planted_abroad.MOTOR
    for off in (
        planted.each("option/flag", actuation="disable"),
        planted.both(planted.each(motors, group="2"), planted.each("option", actuatorgroupdisable="2")),
    ):
        found = by_hand("degrees", cranes, tmp_path, planted.both(off, planted.each(motors, gear="50")))
        assert found.passed and "taken from the scene: width of the Coulomb torque, motor gear" in str(found)


def test_rotor_and_damper_of_an_actuator_are_its_joint_s(cranes, tmp_path: Path) -> None:
    if not hasattr(mujoco.MjModel.from_xml_string("<mujoco/>"), "actuator_armature"):
        pytest.skip("this MuJoCo has no armature of actuators")

    def from_joint_to_motor(root: ET.Element) -> None:
        joint, motor = root.find(planted_abroad.HINGE), root.find(planted_abroad.MOTOR)
        for name in ("armature", "damping"):
            motor.set(name, joint.attrib[name])
            joint.set(name, "0")

    assert by_hand("degrees", cranes, tmp_path, from_joint_to_motor).passed
    geared = planted.both(from_joint_to_motor, lambda root: root.find(planted_abroad.MOTOR).set("gear", "2"))
    found = by_hand("degrees", cranes, tmp_path, geared)
    assert found.explained and "armature of joint 'slew': 1.2 instead of 0.3 kg m², factor 4" in str(found)


def grows(xml: str, integrator: str, step: float) -> bool:
    """Whether a small motion about the bent arm grows without bound in MuJoCo."""
    root = ET.fromstring(xml)
    name, _, explicit = integrator.partition(" without ")
    planted.each("option", integrator=name if name == "Euler" else name.lower(), timestep=repr(step))(root)
    planted.each("option/flag", eulerdamp="disable" if explicit else "enable")(root)
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    model.qpos_spring[:] = data.qpos[:] = np.linspace(0.1, 0.4, model.nv)
    data.qvel[:] = 1e-9
    for _ in range(2000):
        mujoco.mj_step(model, data)
        if np.abs(data.qvel).max() > 1e-3:
            return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [name for name in LARGEST if name != "RK4"])
def test_steps_of_mujoco_s_integrators_are_judged_as_its_runs_are(integrator: str, cranes) -> None:
    chain = fl.lump(cranes[False].varied({"gravity": (0.0, 0.0, 0.0)}))
    xml, largest = fl.to_mjcf(chain, shapes=False), LARGEST[integrator](chain)
    assert not grows(xml, integrator, 0.98 * largest) and grows(xml, integrator, 1.02 * largest)


def test_an_integrator_that_is_not_judged_says_nothing_of_its_step(cranes, tmp_path: Path) -> None:
    found = by_hand("degrees", cranes, tmp_path, planted.each("option", integrator="discrete", timestep="1"))
    assert found.passed and not any("stable" in str(finding) for finding in found.findings)


def test_two_mistakes_are_both_named_each_with_what_it_changes(tmp_path: Path) -> None:
    edit = planted.both(
        planted.each("option", gravity="0 0 -9.81"), planted.each(".//joint", armature=None), planted.flag("autoreset")
    )
    found = diagnosed(written(tmp_path, "mjcf", edit))
    gravity, armature, autoreset = found.findings
    assert (gravity.affects, armature.affects, autoreset.affects) == (("T_G", "T_GC", "q̈"), ("M", "q̈"), ())
    assert found.explained


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_rotor_left_out_is_named_though_nothing_else_gives_its_joint_inertia(form: str, tmp_path: Path) -> None:
    link = fl.Link(name="first", length=1.0, joint=fl.Joint(armature=0.1, gear_stiffness=100.0))
    chain = fl.lump(fl.Scene(name="geared", arm=fl.Arm(links=(link,), tip=fl.RigidBody(mass=1.0, inertia=(0.1,) * 3)),
                             initial=fl.InitialState(joint_deg=(0.0,))))  # fmt: skip
    edit = planted.each(".//joint" if form == "mjcf" else "joint/flexlink", armature="0")
    found = diagnosed(written(tmp_path, form, edit, chain), chain)
    (finding,) = found.findings
    assert not found.passed and "armature of joint 'first': 0 instead of 0.1 kg m²: missing" in str(finding)
    assert "q̈ (M is singular)" in finding.affects


def test_a_flat_arm_is_put_back_by_a_rotation_not_by_a_mirror(rng: np.random.Generator) -> None:
    ours = of_chain(fl.lump(fl.load_scene(ROOT / "models" / "paper_fig5.toml")))
    for k in range(ours.n - 1):
        turn = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3))
        point = ours.points[k]
        theirs = joint_axes._moved_rigidly(ours, k, turn.as_matrix(), point, point + rng.uniform(-1, 1, 3))
        realigned, displacements, _ = joint_axes.undo_displacements(ours, theirs, 1e-11)
        assert displacements[0].angle == pytest.approx(turn.magnitude(), abs=1e-9)
        assert np.abs(realigned.inertias - ours.inertias).max() <= 1e-12 * np.abs(ours.inertias).max()


@pytest.mark.parametrize("chain", [CHAIN, fl.lump(SPATIAL)], ids=["bent", "straight"])
def test_a_record_as_a_chain_has_the_same_record(chain: fl.Chain) -> None:
    read = of_chain(chain)
    again = of_chain(to_chain(read, CHAIN))
    for field in ("axes", "points", "masses", "centers", "inertias", "stiffness", "rest", "gravity", "tip"):
        mine, theirs = getattr(read, field), getattr(again, field)
        size = 1.0 if field == "axes" else np.abs(mine).max()
        assert np.abs(mine - theirs).max() <= 10 * np.sqrt(CHAIN.n) * np.finfo(float).eps * size, field


@pytest.mark.slow
def test_exit_codes_and_words_of_the_command_line(tmp_path: Path, capsys) -> None:
    scene, chain = str(ROOT / "models" / "paper_fig5.toml"), fl.lump(fl.load_scene(ROOT / "models" / "paper_fig5.toml"))

    def compared(edit: planted.Edit | None) -> tuple[int, str]:
        file = written(tmp_path, "mjcf", edit, chain)
        return main(["compare", scene, "--file", str(file), "--samples", "8"]), capsys.readouterr().out

    code, told = compared(None)
    assert code == 0 and told.endswith("mujoco: all 6 quantities agree\n")
    code, told = compared(planted.flag("autoreset"))
    assert code == 0 and "  1. autoreset: a simulation that diverges restarts silently" in told
    code, told = compared(planted.scaled(".//joint", "stiffness", np.pi / 180))
    assert code == 1
    assert "factor 0.0174533: degrees taken for radians; affects T_FL, q̈; give stiffness of" in told
    code, told = compared(planted.first_joint_gone)
    assert code == 1 and "9 joints instead of 10, without 'upper'" in told


def loop(root: ET.Element) -> None:
    joints = root.findall("joint")
    joints[-1].find("child").set("link", joints[0].find("parent").get("link"))


HOSTILE: dict[str, tuple[str, Callable[[str], str], str]] = {
    "empty": ("mjcf", lambda _: "", "not XML"),
    "cut off": ("urdf", lambda text: text[:2000], "not XML"),
    "another language": ("urdf", lambda _: "<html/>", "root is <html>"),
    "entities": ("urdf", lambda text: '<!DOCTYPE r [<!ENTITY a "b">]>' + text, "DOCTYPE"),
    "xacro": ("urdf", lambda _: '<robot xmlns:xacro="x"><xacro:include filename="y"/></robot>', "cannot load"),
    "nothing moves": ("mjcf", lambda _: "<mujoco/>", "no movable joint"),
    "a ball": ("mjcf", lambda text: text.replace('"hinge"', '"ball"', 1), "of type ball"),
    "a planar joint": ("urdf", lambda text: text.replace('"revolute"', '"planar"', 1), "revolute and prismatic ones"),
    "a missing mesh": (
        "mjcf", lambda text: text.replace("<worldbody>", '<asset><mesh file="no.stl"/></asset><worldbody>'), "no.stl"),
    "an unknown attribute": ("mjcf", lambda text: text.replace('mass="', 'mas="', 1), "mas"),
    "no number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="nan"', text), "stiffness of joint"),
    "words for a number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="soft"', text), "soft"),
    "two numbers of three": ("urdf", lambda text: re.sub('gravity="[^"]*"', 'gravity="0 9.81"', text), "gravity"),
    "a limit that is none": (
        "mjcf", lambda text: text.replace("<motor ", '<motor forcelimited="true" forcerange="-1 nan" '), "limit of"),
    "a reduction in words": ("urdf", lambda text: text.replace("Reduction>1<", "Reduction>fifty<"), "'fifty' is not"),
    "axes of length 0": ("urdf", lambda text: re.sub('axis xyz="[^"]*"', 'axis xyz="0 0 0"', text), "axis of joint"),
    "a name given twice": ("urdf", lambda text: text.replace('"upper.1.x"', '"upper"'), "cannot load"),
    "no SDF": ("sdf", lambda text: text.replace("<child>", "<kid>").replace("</child>", "</kid>"), "cannot load"),
    "far too long": ("urdf", lambda text: text.replace("</robot>", "<joint/>" * 300 + "</robot>"), "at most 300"),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=drake if form == "sdf" else ()) for name, (form, _, _) in HOSTILE.items()]
)
def test_a_broken_file_is_refused_in_one_line_with_its_name(name: str, tmp_path: Path) -> None:
    form, spoil, told = HOSTILE[name]
    path = written(tmp_path, form)
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(fl.errors.DataFileError) as caught:
        load_file(path, CHAIN.n, here=True)
    assert str(caught.value).startswith(f"{path}: ") and told in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a name given twice", "a missing mesh", "entities"])
def test_the_command_line_tells_it_in_one_line_and_what_the_engine_says(name: str, tmp_path: Path, capfd) -> None:
    form, spoil, told = HOSTILE[name]
    path = written(tmp_path, form)
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    assert main(["compare", str(MODELS[0]), "--file", str(path)]) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.count("\n") == 1 and told in err
    if form == "urdf" and "load" in told:
        assert err.endswith("joint 'upper' is not unique.\n")


@pytest.mark.slow
def test_what_an_engine_complains_of_and_then_reads_as_nothing_is_told(tmp_path: Path, capfd) -> None:
    path = written(tmp_path, "urdf", planted.each("link[3]/inertial/mass", value="1,5"), fl.lump(SPATIAL))
    comparison = fl.compare(SPATIAL, file=path, samples=8)
    assert "the mass is missing, or not a number for the engine" in comparison.diagnosis
    assert "pinocchio reports an error: Inertial: mass [1,5] is not a float" in comparison.diagnosis
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("form", MADE)
def test_a_process_of_its_own_says_the_same(form: str, tmp_path: Path) -> None:
    comparison = fl.compare(SPATIAL, file=written(tmp_path, form, chain=fl.lump(SPATIAL)), samples=8)
    assert comparison.passed and comparison.diagnosis.endswith("all 6 quantities agree")


def test_a_file_that_is_not_there_is_named_and_two_engines_are_refused(tmp_path: Path) -> None:
    with refused(fl.errors.DataFileError, "cannot-read"):
        fl.compare(SPATIAL, file=tmp_path / "gone.xml")
    file = written(tmp_path, "mjcf")
    with refused(fl.errors.ArgumentError, "one-engine-per-file"):
        fl.compare(SPATIAL, file=file, engines=("mujoco", "pinocchio"))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.compare(SPATIAL, file=file, engines=("pinocchio",))


def test_a_relative_path_is_of_the_folder_of_now(tmp_path: Path, monkeypatch) -> None:
    """A child process waits for the next file, and stays in the folder where it was started."""
    light = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    for scene in (light, light.varied({"tip.mass": 1.0})):
        chain = fl.lump(scene)
        folder = tmp_path / f"{scene.arm.tip.mass:g}"
        folder.mkdir()
        monkeypatch.chdir(folder)
        Path("arm.xml").write_text(fl.to_mjcf(chain), encoding="utf-8")
        _, engine, _ = load_file(Path("arm.xml"), chain.n)
        read = engine.read_back()
        assert read.masses.sum() == pytest.approx(chain.bodies["mass"].sum(), rel=1e-12)
