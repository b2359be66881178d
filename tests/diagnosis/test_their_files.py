"""compare(scene, file=…) names the mistakes in files from other programs, and none in correct files."""

import dataclasses
import re
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.cli.main import main
from flexlink.diagnosis import joint_axes
from flexlink.diagnosis.comparison import READERS, load_file
from flexlink.diagnosis.diagnosis import LARGEST, Diagnosis, diagnose_file
from flexlink.diagnosis.mistakes import table
from flexlink.diagnosis.quantities import mixed_states
from flexlink.engines.read_back import of_chain
from flexlink.formats import FORMATS
from flexlink.robots.collection import known_arm
from tests.conftest import MODELS, ROOT
from tests.support import planted, planted_abroad
from tests.support.handwritten import CRANE, HANDS, SERVED
from tests.support.planted import PLANTED, Planted
from tests.support.planted_abroad import ABROAD, Abroad
from tests.support.words import line, refused, reviewed

SCENES = sorted([*MODELS, *(ROOT / "validation" / "scenes").glob("*.toml")])
SPATIAL = fl.load_scene(ROOT / "models" / "t3_spatial.toml")
drake = pytest.mark.skipif(find_spec("pydrake") is None, reason="needs Drake: the extra 'witness'")
MADE = [pytest.param(form, marks=drake if form == "sdf" else ()) for form in READERS]


def bent_at_rest(scene: fl.Scene) -> fl.Chain:
    """A chain with rest angles of 0.1 rad, to detect files that lose them."""
    chain = fl.lump(scene)
    hinges = chain.hinges.copy()
    hinges["rest"][hinges["stiffness"] > 0] = 0.1
    return dataclasses.replace(chain, hinges=hinges)


CHAIN = bent_at_rest(SPATIAL)


def written(folder: Path, form: str, edit: planted.Edit | None = None, chain: fl.Chain = CHAIN) -> Path:
    """Write our file of a chain with an edit; return its path."""
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


def each_planted(cases: Iterable[Planted]) -> pytest.MarkDecorator:
    every = [pytest.param(case, marks=drake if case.form == "sdf" else ()) for case in cases]
    return pytest.mark.parametrize("case", every, ids=lambda case: f"{case.form}, {case.mistake}")


def check_only_named(found: Diagnosis, named: str, key: str | None, explained: bool = True) -> None:
    """Check that there is one finding, with this pattern, and that it explains all that differs."""
    (finding,) = found.findings
    assert re.search(named, str(finding)), str(found)
    if key is not None:
        reviewed(key, str(finding))
    differing = {row.quantity for row in found.rows if not row.passed}
    assert not explained or found.explained is (True if differing else None)
    if finding.faulty is not None:
        assert differing <= set(finding.affects)


@each_planted(PLANTED)
def test_a_planted_mistake_is_the_only_one_named_and_explains_all_that_differs(case: Planted, tmp_path: Path) -> None:
    key = None if case.form == "sdf" else f"their files: {case.mistake}"  # Drake is optional where texts are written
    check_only_named(diagnosed(written(tmp_path, case.form, case.edit)), re.escape(case.named), key)


def labels(*fields: str) -> str:
    """Names of fields in the format in which a note lists them."""
    return ", ".join(table().fields[field].label for field in fields)


@pytest.mark.parametrize("form", MADE)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_no_mistake_is_named_in_our_own_file(path: Path, form: str, tmp_path: Path) -> None:
    angles = {"link.*.lumping": "gauss"} if path.stem == "pazy_wing" else {}  # files with rotation springs are refused
    scene = fl.load_scene(path).varied({"motion": (), **angles})
    chain = fl.lump(scene)
    if form == "mjcf" and path.stem == "stepped_beam":  # a rigidity table has no inertia about the beam's axis
        with refused(fl.errors.ArgumentError, "inertia-impossible"):
            written(tmp_path, form, chain=chain)
        return
    found = diagnosed(written(tmp_path, form, chain=chain), chain, scene=scene)
    assert found.passed and not found.findings and not found.left_out, str(found)
    controller = {"pd": ["servo_stiffness", "servo_damping"]}.get(scene.drive.kind, [])
    controller += ["effort"] * (scene.drive.effort is not None)
    expected = [labels(*controller)] if controller else []
    if all(name.startswith("base.") for name in chain.joint_names):  # no joint of the file has data of flexlink
        alone = {"urdf": ("stiffness", "rest", "coulomb_width", "armature"), "sdf": ("coulomb_width",)}
        expected += [labels(*alone[form])] if form in alone else []
    if form != "mjcf" and len(chain.couplings):  # MJCF represents them as tendons
        expected.append("")
    assert len(found.notes) == len(expected)
    for note, part in zip(found.notes, expected, strict=True):
        assert note.endswith(part)
        reviewed("their files: note on our file", note)


