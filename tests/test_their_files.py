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
import pytest
from conftest import MODELS, ROOT
from planted import PLANTED, Planted
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.cli.main import main
from flexlink.engines import lines
from flexlink.engines.diagnosis import Diagnosis, diagnose_file
from flexlink.engines.read_back import of_chain, to_chain
from flexlink.engines.states import mixed_states
from flexlink.engines.theirs import READERS, load_file
from flexlink.formats import FORMATS
from flexlink.robots.collection import known_arm

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


def diagnosed(path: Path, chain: fl.Chain = CHAIN, engine: str | None = None) -> Diagnosis:
    states = [state._replace(wrench=np.zeros(6)) for state in mixed_states(chain, 8)]
    return diagnose_file(chain, load_file(path, chain.n, engine, here=True), states)


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
    if finding.made is not None:
        assert differing <= set(finding.alone)


@pytest.mark.parametrize("form", MADE)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_in_our_own_file_nothing_is_named(path: Path, form: str, tmp_path: Path) -> None:
    chain = fl.lump(fl.load_scene(path).varied({"motion": ()}))
    found = diagnosed(written(tmp_path, form, chain=chain), chain)
    assert found.passed and not found.findings and not found.notes, str(found)


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
    assert found.notes == ("joints are matched by their order: their names differ",)


def plain_urdf(root: ET.Element) -> None:
    for parent in (root, *root.findall("joint")):
        for own in parent.findall("flexlink"):
            parent.remove(own)


def test_what_a_plain_urdf_cannot_say_is_taken_from_the_scene_and_told(tmp_path: Path) -> None:
    found = diagnosed(written(tmp_path, "urdf", plain_urdf))
    assert found.passed and not found.findings
    (note,) = found.notes
    assert note.startswith("not in the file, and taken from the scene: gravity, spring stiffness, rest angle, ")


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
    assert re.search(r"right to about [56] digits: digits were lost in writing", str(finding)) and found.explained


@pytest.mark.parametrize("name", ["ur5", "xarm7"])
def test_a_robot_s_own_urdf_agrees_with_its_scene_whatever_it_calls_its_joints(name: str) -> None:
    try:
        path = known_arm(name).path
    except fl.MissingDependencyError as error:
        pytest.skip(str(error))
    chain = fl.lump(fl.load_scene(ROOT / "models" / "robots" / f"{name}.toml"))
    found = diagnosed(path, chain)
    assert found.passed and not found.findings, str(found)


def test_two_mistakes_are_both_named_each_with_what_it_changes(tmp_path: Path) -> None:
    edit = planted.both(
        planted.each("option", gravity="0 0 -9.81"), planted.each(".//joint", armature=None), planted.flag("autoreset")
    )
    found = diagnosed(written(tmp_path, "mjcf", edit))
    gravity, armature, autoreset = found.findings
    assert (gravity.alone, armature.alone, autoreset.alone) == (("T_G", "T_GC", "q̈"), ("M", "q̈"), ())
    assert found.explained


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_rotor_left_out_is_named_though_nothing_else_gives_its_joint_inertia(form: str, tmp_path: Path) -> None:
    link = fl.Link(name="first", length=1.0, joint=fl.Joint(armature=0.1, gear_stiffness=100.0))
    chain = fl.lump(fl.Scene(name="geared", arm=fl.Arm(links=(link,), tip=fl.Payload(mass=1.0, inertia=(0.1,) * 3)),
                             initial=fl.Initial(joint_deg=(0.0,))))  # fmt: skip
    edit = planted.each(".//joint" if form == "mjcf" else "joint/flexlink", armature="0")
    found = diagnosed(written(tmp_path, form, edit, chain), chain)
    (finding,) = found.findings
    assert not found.passed and "armature of joint 'first': 0 instead of 0.1 kg m²: left out" in str(finding)
    assert "M, which is singular" in finding.alone


def test_a_flat_arm_is_put_back_by_a_rotation_not_by_a_mirror(rng: np.random.Generator) -> None:
    ours = of_chain(fl.lump(fl.load_scene(ROOT / "models" / "paper_fig5.toml")))
    for k in range(ours.n - 1):
        turn = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3))
        point = ours.points[k]
        theirs = lines._displaced(ours, k, turn.as_matrix(), point, point + rng.uniform(-1, 1, 3))
        placed = lines.put_back(ours, theirs, 1e-11)
        assert placed.places[0].angle == pytest.approx(turn.magnitude(), abs=1e-9)
        assert np.abs(placed.theirs.inertias - ours.inertias).max() <= 1e-12 * np.abs(ours.inertias).max()


