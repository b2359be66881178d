"""Other engines agree on springs between hinges, and a mistake in a file is reported with the joints concerned."""

import dataclasses
import importlib
import re
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import flexlink as fl
from flexlink.diagnosis.diagnosis import LARGEST, Diagnosis
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.engines import ENGINES
from flexlink.scene_report.parts import agreement
from flexlink.scene_report.study import Study
from tests.chain.test_cells import DAMPED, arm
from tests.conftest import flexible, make_scene
from tests.diagnosis.test_their_files import check_only_named, diagnosed, drake, labels, plain_urdf, written
from tests.engines.test_engines import engine
from tests.support import planted
from tests.support.planted import each, scaled
from tests.support.words import line, reviewed

SCENE = arm("xyz", "lobatto2", 5)
CHAIN = fl.lump(SCENE)
PAIR = tuple(CHAIN.joint_name(int(CHAIN.couplings[end][1])) for end in ("inner", "outer"))
NAMES = r"{!r} \w+ {!r}".format(*PAIR)


def with_coupling(chain: fl.Chain, field: str, factor: float) -> fl.Chain:
    couplings = chain.couplings.copy()
    couplings[field][1] *= factor
    return dataclasses.replace(chain, couplings=couplings)


FAULTS = {
    "stiffness": ("stiffness", 1 + 1e-9, "N m/rad", "1e-09"),
    "sign": ("stiffness", -1.0, "N m/rad", "-1"),
    "damper": ("damping", 1.5, "N m s/rad", "1.5"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    ("name", "export"), [engine("pinocchio", "to_urdf"), engine("mujoco", "to_mjcf"), engine("exudyn", "to_urdf")]
)
def test_a_wrong_coupled_spring_in_an_engine_file_is_reported(name: str, export: str, fault: str, monkeypatch) -> None:
    field, factor, unit, shown = FAULTS[fault]
    module = importlib.import_module(ENGINES[name].module)
    write = getattr(module, export)
    monkeypatch.setattr(module, export, lambda chain, **how: write(with_coupling(chain, field, factor), **how))
    found = fl.compare(SCENE, engines=[name], samples=8)
    (diagnosis,) = found.diagnoses
    (finding,) = diagnosis.findings
    assert not found.passed and diagnosis.explained, found.diagnosis
    reviewed(f"diagnosis: {fault} between joints", line(found.diagnosis, "1. "), values=False)
    assert re.match(rf"{labels(f'coupled_{field}')} {NAMES}: .*{unit}\b.* {shown}$", finding.what)
    assert {"stiffness": "T_FL", "damping": "T_FR"}[field] in finding.affects


TENDON, END = "tendon/fixed", "tendon/fixed/joint"
URDF, SDF = "flexlink/coupling", ".//{urn:flexlink}coupling"


def sign_of_one(root: ET.Element) -> None:
    one = root.findall(TENDON)[1][1]
    one.set("coef", str(-float(one.attrib["coef"])))


def one_gone(root: ET.Element) -> None:
    parent = root.find("tendon")
    parent.remove(parent[1])


def all_gone(root: ET.Element) -> None:
    for parent, path in ((root, "tendon"), (root.find("flexlink") or root, "coupling")):
        for element in parent.findall(path):
            parent.remove(element)


def rope(count: int, **attributes: str) -> planted.Edit:
    def edit(root: ET.Element) -> None:
        names = [joint.attrib["name"] for joint in root.iter("joint") if "name" in joint.attrib]
        tendon = ET.SubElement(root.find("tendon"), "fixed", {"name": "rope", "stiffness": "3.0"} | attributes)
        for name in names[1 : 1 + count]:
            ET.SubElement(tendon, "joint", joint=name, coef="2")

    return edit


def each_rope(**attributes: str) -> planted.Edit:
    """A tendon between two joints that adds a constraint, not only a spring."""
    return planted.both(rope(2, **attributes), planted.flag("constraint", "limit", "frictionloss"), without_friction)


def without_friction(root: ET.Element) -> None:
    for joint in root.iterfind(".//body/joint"):
        joint.attrib.pop("frictionloss", None)


def one_twice(root: ET.Element) -> None:
    own = root.find("flexlink")
    ET.SubElement(own, "coupling", dict(own[1].attrib) | {"damping": "0"})


STIFFNESS, DAMPING = (f"{labels(f'coupled_{field}')} {NAMES}: " for field in ("stiffness", "damping"))
NAMED = [
    ("mjcf", "one stiffness", scaled(TENDON, "stiffness", 1.5, only=1), STIFFNESS),
    ("mjcf", "one sign", sign_of_one, rf"{STIFFNESS}.*T_FL, T_FR, q̈;.*{NAMES}"),
    ("mjcf", "one damper", scaled(TENDON, "damping", 2.0, only=1), DAMPING),
    ("mjcf", "one left out", one_gone, rf"T_FL, T_FR, q̈;.*{NAMES}.*<fixed"),
    ("mjcf", "all left out", all_gone, r"stiffness \D+ 9 "),
    ("mjcf", "per degree", scaled(TENDON, "stiffness", planted.PER_DEGREE), "stiffness"),
    ("mjcf", "one too many", rope(2), r": 12 \D+ 0 N m/rad: "),
    ("mjcf", "over three joints", rope(3), "'rope'"),
    ("mjcf", "over one joint", rope(1), "'rope'"),
    ("mjcf", "slack over a range", rope(2, springlength="-1 1"), "'rope'"),
    ("mjcf", "stiffer and stiffer", rope(2, stiffness="0 0 5"), "'rope'"),
    ("mjcf", "with inertia", each_rope(armature="0.1"), "'rope'"),
    ("mjcf", "with dry friction", each_rope(frictionloss="0.1"), "'rope'"),
    ("mjcf", "with a limit", each_rope(limited="true", range="-0.1 0.1"), "'rope'"),
    ("mjcf", "springs disabled", each("option/flag", spring="disable"), "springs"),
    ("mjcf", "dampers disabled", each("option/flag", damper="disable"), "dampers"),
    ("mjcf", "a joint's own", scaled(".//joint", "stiffness", 2, only=1), r"stiffness of joint 'upper\.1\.x': "),
    ("mjcf", "6 digits", planted.written_with(".6g"), r" [67] digits"),
    ("mjcf", "hinges in another order", planted.hinges_reversed, "order"),
    ("mjcf", "elsewhere slack", each(TENDON, springlength="0.1"), "tendons.*springlength"),
    ("urdf", "one stiffness", scaled(URDF, "stiffness", 1.5, only=1), rf"<coupling stiffness> .*{NAMES}"),
    ("urdf", "one sign", scaled(URDF, "stiffness", -1, only=1), STIFFNESS),
    ("urdf", "one damper", scaled(URDF, "damping", 0, only=1), f"{DAMPING}0 "),
    ("urdf", "one twice", one_twice, rf"{STIFFNESS}.*N m/rad\D* 2\b"),
    ("urdf", "all left out", all_gone, r"stiffness \D+ 9 "),
    ("sdf", "one stiffness", scaled(SDF, "stiffness", 1.5, only=1), rf"<flexlink:coupling stiffness> .*{NAMES}"),
    ("sdf", "one damper", scaled(SDF, "damping", -1, only=1), DAMPING),
]


def of_file(folder: Path, form: str, edit: planted.Edit | None, chain: fl.Chain = CHAIN) -> Diagnosis:
    return diagnosed(written(folder, form, edit, chain), chain)


@pytest.mark.parametrize(
    ("form", "mistake", "edit", "named"),
    [
        pytest.param(form, mistake, edit, named, id=f"{form}, {mistake}", marks=drake if form == "sdf" else ())
        for form, mistake, edit, named in NAMED
    ],
)
def test_only_the_planted_mistake_is_reported_and_it_explains_all_differences(
    form: str, mistake: str, edit: planted.Edit, named: str, tmp_path: Path
) -> None:
    """The finding contains the names and values that `named` requires."""
    found = of_file(tmp_path, form, edit)
    check_only_named(found, named, f"diagnosis, {form}: {mistake}, springs between joints")
    assert not found.passed


def other_coefficients(root: ET.Element) -> None:
    """Halving the tendon length requires four times the stiffness."""
    for tendon in root.findall(TENDON):
        for name in ("stiffness", "damping"):
            tendon.set(name, repr(4 * float(tendon.attrib[name])))
        for end in tendon:
            end.set("coef", repr(-0.5 * float(end.attrib["coef"])))


def other_way_round(root: ET.Element) -> None:
    for tendon in root.findall(TENDON):
        tendon[:] = tendon[::-1]
    root.find("tendon")[:] = root.find("tendon")[::-1]


def unnamed(root: ET.Element) -> None:
    planted.without_motors(root)
    names = {joint.attrib["name"]: f"dof{k}" for k, joint in enumerate(root.iterfind(".//body/joint"))}
    for joint in root.iter("joint"):
        for key in ("name", "joint"):
            if key in joint.attrib:
                joint.set(key, names[joint.attrib[key]])


def slack_lengths(root: ET.Element) -> None:
    """The slack length is given as a number instead of being computed by MuJoCo."""
    rest = {joint.attrib["name"]: float(joint.attrib["springref"]) for joint in root.iterfind(".//body/joint")}
    for tendon in root.findall(TENDON):
        length = sum(float(end.attrib["coef"]) * rest[end.attrib["joint"]] for end in tendon)
        tendon.set("springlength", repr(length))


@pytest.mark.parametrize("edit", [None, other_coefficients, other_way_round, unnamed, slack_lengths])
@pytest.mark.parametrize("rest", [0.0, 0.1])
def test_equivalent_notations_of_the_same_springs_pass(edit, rest, tmp_path) -> None:
    hinges = CHAIN.hinges.copy()
    hinges["rest"][CHAIN.stiffness > 0] = rest * np.arange(1, len(CHAIN.bending) + 1)
    found = of_file(tmp_path, "mjcf", edit, dataclasses.replace(CHAIN, hinges=hinges))
    assert found.passed and not found.findings, str(found)


def plain_sdf(root: ET.Element) -> None:
    for element in root.iter():
        for name in [name for name in element.attrib if name.startswith("{urn:flexlink}")]:
            if name != "{urn:flexlink}rotation":
                del element.attrib[name]
        for own in element.findall("{urn:flexlink}coupling"):
            element.remove(own)


@pytest.mark.parametrize(("form", "edit"), [("urdf", plain_urdf), pytest.param("sdf", plain_sdf, marks=drake)])
def test_data_that_a_plain_file_cannot_contain_are_taken_from_the_scene_and_noted(form, edit, tmp_path) -> None:
    found = of_file(tmp_path, form, edit)
    assert found.passed and not found.findings, str(found)
    computed, taken = found.notes[:2]
    reviewed("diagnosis: springs between joints computed by flexlink", computed)
    reviewed("diagnosis: taken from the scene", taken)
    assert taken.endswith(labels("coupled_stiffness", "coupled_damping"))


def test_mujoco_takes_data_that_a_urdf_cannot_contain_from_the_scene(tmp_path: Path) -> None:
    chain = fl.lump(make_scene(flexible("a", "z", 5, lumping="lobatto4", damping=DAMPED)))
    found = diagnosed(written(tmp_path, "urdf", plain_urdf, chain), chain, "mujoco")
    assert found.passed and not found.findings, str(found)


def test_unrelated_tendons_are_reported_and_then_ignored(tmp_path: Path) -> None:
    found = of_file(tmp_path, "mjcf", planted.both(rope(3), scaled(TENDON, "stiffness", 1.5, only=1)))
    assert len(found.findings) == 2 and found.explained, str(found)


def test_the_largest_stable_step_includes_dampers_between_joints() -> None:
    """Semi-implicit Euler is stable up to 4/(d + √(d² + 4 ω²)) for every mode, with d = φᵀ D φ."""
    chain = fl.lump(make_scene(flexible("a", "z", 5, lumping="lobatto4", damping=fl.Damping(ratio=0.5, at_hz=100.0))))
    q = chain.slightly_bent
    M, K = fl.mass_matrix(chain, q), stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    square, φ = np.linalg.eigh(np.linalg.solve(L := np.linalg.cholesky(M), np.linalg.solve(L, (K + K.T) / 2).T))
    φ = np.linalg.solve(L.T, φ)
    d = np.diag(φ.T @ chain.matrix("damping") @ φ)
    largest = 4 / (d + np.sqrt(d**2 + 4 * np.abs(square))).max()
    found = LARGEST["Euler without eulerdamp"](chain)
    assert found == pytest.approx(largest, rel=1e-9)


@pytest.mark.skipif(find_spec("pinocchio") is None, reason="needs Pinocchio")
def test_a_report_shows_which_engine_computes_springs_between_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: ENGINES[name] for name in ("native", "pinocchio", "mujoco")}
    monkeypatch.setattr(agreement, "ENGINES", few)
    study, bare = Study(SCENE), Study(make_scene(flexible("a")))
    notes = {note: each.engine for each in agreement._diagnoses(study)[0] for note in each.notes}
    assert list(notes.values()) == ["pinocchio"]
    (text,) = (text for text in agreement.made(study).sentences if any(note in text for note in notes))
    reviewed("report: springs between joints", text)
    assert not any(note in text for text in agreement.made(bare).sentences for note in notes)
