"""Every file format stores springs between hinges exactly, and MuJoCo computes their torques within rounding."""

import contextlib
import dataclasses
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.info import _without_structural_damping
from flexlink.engines import load
from flexlink.errors import ArgumentError, DataFileError
from flexlink.formats import FORMATS
from flexlink.formats.mjcf import diagonal_remainder
from flexlink.formats.small_mass import with_small_mass
from tests.chain.test_cells import arm, rule_file
from tests.conftest import ALUMINIUM, SQUARE, flexible, make_scene
from tests.formats.test_reading import EVERY, values_of
from tests.support import planted
from tests.support.words import refused

EPS = np.finfo(float).eps


def odd(chain: fl.Chain, seed: int = 3) -> fl.Chain:
    """A chain with rest angles and coupled dampers of either sign; one damper has no coupled spring."""
    rng, hinges, couplings = np.random.default_rng(seed), chain.hinges.copy(), chain.couplings.copy()
    hinges["rest"] = rng.normal(size=chain.n)
    couplings["damping"] *= rng.uniform(-1, 1, len(couplings))
    couplings["stiffness"][3] = 0.0
    return dataclasses.replace(chain, hinges=hinges, couplings=couplings)


def contents(chain: fl.Chain) -> list[object]:
    return [*values_of(chain), chain.couplings.tolist()]


@EVERY
@pytest.mark.parametrize("p", [2, 3, 4])
@pytest.mark.parametrize("change", [lambda chain: chain, odd], ids=["as made", "odd"])
def test_springs_between_hinges_read_back_exactly(format, p, change, tmp_path) -> None:
    chain = change(fl.lump(arm("xyz", rule_file(tmp_path, p), 2 * p + 1)))
    assert len(chain.couplings) >= 3 * p * (p - 1)
    assert contents(format.read(format.write(chain))) == contents(chain)
    assert contents(format.read(format.write(with_small_mass(chain, mass=1e-3))))[-1] == contents(chain)[-1]


@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
@pytest.mark.parametrize("change", [lambda chain: chain, odd], ids=["as made", "odd"])
def test_mujoco_reads_the_tendons_exactly_and_their_torques_to_4_eps(rule, change, rng) -> None:
    """Errors are relative to |K| (|θ| + |θ₀|), because a tendon length is a difference of lengths of this size."""
    chain = change(fl.lump(arm("xyz", rule, 9)))
    model = load("mujoco", chain).model
    data = mujoco.MjData(model)
    for name, kind in (("stiffness", chain.couplings["stiffness"]), ("damping", chain.couplings["damping"])):
        held = np.sort(getattr(model, f"tendon_{name}"))
        assert held[held > 0].tolist() == np.sort(np.abs(kind[kind != 0])).tolist()
    for _ in range(20):
        q, qd = rng.normal(size=chain.n), rng.normal(size=chain.n)
        data.qpos[:], data.qvel[:] = q, qd
        mujoco.mj_forward(model, data)
        sizes = np.abs(q) + np.abs(chain.rest), np.abs(qd)
        torques = (-data.qfrc_spring, fl.elastic_torque(chain, q)), (-data.qfrc_damper, chain.times("damping", qd))
        for field, size, (theirs, ours) in zip(("stiffness", "damping"), sizes, torques, strict=True):
            assert (np.abs(theirs - ours) <= 4 * EPS * chain.times(field, size, absolute=True)).all()


def test_the_file_of_a_chain_without_coupled_springs_does_not_mention_them() -> None:
    chain = fl.lump(make_scene(flexible("a", "xyz")))
    for format in FORMATS.values():
        text = format.write(chain)
        assert "tendon" not in text and "coupling" not in text and "flexlink.springs" not in text


def assert_springs_of_mujoco(chain: fl.Chain) -> None:
    """Check that MuJoCo reads K and D of the chain: exactly off the diagonal, and on it within rounding."""
    read = load("mujoco", chain).record
    for field, diagonal, others in (
        ("stiffness", read.stiffness, read.coupled_stiffness), ("damping", read.damping, read.coupled_damping)
    ):  # fmt: skip
        i, j = chain.couplings["inner"], chain.couplings["outer"]
        assert others[i, j].tolist() == chain.couplings[field].tolist()
        np.testing.assert_allclose(diagonal, chain.hinges[field], rtol=4 * EPS)


def tapered(segments: int) -> fl.Chain:
    """A link with a 40 mm square at the joint and 8 mm at the tip; EI at the Gauss points of a single cell is 25 to 1.

    The rows of C contain a and b with a² + b² = 14/3 and a b = −1/3, so K_22 ≥ |K_12| only up to a ratio of 13.9.
    """
    small = fl.Section(shape="rectangle", height=0.008, width=0.008)
    link = flexible("a", "z", segments, section_tip="small", lumping="lobatto2")
    parts = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE, "small": small})
    return fl.lump(fl.Scene(name="tapered", arm=parts))


