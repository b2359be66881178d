"""compare(scene, file=…) reports exactly the mistake in a file with trees, prismatic joints or free bases."""

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import flexlink as fl
from flexlink.diagnosis.comparison import load_file
from flexlink.diagnosis.diagnosis import Diagnosis
from tests.diagnosis.test_their_files import MADE, check_only_named, diagnosed, each_planted, written
from tests.support import planted
from tests.support.beams import satellite
from tests.support.planted import JOINT, Planted, each, frame_moved, scaled, text_scaled, text_set, unnamed
from tests.support.urdf_texts import named_tree
from tests.support.words import line, reviewed

SCENE = satellite()
CHAIN = fl.lump(SCENE)
BASE = CHAIN.bodies["rotation"][1]
ON_ANOTHER = "a branch on another"


def of_file(folder: Path, form: str, edit: planted.Edit | None = None) -> Diagnosis:
    return diagnosed(written(folder, form, edit, CHAIN), CHAIN, base=BASE)


def of_joint(name: str, path: str = ".") -> str:
    return f".//joint[@name='{name}']/{path}" if path != "." else f".//joint[@name='{name}']"


def attached_to_the_other(root: ET.Element) -> None:
    """Attach the right hand to the left one."""
    root.find(of_joint("right", "parent")).set("link", "left_link")


def bodies_exchanged(root: ET.Element) -> None:
    """Move the body of the right hand into that of the left one, with its offset."""
    parents = {child: parent for parent in root.iter() for child in parent}
    left, right = (root.find(f".//body[@name='{name}_link']") for name in ("left", "right"))
    parents[right].remove(right)
    left.append(right)


PLANTED = (
    Planted("urdf", "a slide that turns", each(of_joint("boom"), type="revolute"), "joint 'boom': revolute"),
    Planted("urdf", "a slide the other way", scaled(of_joint("boom.gear", "axis"), "xyz", -1), "axis"),
    Planted("urdf", "a belt per mm", scaled(of_joint("boom.gear", "flexlink"), "stiffness", 1e-3),
            r"50 \D+ 50000 N/m\D+ 0\.001\b"),
    Planted("urdf", "friction of a slide left out", each(of_joint("boom", "dynamics"), damping="0"),
            r"damping of joint 'boom': 0 \D+ 3 N s/m"),
    Planted("urdf", "mass of the base", scaled(".//link[@name='base_link']/inertial/mass", "value", 1e-3),
            r"mass of joint 'base\.rz': 0\.1 \D+ 100 kg"),
    Planted("urdf", "a branch displaced", frame_moved(of_joint("right", "origin"), "xyz", 0, (0.01, 0.0, 0.0)),
            r"joint 'right' .*0\.01 m"),
    Planted("urdf", ON_ANOTHER, attached_to_the_other, "joint 'right'"),
    Planted("mjcf", "a slide that turns", each(of_joint("boom"), type="hinge"), "joint 'boom': revolute"),
    Planted("mjcf", "a rest in mm", each(of_joint("boom.gear"), springref="0.1"), r"joint 'boom\.gear'"),
    Planted("mjcf", "a branch displaced", frame_moved(".//body[@name='left_link']", "pos", 0, (0.0, 0.02, 0.0)),
            r"joint 'left' .*0\.02 m"),
    Planted("mjcf", ON_ANOTHER, bodies_exchanged, "joint 'right'"),
    Planted("mjcf", "centre of the base", each(".//body[@name='base_link']/inertial", pos="0 0 0"),
            r"joint 'base\.rz'"),
    Planted("mjcf", "springs per degree", scaled(JOINT, "stiffness", np.pi / 180), r"stiffness \D+ 9 "),
    Planted("sdf", "a slide that turns", each(of_joint("boom"), type="revolute"), "joint 'boom': revolute"),
    Planted("sdf", "a heavier rotor", text_set(planted.ROTOR, "3.0"), r"armature of joint 'boom': 3 \D+ 2 kg"),
    Planted("sdf", "gravity the other way", text_scaled("world/gravity", 1, 1, -1), "gravity"),
)  # fmt: skip


@each_planted(PLANTED)
def test_only_the_planted_mistake_is_reported_and_it_explains_all_differences(case: Planted, tmp_path: Path) -> None:
    """The finding matches `named`, a pattern of names and values."""
    key = f"diagnosis, {case.form}: {case.mistake}, tree"
    check_only_named(of_file(tmp_path, case.form, case.edit), case.named, key, case.mistake != ON_ANOTHER)


@pytest.mark.parametrize("form", MADE)
def test_no_mistake_is_reported_in_our_own_file(form: str, tmp_path: Path) -> None:
    found = of_file(tmp_path, form)
    assert found.passed and not found.findings, str(found)