@pytest.fixture(scope="module")
def cranes(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, fl.Scene]:
    """The crane of the handwritten files, with torques (False) and with servos (True)."""
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
    """Diagnosis of an edited handwritten file of the crane, compared with its scene or with `beside`."""
    hand = HANDS[name]
    scene = cranes[hand.habit.servos]
    chain = fl.lump(scene)
    root = ET.fromstring(ET.tostring(hand.write(chain, hand.habit, scene)))  # with XML namespaces as a reader sees them
    if edit is not None:
        edit(root)
    path = folder / "by_hand.xml"
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return diagnosed(path, chain, scene=beside or scene)


def needs_drake(name: str) -> tuple[pytest.MarkDecorator, ...]:
    return (drake,) if HANDS[name].form == "sdf" else ()


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs_drake(name)) for name in HANDS])
def test_a_correct_handwritten_file_has_no_findings(name: str, cranes, tmp_path: Path) -> None:
    found = by_hand(name, cranes, tmp_path)
    assert found.passed and not found.left_out and len(found.rows) == 6
    if HANDS[name].form != "sdf":
        reviewed("their files: all agrees", str(found).splitlines()[0])
    assert all("integrator" in finding.remedy or "autoreset" in finding.remedy for finding in found.findings)
    assert not any(finding.counts or finding.faulty is not None for finding in found.findings)


@pytest.mark.parametrize(
    ("case", "name"),
    [
        pytest.param(case, name, marks=needs_drake(name), id=f"{name}, {case.mistake}")
        for case in ABROAD
        for name in case.hands
    ],
)
def test_a_mistake_in_a_handwritten_file_is_named_first(case: Abroad, name: str, cranes, tmp_path: Path) -> None:
    found = by_hand(name, cranes, tmp_path, case.edit)
    assert case.named in str(found.findings[0]), str(found)
    assert not found.passed and found.explained is not False
    if HANDS[name].form == "sdf":
        return
    reviewed(f"their files: {case.mistake} by hand", str(found.findings[0]))
    for finding in found.findings[1:]:
        reviewed("their files: further finding by hand", str(finding))


def along_axes(root: ET.Element) -> None:
    for joint in root.iter("joint"):
        joint.set("pos", planted.numbers(planted.vector(joint, "pos") + 0.3 * planted.vector(joint, "axis")))


def endless(root: ET.Element) -> None:
    for joint in root.findall("joint[@type='revolute']"):
        joint.set("type", "continuous")
        joint.remove(joint.find("limit"))


def two_bodies(root: ET.Element) -> None:
    """Split off half of the last hinge's body, as another body that is welded to it."""
    body = list(root.iter("body"))[-2]
    inertial = body.find("inertial")
    for name in ("mass", "diaginertia"):
        inertial.set(name, planted.numbers(planted.vector(inertial, name) / 2))
    ET.SubElement(body, "body", name="half").append(ET.fromstring(ET.tostring(inertial)))


@pytest.mark.parametrize(("form", "edit"), [
    ("mjcf", along_axes), ("mjcf", two_bodies), ("urdf", endless), ("mjcf", planted.unnamed),
], ids=lambda value: getattr(value, "__name__", value))  # fmt: skip
def test_the_same_arm_in_another_notation_is_correct(form: str, edit: planted.Edit, tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, form, edit))
    assert found.passed and not found.findings, str(found)
    for note in found.notes if edit is planted.unnamed else ():
        reviewed("their files: matched by order", note)


def plain_urdf(root: ET.Element) -> None:
    for parent in (root, *root.findall("joint")):
        for own in parent.findall("flexlink"):
            parent.remove(own)


def test_a_note_lists_what_a_plain_urdf_lacks(tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, "urdf", plain_urdf))
    assert found.passed and not found.findings
    (note,) = found.notes
    assert labels("gravity", "stiffness", "rest") + ", " in note
    reviewed("their files: taken from the scene", note)