def test_a_cell_that_tendons_cannot_represent_is_refused_and_more_segments_help() -> None:
    chain = tapered(3)
    with refused(ArgumentError, "tendon-stiffness") as caught:
        fl.to_mjcf(chain)
    assert "link 'a'" in str(caught.value) and "\n" not in str(caught.value)
    for format in ("urdf", "sdf"):
        assert contents(FORMATS[format].read(FORMATS[format].write(chain))) == contents(chain)
    fine = tapered(5)
    assert (diagonal_remainder(fine, "stiffness")[fine.bending] > 0).all()
    assert_springs_of_mujoco(fine)


def test_coupled_dampers_have_the_same_limit_as_springs() -> None:
    chain = fl.lump(arm())
    for times, held in ((1.0, True), (1.0 + EPS, False)):
        couplings, hinges = chain.couplings.copy(), chain.hinges.copy()
        i, j = (int(couplings[end][0]) for end in ("inner", "outer"))
        couplings["damping"][0] = -times * chain.damping[i]
        hinges["damping"][j] *= 2
        changed = dataclasses.replace(chain, couplings=couplings, hinges=hinges)
        if held:
            assert diagonal_remainder(changed, "damping")[i] == 0.0
            assert_springs_of_mujoco(changed)
        else:
            with refused(ArgumentError, "tendon-stiffness"):
                fl.to_mjcf(changed)


def edited(form: str, edit: planted.Edit, chain: fl.Chain) -> str:
    root = ET.fromstring(FORMATS[form].write(chain))
    edit(root)
    return ET.tostring(root, encoding="unicode")


URDF, SDF = "flexlink/coupling", ".//{urn:flexlink}coupling"


def first_twice(root: ET.Element) -> None:
    """Two dampers of 4/7 of the joints' own; a cell of `lobatto2` has 1/7."""
    planted.scaled(URDF, "damping", 4.0, only=0)(root)
    root.find("flexlink").append(root.find(URDF))


@pytest.mark.parametrize(
    ("form", "edit", "id"),
    [
        ("urdf", planted.each(URDF, outer="elbow"), "file-content"),
        ("sdf", planted.each(SDF, inner="tip"), "file-content"),
        ("urdf", planted.each(URDF, outer="upper"), "file-content"),
        ("urdf", planted.each(URDF, stiffness="-1e9"), "file-content"),
        ("sdf", planted.each(SDF, damping="1e9"), "file-content"),
        ("urdf", first_twice, "file-content"),
        ("urdf", planted.each(URDF, stiffness="stiff"), "file-content"),
        ("urdf", planted.each(URDF, damping=None), "file-content"),
    ],
)
def test_contradictions_in_a_file_are_refused_by_name(form: str, edit: planted.Edit, id: str) -> None:
    with refused(DataFileError, id):
        FORMATS[form].read(edited(form, edit, fl.lump(arm())))


@pytest.mark.parametrize("share", [1.9, 2.1])
def test_a_coupling_is_at_most_the_geometric_mean_of_the_springs_of_both_joints(share: float) -> None:
    chain = fl.lump(arm())
    hinges, couplings = chain.hinges.copy(), chain.couplings.copy()
    i, j = (int(couplings[end][0]) for end in ("inner", "outer"))
    hinges["stiffness"][j] = 4 * hinges["stiffness"][i]
    couplings["stiffness"][0] = share * hinges["stiffness"][i]
    text = fl.to_urdf(dataclasses.replace(chain, hinges=hinges, couplings=couplings))
    with contextlib.nullcontext() if share < 2 else refused(DataFileError, "file-content", values=False):
        assert FORMATS["urdf"].read(text).couplings.tolist() == couplings.tolist()


@pytest.mark.parametrize(("form", "path"), [("urdf", URDF), ("sdf", SDF)])
def test_an_edited_spring_stiffness_in_a_file_changes_the_chain(form: str, path: str) -> None:
    chain = fl.lump(arm())
    read = FORMATS[form].read(edited(form, planted.scaled(path, "stiffness", 0.5), chain))
    assert read.couplings["stiffness"].tolist() == (chain.couplings["stiffness"] / 2).tolist()
    assert read.hinges.tolist() == chain.hinges.tolist()


def test_a_chain_without_structural_damping_has_no_coupled_dampers() -> None:
    chain = fl.lump(arm())
    bare = _without_structural_damping(chain)
    assert chain.couplings["damping"].any() and not bare.couplings["damping"].any()
    assert bare.couplings["stiffness"].tolist() == chain.couplings["stiffness"].tolist()