def test_the_position_of_a_sliding_joint_does_not_matter(tmp_path: Path) -> None:
    """Only the direction of a prismatic axis matters."""
    found = of_file(tmp_path, "mjcf", each(".//joint[@type='slide']", pos="0.1 0.2 0.3"))
    assert found.passed and not found.findings, str(found)


def test_a_file_with_a_fixed_base_is_reported(tmp_path: Path) -> None:
    def grounded(root: ET.Element) -> None:
        body = root.find(".//freejoint/..")
        body.remove(body.find("freejoint"))

    text = line(str(of_file(tmp_path, "mjcf", grounded)), "base.kind")
    reviewed("diagnosis: fixed base", text)


def test_a_tree_without_equal_names_of_joints_or_bodies_is_not_matched(tmp_path: Path) -> None:
    text = line(str(of_file(tmp_path, "mjcf", unnamed)), "'panel'", "joint.name")
    reviewed("diagnosis: branches without names", text)


def test_a_urdf_of_another_tool_has_a_free_base_if_the_scene_has_one(tmp_path: Path) -> None:
    """URDF cannot represent a free base; its angles are measured from its initial attitude in the scene."""

    def plain(root: ET.Element) -> None:
        root.remove(root.find("flexlink"))

    path = written(tmp_path, "urdf", plain, CHAIN)
    _, engine, _ = load_file(path, CHAIN.n, here=True)
    assert engine.n == CHAIN.n - 6
    found = diagnosed(path, CHAIN, base=BASE)
    assert found.passed and not found.findings, str(found)


WRONG = {
    "mass-differs": ("inertial", "mass", 1.2, 0.0),
    "centre-of-mass-differs": ("inertial", "pos", 1.0, 0.02),
    "inertia-differs": ("inertial", "diaginertia", 1.1, 0.0),
    "frame-differs": (".", "pos", 1.0, 0.03),
    "damping-differs": ("joint", "damping", 1.0, 0.5),
    "armature-differs": ("joint", "armature", 1.0, 0.2),
}
"""Id of a mistake, and the element of a body, its attribute, and the factor and summand by which its numbers differ."""


def by_the_maker(scene: fl.Scene, id: str, name: str, named: bool) -> ET.Element:
    """MJCF of a robot with a mistake at a joint, six digits, and names of links and, if `named`, of joints."""
    root = ET.fromstring(fl.to_mjcf(fl.lump(scene), shapes=False))
    links = {link.joint_name: link.name for link in scene.arm.links}
    for extra in (*root.findall("custom"), *([] if named else root.findall("actuator"))):
        root.remove(extra)
    for number, body in enumerate(body for body in root.iter("body") if body.find("joint") is not None):
        joint, (path, key, factor, summand) = body.find("joint"), WRONG[id]
        if joint.get("name") == name:
            element = body.find(path)
            element.set(key, planted.numbers(factor * planted.vector(element, key) + summand))
        body.set("name", links[joint.get("name")])
        joint.set("name", joint.get("name") if named else f"axis {number}")
    planted.written_with(".6g")(root)
    return root


@pytest.mark.parametrize("seed", range(12))
def test_in_a_makers_file_the_mistake_is_named_first_and_lost_digits_last(seed: int, tmp_path: Path) -> None:
    text, _ = named_tree(seed)
    (tmp_path / "tree.urdf").write_text(text.replace('"tip"', '"hand"').replace("prismatic", "revolute"), "utf-8")
    scene = fl.import_urdf(tmp_path / "tree.urdf").scene
    chain, id, named = fl.lump(scene), list(WRONG)[seed % len(WRONG)], seed >= len(WRONG)
    name = chain.joint_names[seed % chain.n]
    path = tmp_path / "theirs.xml"
    path.write_text(ET.tostring(by_the_maker(scene, id, name, named), encoding="unicode"), "utf-8")
    found = diagnosed(path, chain, scene=scene)
    assert found.explained and found.findings[0].id == id and f"joint {name!r}" in found.findings[0].what, str(found)
    assert found.findings[-1].id == "digits-lost"
    by_body = [] if named else ["matched-by-body"]
    assert [note.id for note in found.notes] == by_body
    for note in found.notes:
        reviewed("diagnosis: matched by body", note)


def test_findings_are_in_the_order_of_their_effect_on_accelerations(tmp_path: Path) -> None:
    """A rotor of 20 kg m² at one joint matters more than 0.1 % of the base's mass, which comes first in the record."""
    edits = each(of_joint("right"), armature="20"), scaled(".//body/inertial", "mass", 1 + 1e-3, only=0)
    rotor, mass = of_file(tmp_path, "mjcf", planted.both(*edits)).findings
    assert (rotor.id, mass.id) == ("armature-differs", "mass-differs")
    assert rotor.effect > 2 * mass.effect > 0