def test_mujoco_reads_urdf(tmp_path: Path) -> None:
    chain = fl.lump(fl.load_scene(ROOT / "validation" / "scenes" / "double_pendulum_rods.toml"))
    wrong = planted.scaled(".//mass", "value", 1.1, only=1)
    right, other = (diagnosed(written(tmp_path, "urdf", edit, chain), chain, "mujoco") for edit in (None, wrong))
    assert right.passed and not right.findings, str(right)
    assert "1.1" in str(other.findings[0]) and other.explained
    reviewed("their files: mass in a URDF file", str(other.findings[0]))


def test_a_file_written_by_mujoco_has_fewer_digits(tmp_path: Path) -> None:
    path = tmp_path / "saved.xml"
    mujoco.mj_saveLastXML(str(path), mujoco.MjModel.from_xml_string(fl.to_mjcf(CHAIN)))
    found = diagnosed(path)
    (finding,) = found.findings
    assert re.findall(r" ([56]) ", finding.what) and "%.17g" in finding.remedy and found.explained
    reviewed("their files: written by MuJoCo", str(finding), values=False)


@pytest.mark.parametrize("name", ["ur5", "xarm7"])
def test_the_urdf_file_of_a_robot_agrees_with_its_scene_despite_other_joint_names(name: str) -> None:
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
    edits = {  # keys are parts of the findings
        planted.cause("axis"): planted_abroad.axis_exchanged(hinge, 4, "axis"),
        "joint 'jib.2.z' is 1000 times ": planted.scaled(body, "pos", 1e3, only=5),
        "joint 'boom' displaced by 0.07 m": planted.frame_moved(body, "pos", 1, (0, 0.07, 0)),
        planted.cause("masses", "one_too_light"): planted_abroad.one(planted.INERTIAL, -1, mass="2"),
        f"{labels('inertias')} of joint 'slew': ": planted.scaled(planted.INERTIAL, "fullinertia", 4, only=0),
        planted.cause("stiffness", "scaled_by", 2): planted.scaled(hinge, "stiffness", 2),
        "springref from joint 'boom.2.z'": planted_abroad.one(hinge, 3, springref="0.1"),
        f"{labels('damping')} of 2 joints": planted.each("default/default/joint", damping=None),
        f"{labels('armature')} of 3 joints": planted.each(hinge, armature=None),
        "1 body; ": planted_abroad.one(body, 2, gravcomp="1"),
        "0.002 s > ": planted.each(option, timestep="0.002"),
    }  # fmt: skip
    found = by_hand("degrees", cranes, tmp_path, planted.both(*edits.values()))
    counting = [str(finding) for finding in found.findings if finding.counts]
    for named in edits:
        assert [named in text for text in counting].count(True) == 1, named
    for text in counting:
        reviewed("their files: eleven mistakes", text)
    assert len(counting) == len(edits) and found.explained, str(found)


def test_with_a_scene_without_a_drive_actuators_are_listed_and_not_compared(cranes, tmp_path: Path) -> None:
    geared = planted.each(planted_abroad.MOTOR, gear="50", forcerange="-1 1")
    found = by_hand("degrees", cranes, tmp_path, geared, without_drive(cranes))
    first, *_, last = str(found).splitlines()
    assert found.passed and found.left_out == ("actuators",)
    reviewed("their files: actuators are not compared", first)
    for joint, limit in {"slew": 50, "boom": 50, "jib": 50}.items():
        assert f"'{joint}' (gear {limit})" in last and f"'{joint}' (±{limit} N m)" in last
    reviewed("their files: actuators that are not compared", last)
    plain = by_hand("welded", cranes, tmp_path, beside=without_drive(cranes))
    assert plain.passed and not plain.left_out


def test_servos_of_a_file_are_reported_for_a_scene_without_a_drive(cranes, tmp_path: Path) -> None:
    found = by_hand("servos", cranes, tmp_path, beside=without_drive(cranes))
    assert not found.passed and found.findings[0].likely == planted.cause("servo_stiffness", "none_expected")
    reviewed("their files: servos without a drive", str(found.findings[0]))


def through_a_tendon(root: ET.Element) -> None:
    motor = root.findall(planted_abroad.MOTOR)[-1]
    rope = ET.SubElement(ET.SubElement(root, "tendon"), "fixed", name="rope")
    ET.SubElement(rope, "joint", joint=motor.attrib["joint"], coef="1")
    motor.attrib = {"name": "winch", "tendon": "rope"}


