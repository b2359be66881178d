"""Inertias that no real body has are used as given, with a note, wherever the mass matrix is positive."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.common.errors import DataFileError, SceneError
from flexlink.dynamics.notes import notes
from flexlink.formats.sdf import read_sdf
from flexlink.formats.urdf import read_urdf
from tests.support.urdf_texts import saved, words
from tests.support.words import line, reviewed

ID = "inertia-of-no-body"
PUMA = {  # Corke & Armstrong-Hélouvry 1994: a, α, d [m, °, m], mass [kg], centre [m] and moments [kg m²] in frame i
    "waist": (0.0, 90, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.35, 0.0)),
    "upper": (0.4318, 0, 0.0, 17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539)),
    "fore": (0.0203, -90, 0.15005, 4.8, (-0.0203, -0.0141, 0.07), (0.066, 0.086, 0.0125)),
    "roll": (0.0, 90, 0.4318, 0.82, (0.0, 0.019, 0.0), (1.8e-3, 1.3e-3, 1.8e-3)),
    "pitch": (0.0, -90, 0.0, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.4e-3, 0.3e-3)),
    "flange": (0.0, 0, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
}


def link(name: str, mass: float, center: object, moments: tuple[float, ...], rpy: tuple[float, ...] = (0, 0, 0)) -> str:
    keys = dict(zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), (*moments, 0, 0, 0), strict=False))
    tensor = "".join(f' {key}="{value}"' for key, value in keys.items())
    place = f'<origin xyz="{words(np.array(center))}" rpy="{words(np.array(rpy))}"/>'
    return f'<link name="{name}"><inertial>{place}<mass value="{mass}"/><inertia{tensor}/></inertial></link>'


def joint(parent: str, child: str, xyz: object = (0, 0, 0), rpy: object = (0, 0, 0)) -> str:
    place = f'<origin xyz="{words(np.array(xyz))}" rpy="{words(np.array(rpy))}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
    return f'<joint name="to_{child}" type="continuous">{place}{ends}</joint>'


def written(tmp_path: Path, *parts: str) -> Path:
    path = saved(tmp_path, f'<robot name="robot"><link name="base"/>{"".join(parts)}</robot>')
    return path


def test_the_puma_has_its_published_torques(tmp_path: Path) -> None:
    """The forearm of the consensus set, (0.066, 0.086, 0.0125) kg m², is no real body."""
    parts, parent, place = [], "base", ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for name, (a, α, d, mass, center, moments) in PUMA.items():
        turn = (np.radians(α), 0.0, 0.0)
        there = np.array([a, 0.0, d]) + Rotation.from_euler("xyz", turn).apply(center)
        parts += [joint(parent, name, *place), link(name, mass, there, moments, turn)]
        parent, place = name, ((a, 0.0, d), turn)
    found = fl.import_urdf(written(tmp_path, *parts))
    chain, zero = fl.lump(found.scene), np.zeros(6)
    nominal = np.array([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    assert fl.bias_torque(chain, nominal, zero) == pytest.approx([0, 31.6399, 6.0351, 0, 0.0283, 0], abs=5e-5)
    assert fl.bias_torque(chain, zero, zero) == pytest.approx([0, 37.4837, 0.2489, 0, 0, 0], abs=5e-5)
    reviewed(ID, line("\n".join(found.warnings), "link.fore.hub.inertia"))


def test_moments_about_the_axes_alone_are_enough(tmp_path: Path) -> None:
    """KUKA gives (0, 0, I) for the first link, published planar models for all. Truth: parallel axes, by hand."""
    J, m, c, L = 0.004, 0.3, 0.2, 0.4
    parts = [joint("base", "a"), link("a", m, (c, 0, 0), (0, 0, J)), joint("a", "b", (L, 0, 0))]
    found = fl.import_urdf(written(tmp_path, *parts, link("b", m, (c, 0, 0), (0, 0, J))))
    near, far = J + m * c**2, J + m * c * (L + c)
    whole = 2 * J + m * c**2 + m * (L + c) ** 2
    assert fl.mass_matrix(fl.lump(found.scene), [0, 0]) == pytest.approx(np.array([[whole, far], [far, near]]))
    assert [warning.id for warning in found.warnings] == [ID] * 2


@pytest.mark.parametrize("digits", [3, 6, 12])
def test_printed_plates_and_rods_are_bodies_with_a_note(digits: int, rng) -> None:
    """Each turns about an axis across it; the truth is the moment of the printed numbers."""
    for axis in rng.normal(size=(20, 3)):
        u = np.cross(axis, rng.normal(size=3))
        rod = (u @ u * np.eye(3) - np.outer(u, u)) / 12
        plate = np.diag([u[0] ** 2, u[1] ** 2, u[0] ** 2 + u[1] ** 2]) / 12
        for moments in (plate, rod):
            printed = [float(f"{x:.{digits}g}") for x in moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]]
            body = fl.RigidBody(mass=1.0, inertia=tuple(printed))
            link = fl.Link(name="a", joint=fl.Joint(axis=tuple(axis)), hub=body)
            scene = fl.Scene(name="one", arm=fl.Arm(links=(link,)))
            truth = axis @ body.matrix @ axis / (axis @ axis)
            assert fl.mass_matrix(fl.lump(scene), [0.0])[0, 0] == pytest.approx(truth, rel=1e-12)
            told = [note for note in notes(scene) if note.id == ID]
            assert len(told) == (body.excess > 0)
            stated = [int(re.search(r"about (\d+) digits", note)[1]) for note in told if digits > 3]
            assert all(digits - 1 <= number <= digits + 2 for number in stated)


def accepted(scene: fl.Scene) -> bool:
    try:
        return fl.lump(scene).n > 0
    except SceneError as error:
        assert error.id == "inertia-impossible"
        return False


def test_an_indefinite_mass_matrix_is_refused_and_a_positive_one_is_not(rng) -> None:
    """Two links in a plane: M₁₁ = J₁ + J₂ + m (L² + c² + 2 L c cos q), M₁₂ = J₂ + m (c² + L c cos q), M₂₂ = …"""
    m, c, L, results = 1.0, 0.3, 0.5, []
    for J in rng.uniform(-0.3, 0.1, (60, 2)):
        cos = np.linspace(-1, 1, 200)
        M22, M12 = J[1] + m * c * c, J[1] + m * (c * c + L * c * cos)
        M11 = J.sum() + m * (L * L + c * c + 2 * L * c * cos)
        first = fl.Link(name="a", hub=fl.RigidBody(inertia=(0, 0, J[0])))
        body = fl.RigidBody(mass=m, center=(c, 0, 0), inertia=(0, 0, J[1]))
        second = fl.Link(name="b", mount=fl.Mount(xyz=(L, 0, 0)), hub=body)
        least = min(M22, (M11 * M22 - M12**2).min())
        if abs(least) > 1e-3:
            results.append((accepted(fl.Scene(name="two", arm=fl.Arm(links=(first, second)))), bool(least > 0)))
    assert all(ours == truth for ours, truth in results)
    assert {truth for _, truth in results} == {True, False}


def test_only_postures_inside_the_limits_count() -> None:
    """Here the elbow folds the outer mass back over the first joint, and M is negative beyond 120°."""
    first = fl.Link(name="a", hub=fl.RigidBody(inertia=(0, 0, -0.3)))
    point, there = fl.RigidBody(mass=1.0, center=(0.5, 0, 0)), fl.Mount(xyz=(0.5, 0, 0))
    near, far = (fl.Joint(armature=5.0, limits_deg=(-limit, limit)) for limit in (30.0, 170.0))
    scene = fl.Scene(name="fold", arm=fl.Arm(links=(first, fl.Link(name="b", mount=there, joint=near, hub=point))))
    assert accepted(scene)
    assert not accepted(scene.varied({"link.b.joint": far}))


def test_an_odd_body_survives_export_and_an_impossible_edit_does_not() -> None:
    body = fl.RigidBody(mass=1.0, center=(0.7, 0.0, 0.0), inertia=(1.0, 1.0, -0.2))
    chain = fl.lump(fl.Scene(name="one", arm=fl.Arm(links=(fl.Link(name="a", hub=body),))))
    for write, read in ((fl.to_urdf, read_urdf), (fl.to_sdf, read_sdf)):
        assert fl.mass_matrix(read(write(chain)), [0.0])[0, 0] == pytest.approx(0.49 - 0.2)
        with pytest.raises(DataFileError):
            read(write(chain).replace("-0.2", "-0.9"))


def test_any_inertia_of_a_body_that_only_slides_is_accepted(tmp_path: Path) -> None:
    slide, tool = joint("base", "a").replace("continuous", "prismatic"), joint("a", "b", (1, 0, 0))
    parts = slide, link("a", 3.0, (0, 0, 0), (-1, -1, -1)), tool.replace("continuous", "fixed"), '<link name="b"/>'
    assert fl.mass_matrix(fl.lump(fl.import_urdf(written(tmp_path, *parts)).scene), [0.0]) == 3.0
