"""Springs between hinges in other engines: all agree, and what is wrong with one of them in a file is named."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import planted
import pytest
from conftest import flexible, make_scene
from planted import each, scaled
from test_cells import DAMPED, arm
from test_coupled_files import odd
from test_engines import METHOD, engine, rounding_bound
from test_their_files import diagnosed, drake, plain_urdf, written

import flexlink as fl
from flexlink.diagnosis.diagnosis import Diagnosis
from flexlink.diagnosis.quantities import QUANTITIES
from flexlink.diagnosis.stable_steps import LARGEST, _bent
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.engines import ENGINES, load
from flexlink.engines.read_back import of_chain, to_chain
from flexlink.scene_report.parts import agreement
from flexlink.scene_report.study import Study

SCENE = arm("xyz", "lobatto2", 5)
CHAIN = fl.lump(SCENE)
PAIR = tuple(CHAIN.joint_name(int(CHAIN.couplings[end][1])) for end in ("inner", "outer"))
BETWEEN = f"between joints {PAIR[0]!r} and {PAIR[1]!r}"
every = pytest.mark.parametrize("name", [engine(name) for name in ENGINES if name != "native"])


@every
@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_all_engines_agree_on_an_arm_of_cells(name: str, rule: str) -> None:
    found = fl.compare(arm("xyz", rule, 5), engines=[name], samples=40)
    assert found.passed and [row.quantity for row in found.rows] == list(QUANTITIES), str(found)
    by_us = {"pinocchio", "drake"}
    assert ("between two joints are computed by us" in found.diagnosis) is (name in by_us)


@every
def test_they_agree_with_rest_angles_too(name: str, rng: np.random.Generator) -> None:
    hinges = CHAIN.hinges.copy()
    hinges["rest"] = rng.normal(size=CHAIN.n)
    chain = dataclasses.replace(CHAIN, hinges=hinges)
    native, other = load("native", chain), load(name, chain)
    for q in (chain.rest, rng.normal(size=chain.n)):
        zero = np.zeros(chain.n)
        size = chain.times("stiffness", np.abs(q - chain.rest), absolute=True)
        assert (np.abs(other.elastic_torque(q) - native.elastic_torque(q)) <= 1e-14 * size).all()
        assert (other.friction_torque(zero) == 0).all()


@every
def test_short_motions_differ_by_rounding_only(name: str) -> None:
    run = fl.RunSettings(method=METHOD.get(name, "RK4"), step=5e-6, sample=1e-4, duration=2e-3)
    scene = arm("xyz", "lobatto2", 3, run=run).varied({"initial.rate_deg": (100.0, 300.0)})
    (_, q, _), (_, other, _) = (load(each_one, fl.lump(scene)).integrate(scene) for each_one in ("native", name))
    bound = rounding_bound(scene)
    assert bound < 1e-9 and np.abs(q - q[0]).max() > 1e-4  # it moves, by much more than the bound
    assert np.abs(other - q).max() <= bound


def test_a_record_is_the_chain_again() -> None:
    chain = odd(CHAIN)
    again = to_chain(of_chain(chain), chain)
    for field in ("stiffness", "damping"):
        assert (again.matrix(field) == chain.matrix(field)).all()


def with_coupling(chain: fl.Chain, field: str, factor: float) -> fl.Chain:
    couplings = chain.couplings.copy()
    couplings[field][1] *= factor
    return dataclasses.replace(chain, couplings=couplings)


FAULTS = {
    "stiffness": ("stiffness", 1 + 1e-9, "spring stiffness {}: ", "N m/rad, relative error 1e-09: another value"),
    "sign": ("stiffness", -1.0, "spring stiffness {}: ", "N m/rad, factor -1: the wrong sign"),
    "damper": ("damping", 1.5, "damping {}: ", "N m s/rad, factor 1.5: another value"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    ("name", "export"), [engine("pinocchio", "to_urdf"), engine("mujoco", "to_mjcf"), engine("exudyn", "to_urdf")]
)
def test_what_is_wrong_between_two_joints_of_an_engine_s_file_is_named(
    name: str, export: str, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    field, factor, begin, end = FAULTS[fault]
    module = importlib.import_module(ENGINES[name].module)
    write = getattr(module, export)
    monkeypatch.setattr(module, export, lambda chain, **how: write(with_coupling(chain, field, factor), **how))
    found = fl.compare(SCENE, engines=[name], samples=8)
    text = found.diagnosis
    assert not found.passed and f"1. {begin.format(BETWEEN)}" in text and end in text and "  2. " not in text, text
    assert "With this fixed the models agree" in text
    torque = {"stiffness": "T_FL", "damping": "T_FR"}[field]
    assert f"affects {torque}" in text


# Files of others.

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
    """A rope between two joints that does more than a spring, where constraints act."""
    return planted.both(rope(2, **attributes), planted.flag("constraint", "limit", "frictionloss"), without_friction)


def without_friction(root: ET.Element) -> None:
    for joint in root.iterfind(".//body/joint"):
        joint.attrib.pop("frictionloss", None)


def one_twice(root: ET.Element) -> None:
    own = root.find("flexlink")
    ET.SubElement(own, "coupling", dict(own[1].attrib) | {"damping": "0"})


NOT_BETWEEN_TWO = "tendons that are not linear springs between two joints apply forces: 'rope'"
NAMED = [
    ("mjcf", "one stiffness", scaled(TENDON, "stiffness", 1.5, only=1), f"spring stiffness {BETWEEN}: "),
    ("mjcf", "one sign", sign_of_one, f"spring stiffness {BETWEEN}: "),
    ("mjcf", "one sign, in words", sign_of_one, f"the wrong sign; affects T_FL, T_FR, q̈; change its sign {BETWEEN}"),
    ("mjcf", "one damper", scaled(TENDON, "damping", 2.0, only=1), f"damping {BETWEEN}: "),
    ("mjcf", "one left out", one_gone, f"missing; affects T_FL, T_FR, q̈; add it {BETWEEN}, in MJCF as a <fixed>"),
    ("mjcf", "all left out", all_gone, "spring stiffness between 9 pairs of joints ("),
    ("mjcf", "per degree", scaled(TENDON, "stiffness", planted.PER_DEGREE), "degrees taken for radians"),
    ("mjcf", "one too many", rope(2), "12 instead of 0 N m/rad: added where there is none"),
    ("mjcf", "over three joints", rope(3), NOT_BETWEEN_TWO),
    ("mjcf", "over one joint", rope(1), NOT_BETWEEN_TWO),
    ("mjcf", "slack over a range", rope(2, springlength="-1 1"), NOT_BETWEEN_TWO),
    ("mjcf", "stiffer and stiffer", rope(2, stiffness="0 0 5"), NOT_BETWEEN_TWO),
    ("mjcf", "with inertia", each_rope(armature="0.1"), NOT_BETWEEN_TWO),
    ("mjcf", "with dry friction", each_rope(frictionloss="0.1"), NOT_BETWEEN_TWO),
    ("mjcf", "with a limit", each_rope(limited="true", range="-0.1 0.1"), NOT_BETWEEN_TWO),
    ("mjcf", "springs disabled", each("option/flag", spring="disable"), "a flag disables springs"),
    ("mjcf", "dampers disabled", each("option/flag", damper="disable"), "a flag disables dampers"),
    ("mjcf", "a joint's own", scaled(".//joint", "stiffness", 2, only=1), "spring stiffness of joint 'upper.1.x': "),
    ("mjcf", "6 digits", planted.written_with(".6g"), "digits were lost"),
    ("mjcf", "hinges in another order", planted.hinges_reversed, "in another order along the chain"),
    ("mjcf", "elsewhere slack", each(TENDON, springlength="0.1"), "tendons are slack elsewhere than the springs"),
    ("urdf", "one stiffness", scaled(URDF, "stiffness", 1.5, only=1), f"correct <coupling stiffness> {BETWEEN}"),
    ("urdf", "one sign", scaled(URDF, "stiffness", -1, only=1), "the wrong sign"),
    ("urdf", "one damper", scaled(URDF, "damping", 0, only=1), f"damping {BETWEEN}: 0 instead of "),
    ("urdf", "one twice", one_twice, "N m/rad, factor 2: another value"),
    ("urdf", "all left out", all_gone, "spring stiffness between 9 pairs of joints ("),
    ("sdf", "one stiffness", scaled(SDF, "stiffness", 1.5, only=1), f"<flexlink:coupling stiffness> {BETWEEN}"),
    ("sdf", "one damper", scaled(SDF, "damping", -1, only=1), f"damping {BETWEEN}: "),
]


def of_file(folder: Path, form: str, edit: planted.Edit | None, chain: fl.Chain = CHAIN) -> Diagnosis:
    return diagnosed(written(folder, form, edit, chain), chain)


@pytest.mark.parametrize(
    ("form", "edit", "named"),
    [
        pytest.param(form, edit, named, id=f"{form}, {mistake}", marks=drake if form == "sdf" else ())
        for form, mistake, edit, named in NAMED
    ],
)
def test_a_planted_mistake_is_the_only_one_named_and_explains_all_that_differs(
    form: str, edit: planted.Edit, named: str, tmp_path: Path
) -> None:
    found = of_file(tmp_path, form, edit)
    (finding,) = found.findings
    assert named in str(finding), str(found)
    assert found.explained and not found.passed
    if finding.faulty is not None:
        assert {row.quantity for row in found.rows if not row.passed} <= set(finding.affects)


def other_coefficients(root: ET.Element) -> None:
    """Half a length has four times the stiffness."""
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
    """Said by number instead of left to MuJoCo."""
    rest = {joint.attrib["name"]: float(joint.attrib["springref"]) for joint in root.iterfind(".//body/joint")}
    for tendon in root.findall(TENDON):
        length = sum(float(end.attrib["coef"]) * rest[end.attrib["joint"]] for end in tendon)
        tendon.set("springlength", repr(length))


@pytest.mark.parametrize("edit", [None, other_coefficients, other_way_round, unnamed, slack_lengths])
@pytest.mark.parametrize("rest", [0.0, 0.1])
def test_the_same_springs_in_other_words_are_right(
    edit: Callable[[ET.Element], None] | None, rest: float, tmp_path: Path
) -> None:
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
def test_what_a_plain_file_cannot_say_is_taken_from_the_scene_and_told(
    form: str, edit: planted.Edit, tmp_path: Path
) -> None:
    found = of_file(tmp_path, form, edit)
    assert found.passed and not found.findings, str(found)
    assert found.notes[0].startswith("springs and dampers between two joints are computed by us")
    assert found.notes[1].endswith("spring stiffness between joints, damping between joints")


def test_mujoco_takes_from_the_scene_what_a_urdf_does_not_say(tmp_path: Path) -> None:
    chain = fl.lump(make_scene(flexible("a", "z", 5, lumping="lobatto4", damping=DAMPED)))
    found = diagnosed(written(tmp_path, "urdf", plain_urdf, chain), chain, "mujoco")
    assert found.passed and not found.findings, str(found)


def test_other_tendons_do_nothing_once_they_are_named(tmp_path: Path) -> None:
    found = of_file(tmp_path, "mjcf", planted.both(rope(3), scaled(TENDON, "stiffness", 1.5, only=1)))
    assert len(found.findings) == 2 and found.explained, str(found)


def test_the_largest_step_counts_dampers_between_joints() -> None:
    """Semi-implicit Euler is stable to 4/(d + √(d² + 4 ω²)) of every mode, d of φᵀ D φ."""
    chain = fl.lump(make_scene(flexible("a", "z", 5, lumping="lobatto4", damping=fl.Damping(ratio=0.5, at_hz=100.0))))
    q = _bent(chain)
    M, K = fl.mass_matrix(chain, q), stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    square, φ = np.linalg.eigh(np.linalg.solve(L := np.linalg.cholesky(M), np.linalg.solve(L, (K + K.T) / 2).T))
    φ = np.linalg.solve(L.T, φ)
    d = np.diag(φ.T @ chain.matrix("damping") @ φ)
    largest = 4 / (d + np.sqrt(d**2 + 4 * np.abs(square))).max()
    assert LARGEST["Euler without eulerdamp"](chain) == pytest.approx(largest, rel=1e-9)


@pytest.mark.skipif(find_spec("pinocchio") is None, reason="needs Pinocchio")
def test_a_report_says_who_computes_springs_between_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: ENGINES[name] for name in ("native", "pinocchio", "mujoco")}
    monkeypatch.setattr(agreement, "ENGINES", few)
    for scene, told in ((SCENE, True), (make_scene(flexible("a")), False)):
        study = Study(scene)
        diagnoses, _ = agreement._diagnoses(study)
        words = "Springs and dampers between two joints are their own in MuJoCo and computed by us in Pinocchio."
        assert agreement._between_joints(study, diagnoses) == (words if told else "")