def test_an_actuator_that_cannot_be_compared_is_named_as_such(cranes, tmp_path: Path) -> None:
    found = by_hand("degrees", cranes, tmp_path, through_a_tendon)
    missing, left_out = line(str(found), planted.cause("gear", "all_zero")), line(str(found), "'winch' (")
    assert "'jib'" in missing.rpartition(";")[2] and "tendon" in left_out
    reviewed("their files: an actuator of a tendon", f"{missing}\n{left_out}")
    assert found.left_out == ("actuators",)


def test_only_torque_limits_below_the_drive_torque_are_reported(cranes, tmp_path: Path) -> None:
    for limit, counts in ((150.0, False), (149.0, True)):  # N m; the boom's drive needs 150
        edit = planted.each(planted_abroad.MOTOR, forcerange=f"{-limit} {limit}", forcelimited="true")
        found = by_hand("degrees", cranes, tmp_path, edit)
        assert found.passed is not counts
        limits = [str(finding) for finding in found.findings if "±149 N m" in finding.what]
        assert len(limits) == counts and all("joint 'boom'" in text for text in limits)
        for text in limits:
            reviewed("their files: a torque limit", text)


def test_torque_limits_are_compared_with_the_largest_torques_of_a_table(cranes, tmp_path: Path) -> None:
    torques = ((20.0, -150.0, -60.0), (-30.0, 10.0, 5.0))
    scene = cranes[False].varied(
        {"drive.kind": "table", "drive.torque": None, "drive.times": (0.0, 1.0), "drive.torques": torques}
    )
    for limits, counts in (("-150 30", False), ("-149 30", True), ("-150 29", False), ("-150 19", True)):
        edit = planted.each(planted_abroad.MOTOR, forcerange=limits, forcelimited="true")
        assert by_hand("degrees", cranes, tmp_path, edit, scene).passed is not counts


def test_limits_of_the_scene_are_compared_unless_the_file_has_none(cranes, tmp_path: Path) -> None:
    limited = {False: cranes[False].varied({"drive.effort": (10.0, 100.0, 30.0)}), True: cranes[True]}
    found = by_hand("degrees", limited, tmp_path)
    (limit,) = (str(finding) for finding in found.findings if "±500 N m" in finding.what)
    assert all(part in limit for part in ("3 joints", "'slew'", "'boom'", "'jib'", "±10 N m"))
    reviewed("their files: a torque limit", limit)
    found = by_hand("welded", limited, tmp_path)
    assert found.passed and found.notes[-1].endswith(labels("coulomb_width", "effort"))


def test_disabled_actuators_are_ignored(cranes, tmp_path: Path) -> None:
    motors = planted_abroad.MOTOR
    for off in (
        planted.each("option/flag", actuation="disable"),
        planted.both(planted.each(motors, group="2"), planted.each("option", actuatorgroupdisable="2")),
    ):
        found = by_hand("degrees", cranes, tmp_path, planted.both(off, planted.each(motors, gear="50")))
        assert found.passed and found.notes[-1].endswith(": " + labels("coulomb_width", "gear"))


def test_armature_and_damping_of_an_actuator_act_on_its_joint(cranes, tmp_path: Path) -> None:
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
    armature = line(str(found), "'slew'", "1.2 ", "0.3 kg m²", " 4")
    assert found.explained and labels("armature") in armature
    reviewed("their files: rotor of an actuator", armature)


def grows(xml: str, integrator: str, step: float) -> bool:
    """Return whether a small motion about the bent arm grows without bound in MuJoCo."""
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
def test_stability_limits_of_mujoco_integrators_match_its_runs(integrator: str, cranes) -> None:
    chain = fl.lump(cranes[False].varied({"gravity": (0.0, 0.0, 0.0)}))
    xml, largest = fl.to_mjcf(chain, shapes=False), LARGEST[integrator](chain)
    assert not grows(xml, integrator, 0.98 * largest) and grows(xml, integrator, 1.02 * largest)


def test_an_integrator_without_a_known_limit_has_no_finding_on_its_step(cranes, tmp_path: Path) -> None:
    found = by_hand("degrees", cranes, tmp_path, planted.each("option", integrator="discrete", timestep="1"))
    assert found.passed and not any("timestep" in finding.remedy for finding in found.findings)