@pytest.mark.parametrize("read", [of_chain(CHAIN), of_chain(fl.lump(SPATIAL))], ids=["bent", "straight"])
def test_a_record_as_a_chain_has_the_same_record(read) -> None:
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
    assert code == 0 and "  1. a run that diverges restarts silently" in told
    code, told = compared(planted.scaled(".//joint", "stiffness", np.pi / 180))
    assert code == 1
    assert (
        "factor 0.0174533: degrees taken for radians; by itself it changes T_FL, q̈; give stiffness of these joints in N m/rad"
        in told
    )
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
    "nothing moves": ("mjcf", lambda _: "<mujoco/>", "no joint moves"),
    "a slide": ("mjcf", lambda text: text.replace('"hinge"', '"slide"', 1), "of type slide"),
    "a prismatic joint": ("urdf", lambda text: text.replace('"revolute"', '"prismatic"', 1), "only arms of hinges"),
    "a missing mesh": (
        "mjcf", lambda text: text.replace("<worldbody>", '<asset><mesh file="no.stl"/></asset><worldbody>'), "no.stl"),
    "an unknown attribute": ("mjcf", lambda text: text.replace('mass="', 'mas="', 1), "mas"),
    "no number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="nan"', text), "stiffness of joint"),
    "words for a number": ("urdf", lambda text: re.sub('stiffness="[^"]*"', 'stiffness="soft"', text), "soft"),
    "two numbers of three": ("urdf", lambda text: re.sub('gravity="[^"]*"', 'gravity="0 9.81"', text), "gravity"),
    "axes of length 0": ("urdf", lambda text: re.sub('axis xyz="[^"]*"', 'axis xyz="0 0 0"', text), "axis of joint"),
    "a name given twice": ("urdf", lambda text: text.replace('"upper.1.x"', '"upper"'), "cannot load"),
    "a free base": ("sdf", lambda _: '<sdf version="1.10"><model name="m"><link name="l"/></model></sdf>', "floating"),
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
    with pytest.raises(fl.DataFileError) as caught:
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
    assert "the mass is left out, or is no number to the engine" in comparison.diagnosis
    assert "pinocchio complains: Inertial: mass [1,5] is not a float" in comparison.diagnosis
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("form", MADE)
def test_a_process_of_its_own_says_the_same(form: str, tmp_path: Path) -> None:
    comparison = fl.compare(SPATIAL, file=written(tmp_path, form, chain=fl.lump(SPATIAL)), samples=8)
    assert comparison.passed and comparison.diagnosis.endswith("all 6 quantities agree")


def test_a_file_that_is_not_there_is_named_and_two_engines_are_refused(tmp_path: Path) -> None:
    with pytest.raises(fl.DataFileError, match=r"gone\.xml: cannot be read: No such file"):
        fl.compare(SPATIAL, file=tmp_path / "gone.xml")
    file = written(tmp_path, "mjcf")
    with pytest.raises(fl.ArgumentError, match="a file is read by one of them"):
        fl.compare(SPATIAL, file=file, engines=("mujoco", "pinocchio"))
    with pytest.raises(fl.ArgumentError, match="engine for MJCF = 'pinocchio': unknown; allowed are mujoco"):
        fl.compare(SPATIAL, file=file, engines=("pinocchio",))


@pytest.mark.slow
def test_the_example_of_the_readme_is_what_is_printed(tmp_path: Path, capsys) -> None:
    path = ROOT / "models" / "paper_fig5.toml"
    edit = planted.both(
        planted.each("option", gravity=None, integrator=None),
        planted.scaled(".//joint", "stiffness", planted.PER_DEGREE),
    )
    file = written(tmp_path, "mjcf", edit, fl.lump(fl.load_scene(path)))
    assert main(["compare", str(path), "--file", str(file)]) == 1
    shown = (ROOT / "README.md").read_text(encoding="utf-8").split("--file theirs.xml\n…\n")[1].split("```")[0]
    assert capsys.readouterr().out.endswith(shown)