def test_each_of_two_mistakes_is_named_with_its_effects(tmp_path: Path) -> None:
    edit = planted.both(
        planted.each("option", gravity="0 0 -9.81"), planted.each(".//joint", armature=None), planted.flag("autoreset")
    )
    found = diagnosed(written(tmp_path, "mjcf", edit))
    gravity, armature, autoreset = found.findings
    assert (gravity.affects, armature.affects, autoreset.affects) == (("T_G", "T_GC", "q̈"), ("M", "q̈"), ())
    assert found.explained


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_missing_rotor_is_named_even_as_the_only_inertia_of_its_joint(form: str, tmp_path: Path) -> None:
    link = fl.Link(name="first", length=1.0, joint=fl.Joint(armature=0.1, gear_stiffness=100.0))
    chain = fl.lump(fl.Scene(name="geared", arm=fl.Arm(links=(link,), tip=fl.RigidBody(mass=1.0, inertia=(0.1,) * 3)),
                             initial=fl.InitialState(joint_deg=(0.0,))))  # fmt: skip
    edit = planted.each(".//joint" if form == "mjcf" else "joint/flexlink", armature="0")
    found = diagnosed(written(tmp_path, form, edit, chain), chain)
    (finding,) = found.findings
    assert not found.passed and "'first'" in finding.what and " 0.1 kg m²" in finding.what
    assert finding.likely == planted.cause("armature", "all_zero")
    assert "q̈ (M is singular)" in finding.affects
    reviewed("their files: a missing rotor", str(finding))


def test_a_planar_arm_is_realigned_by_a_rotation_not_by_a_reflection(rng: np.random.Generator) -> None:
    ours = of_chain(fl.lump(fl.load_scene(ROOT / "models" / "paper_fig5.toml")))
    for k in range(ours.n - 1):
        turn = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3))
        point = ours.points[k]
        theirs = joint_axes._moved_rigidly(ours, k, turn.as_matrix(), point, point + rng.uniform(-1, 1, 3))
        realigned, displacements, _ = joint_axes.undo_displacements(ours, theirs, 1e-11)
        assert displacements[0].angle == pytest.approx(turn.magnitude(), abs=1e-9)
        assert np.abs(realigned.inertias - ours.inertias).max() <= 1e-12 * np.abs(ours.inertias).max()


@pytest.mark.slow
def test_the_command_line_prints_the_diagnosis_and_has_its_exit_code(tmp_path: Path, capsys) -> None:
    scene, chain = str(ROOT / "models" / "paper_fig5.toml"), fl.lump(fl.load_scene(ROOT / "models" / "paper_fig5.toml"))

    def compared(edit: planted.Edit | None) -> tuple[int, str]:
        file = written(tmp_path, "mjcf", edit, chain)
        return main(["compare", scene, "--file", str(file), "--samples", "8"]), capsys.readouterr().out

    code, printed = compared(None)
    assert code == 0
    reviewed("their files: all agrees", printed.splitlines()[-1])
    code, printed = compared(planted.flag("autoreset"))
    assert code == 0
    reviewed("their files: autoreset", line(printed, "  1. autoreset"))
    code, printed = compared(planted.scaled(".//joint", "stiffness", np.pi / 180))
    assert code == 1
    stiffness = line(printed, "factor 0.0174533", "T_FL, q̈")
    assert planted.DEGREES in stiffness
    reviewed("their files: stiffness per degree", stiffness)
    code, printed = compared(planted.first_joint_gone)
    assert code == 1
    gone = line(printed, "9 joints", " 10", "'upper'")
    reviewed("their files: a joint is missing", gone)


def loop(root: ET.Element) -> None:
    joints = root.findall("joint")
    joints[-1].find("child").set("link", joints[0].find("parent").get("link"))


LOAD, NUMBER = "engine-cannot-load", "number-in-file"
HOSTILE: dict[str, tuple[str, Callable[[str], str], str, str]] = {
    "empty": ("mjcf", lambda _: "", "not-xml", ""),
    "cut off": ("urdf", lambda text: text[:2000], "not-xml", ""),
    "another language": ("urdf", lambda _: "<html/>", "unknown-root-element", "<html>"),
    "entities": ("urdf", lambda text: '<!DOCTYPE r [<!ENTITY a "b">]>' + text, "xml-entities", "<!DOCTYPE r>"),
    "xacro": ("urdf", lambda _: '<robot xmlns:xacro="x"><xacro:include filename="y"/></robot>', LOAD, ""),
    "nothing moves": ("mjcf", lambda _: "<mujoco/>", "no-movable-joint", ""),
    "a ball": ("mjcf", lambda text: text.replace('"hinge"', '"ball"', 1), "joint-type-in-file", "ball"),
    "a planar joint": ("urdf", lambda text: text.replace('"revolute"', '"planar"', 1), LOAD, "'waist'"),
    "a missing mesh": (
        "mjcf", lambda text: text.replace("<worldbody>", '<asset><mesh file="no.stl"/></asset><worldbody>'),
        LOAD, "no.stl"),
    "an unknown attribute": ("mjcf", lambda text: text.replace('mass="', 'mas="', 1), LOAD, "mas"),
    "no number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="nan"', text), NUMBER, "'waist'"),
    "words for a number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="soft"', text), LOAD, "soft"),
    "two numbers of three": ("urdf", lambda text: re.sub('gravity="[^"]*"', 'gravity="0 9.81"', text), LOAD, "gravity"),
    "a limit that is none": (
        "mjcf", lambda text: text.replace("<motor ", '<motor forcelimited="true" forcerange="-1 nan" '),
        NUMBER, "'waist'"),
    "a reduction in words": ("urdf", lambda text: text.replace("Reduction>1<", "Reduction>fifty<"), LOAD, "'fifty'"),
    "axes of length 0": ("urdf", lambda text: re.sub('axis xyz="[^"]*"', 'axis xyz="0 0 0"', text), NUMBER, "'waist'"),
    "a name given twice": ("urdf", lambda text: text.replace('"upper.1.x"', '"upper"'), LOAD, ""),
    "no SDF": ("sdf", lambda text: text.replace("<child>", "<kid>").replace("</child>", "</kid>"), LOAD, ""),
    "far too long": ("urdf", lambda text: text.replace("</robot>", "<joint/>" * 300 + "</robot>"),
        "too-many-joints", "324 joints"),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=drake if form == "sdf" else ()) for name, (form, *_) in HOSTILE.items()]
)
def test_a_broken_file_is_refused_in_one_line_with_its_name(name: str, tmp_path: Path) -> None:
    form, spoil, id, named = HOSTILE[name]
    path = written(tmp_path, form)
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(fl.errors.DataFileError) as caught:
        load_file(path, CHAIN.n, here=True)
    assert caught.value.id == id
    assert str(caught.value).startswith(f"{path}: ") and named in str(caught.value)
    if id != LOAD:  # otherwise the text comes from the engine
        reviewed(id, str(caught.value))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a name given twice", "a missing mesh", "entities"])
def test_the_command_line_prints_one_line_with_the_error_of_the_engine(name: str, tmp_path: Path, capfd) -> None:
    form, spoil, id, named = HOSTILE[name]
    path = written(tmp_path, form)
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    assert main(["compare", str(MODELS[0]), "--file", str(path)]) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.count("\n") == 1 and named in err and f"[{id}]" in err
    if name == "a name given twice":
        assert "'upper'" in err


@pytest.mark.slow
def test_a_number_that_an_engine_cannot_read_is_named_with_its_message(tmp_path: Path, capfd) -> None:
    path = written(tmp_path, "urdf", planted.each("link[3]/inertial/mass", value="1,5"), fl.lump(SPATIAL))
    comparison = fl.compare(SPATIAL, file=path, samples=8)
    mass, engine = line(comparison.diagnosis, "  1. "), line(comparison.diagnosis, "mass [1,5]")
    assert planted.cause("masses", "all_zero") in mass and "pinocchio" in engine
    reviewed("their files: a mass that the engine cannot read", mass)
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("form", MADE)
def test_a_child_process_gives_the_same_findings(form: str, tmp_path: Path) -> None:
    comparison = fl.compare(SPATIAL, file=written(tmp_path, form, chain=fl.lump(SPATIAL)), samples=8)
    assert comparison.passed and len(comparison.diagnosis.splitlines()) == 1
    if form != "sdf":
        reviewed("their files: all agrees", comparison.diagnosis)


def test_a_missing_file_and_two_engines_are_refused(tmp_path: Path) -> None:
    with refused(fl.errors.DataFileError, "cannot-read"):
        fl.compare(SPATIAL, file=tmp_path / "gone.xml")
    file = written(tmp_path, "mjcf")
    with refused(fl.errors.ArgumentError, "one-engine-per-file"):
        fl.compare(SPATIAL, file=file, engines=("mujoco", "pinocchio"))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.compare(SPATIAL, file=file, engines=("pinocchio",))


def test_a_relative_path_starts_at_the_current_folder(tmp_path: Path, monkeypatch) -> None:
    """The child process waits for the next file and keeps the working folder in which it was started."""
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
