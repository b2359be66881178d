"""Keys of a scene without effect are noted; those with an effect are not."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial
from numpy.polynomial.legendre import leggauss
from scipy.linalg import eigh

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.wording import id_of
from flexlink.dynamics.notes import defaults, notes
from tests.conftest import ALUMINIUM, MODELS, flexible, make_scene
from tests.support.words import reviewed

STILL = make_scene(fl.Link(name="a"), flexible("b"))
"""All axes are parallel to z, as is the default gravity."""

UPRIGHT = fl.Mount(rpy_deg=(-90.0, 0.0, 0.0))


def test_gravity_parallel_to_all_axes_is_noted() -> None:
    (note,) = notes(STILL)
    assert note.startswith(f"gravity = {[0.0, 0.0, 9.81]}: ")
    check_no_effect(note)
    chain = fl.lump(STILL)
    q = np.linspace(0.1, 0.9, chain.n)
    assert not fl.gravity_torque(chain, q).any()
    for size in (-1e-300, 1e308):
        assert len(notes(STILL.varied({"gravity": (0.0, 0.0, size)}))) == 1


def check_no_effect(note: str) -> None:
    """Check that there is one note, that the key has no effect, and compare its text with the reviewed one."""
    assert (getattr(note, "id", "") or "no-effect") == "no-effect"
    reviewed("no-effect", note)


def test_drag_without_air_is_noted() -> None:
    dragged = make_scene(fl.Link(name="a"), flexible("b", drag=fl.Drag(coefficient=1.2)), gravity=(0.0, 9.81, 0.0))
    (note,) = notes(dragged)
    check_no_effect(note)
    assert not notes(dragged.varied({"air_density": 1.2}))


def test_gravity_along_a_mounted_axis_is_noted_within_rounding() -> None:
    turned = fl.Mount(rpy_deg=(33.0, 12.0, 5.0))
    axis = fl.lump(make_scene(fl.Link(name="a", mount=turned), flexible("b"))).axes[0]
    links = fl.Link(name="a", mount=turned), flexible("b")
    assert len(notes(make_scene(*links, gravity=tuple(9.81 * axis)))) == 1
    assert not notes(make_scene(*links, gravity=tuple(9.81 * axis + [0, 1e-9, 0])))


@pytest.mark.parametrize(
    "fields",
    [
        {"gravity": (0.0, 1e-9, 9.81)},
        {"gravity": (0.0, 0.0, 0.0)},  # gravity is switched off on purpose
        {"initial": fl.InitialState(joint_deg=(0, 0), rate_deg=(0, 1))},
        {"wrench": fl.Wrench(force=(0, 1, 0))},
        {"drive": fl.Drive(kind="constant", torque=(0, 1))},
        {"drive": fl.Drive(kind="table", times=(0, 1), torques=((0, 0), (0, 1)))},
        {"drive": fl.Drive(kind="pd", kp=(0, 1), kd=(0, 0), target_deg=(0, 10))},
        {"motion": [fl.PrescribedMotion(link="a", times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])]},
    ],
)
def test_gravity_that_bends_no_link_is_noted_also_if_another_load_acts(fields: dict) -> None:
    found = notes(make_scene(fl.Link(name="a"), flexible("b"), **fields))
    assert len(found) == ("gravity" not in fields)
    for note in found:
        reviewed("no-effect", note)


@pytest.mark.parametrize(
    ("change", "id"), [({"from_deg": (10.0, 0.0)}, "begins-elsewhere"), ({"duration": 9.0}, "cut-off"), ({}, "")]
)
def test_a_reference_that_does_not_fit_the_run_is_noted(change: dict, id: str) -> None:
    move = fl.Reference(**{"profile": "quintic", "to_deg": (10.0, 0.0), "duration": 1.0, **change})
    drive = fl.Drive(kind="pd", kp=(9.0, 9.0), kd=(1.0, 1.0), reference=move)
    found = notes(make_scene(fl.Link(name="a"), flexible("b"), drive=drive, gravity=(0.0, 0.0, 0.0)))
    assert [note.id for note in found] == [f"reference-{id}"] * bool(id)
    for note in found:
        reviewed(note.id, note)


def test_gravity_along_the_joints_bends_links_out_of_the_plane() -> None:
    assert notes(make_scene(flexible("b", "yz"))) == ()
    assert notes(make_scene(flexible("b", mount=UPRIGHT))) == ()


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_the_scenes_of_the_repository_need_no_notes(path: Path) -> None:
    assert notes(fl.load_scene(path)) == ()


def test_notes_name_the_key_and_value_without_effect() -> None:
    bar = {"length": 1.0, "material": "aluminium", "section": "square"}
    scene = make_scene(
        fl.Link(name="a", mount=UPRIGHT, damping=fl.Damping(ratio=0.01, at_hz=4.0), **bar),
        fl.Link(name="b", joint=fl.Joint(locked=True, viscous=2.0, armature=0.1), **bar),
        initial=fl.InitialState(joint_deg=(0, 0), passive="static"),
        motion=[fl.PrescribedMotion(link="a", times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])],
        drive=fl.Drive(kind="constant", torque=(5.0, 0.0)),
    )
    wanted = [
        ("initial.passive = 'static'", ""),
        ("drive.torque", "'a'"),
        ("link.a.damping.ratio = 0.01", "'a'"),
        ("link.b.joint.viscous = 2.0", "'b'"),
        ("link.b.joint.armature = 0.1", "'b'"),
    ]
    for note, (path, link) in zip(notes(scene), wanted, strict=True):
        assert note.partition(": ")[0] == path
        assert link in note.partition(": ")[2]
        check_no_effect(note)


@pytest.mark.parametrize("passive", ["zero", "static"])
def test_a_static_start_of_a_rigid_arm_keeps_its_initial_angles(passive: str) -> None:
    link = fl.Link(name="a", length=1.0, material="aluminium", section="square", mount=UPRIGHT)
    scene = make_scene(link, initial=fl.InitialState(joint_deg=(30.0,), passive=passive))
    q, _ = fl.initial_state(scene, fl.lump(scene))
    assert q == pytest.approx([np.radians(30.0)], rel=1e-15, abs=0)


def test_info_prints_notes_to_stderr(tmp_path: Path, capsys) -> None:
    path = tmp_path / "still.toml"
    scene = make_scene(flexible("b"))
    path.write_text(scene.to_toml(), encoding="utf-8")
    assert main(["info", str(path)]) == 0
    streams = capsys.readouterr()
    (note,) = notes(scene)
    assert f"note: {note}{id_of(note)}" in streams.err.splitlines()
    assert "note" not in streams.out


def test_the_default_gravity_is_noted_until_the_remedy_is_applied() -> None:
    unsaid = make_scene(flexible("b")).varied({"link.b.segments": 5})
    (note,) = defaults(unsaid)
    reviewed("gravity-not-given", note)
    mended = unsaid.varied({"gravity": tomllib.loads(note.partition("set ")[2])["gravity"]})
    assert mended.gravity[2] == -9.81 and not defaults(mended)
    assert not defaults(unsaid.varied({"gravity": [0.0, 0.0, 9.81]}))


@pytest.mark.parametrize("joint", [{"kind": "prismatic"}, {}], ids=["slides", "turns"])
def test_the_note_on_the_width_of_friction_states_the_creep_of_a_run(joint: dict) -> None:
    hub = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    rod = fl.Link(name="rod", hub=hub, joint=fl.Joint(coulomb=20.0, **joint))
    scene = make_scene(rod, gravity=(0, 0, 0), drive=fl.Drive(kind="constant", torque=(10.0,)))
    (note,) = defaults(scene)
    reviewed("friction-width-not-given", note)
    creep = 1e-3 * float(re.search(r"at ([\d.]+) m", note)[1])
    run = fl.simulate(scene, step=1e-5, duration=0.02)
    assert run.qd[-1, 0] == pytest.approx(creep, rel=0.01)  # 5.5 of 5.493
    narrow = float(note.rpartition("= ")[2])
    mended = scene.varied({"link.rod.joint.coulomb_width": narrow})
    assert not defaults(mended)
    assert fl.simulate(mended, step=1e-6, sample=1e-5, duration=0.002).qd[-1, 0] == pytest.approx(creep / 10, rel=0.01)


def plate_frequencies(ratio: float, ν: float, along: int = 16, across: int = 7) -> np.ndarray:
    """First two bending frequencies of a cantilever plate, divided by those of the beam: Ritz, Kirchhoff's plate.

    The plate has length 1, width `ratio`, D = ρ h = 1; deflections are x² P_i(x) P_j(y) with Legendre polynomials.
    """

    def products(size: int, length: float, factor: list[float]) -> list[list[np.ndarray]]:
        """Integrals of all products of the polynomials' derivatives of orders 0 to 2."""
        x, weights = leggauss(40)
        whole = [Legendre.basis(k, [0, length]).convert(kind=Polynomial) * Polynomial(factor) for k in range(size)]
        rows = [np.array([each.deriv(order)((x + 1) * length / 2) for each in whole]) for order in range(3)]
        return [[(one * weights * length / 2) @ other.T for other in rows] for one in rows]

    x, y = products(along, 1.0, [0, 0, 1]), products(across, ratio, [1])
    bent = np.kron(x[2][2], y[0][0]) + np.kron(x[0][0], y[2][2])
    crossed = ν * (np.kron(x[2][0], y[0][2]) + np.kron(x[0][2], y[2][0])) + 2 * (1 - ν) * np.kron(x[1][1], y[1][1])
    squares, shapes = eigh(bent + crossed, np.kron(x[0][0], y[0][0]))
    symmetric = [np.abs(w[:, ::2]).max() > np.abs(w[:, 1::2]).max() for w in shapes.T.reshape(-1, along, across)]
    return np.sqrt(squares[symmetric][:2] / (1 - ν**2)) / np.square([1.875104, 4.694091])


@pytest.mark.parametrize("ν", [0.2, 0.3, 0.4])
@pytest.mark.parametrize("ratio", [0.1, 0.2])
def test_a_wide_strip_is_noted_with_the_frequency_that_a_plate_has_more(ratio: float, ν: float) -> None:
    strip = {"section.square": fl.Section(shape="rectangle", height=0.004, width=ratio)}
    scene = make_scene(flexible("b", length=1.0)).varied(strip | {"material.aluminium.poisson": ν})
    (note,) = (each for each in notes(scene) if each.id == "wide-strip")
    clamped, most = (float(number) for number in re.findall(r"([\d.]+) %", note))
    assert 100 * (plate_frequencies(ratio, ν) - 1) == pytest.approx(clamped, rel=0.25)
    plane_strain = fl.lump(scene.varied({"material.aluminium.young": ALUMINIUM.young / (1 - ν**2)}))
    stiff, soft = (fl.modes(chain, locked=["b"]).hertz[0] for chain in (plane_strain, fl.lump(scene)))
    assert stiff / soft - 1 == pytest.approx(most / 100, rel=0.025)  # two digits are printed
    known = scene.varied({"uncertain": {"material.aluminium.young": most / 100}})
    assert "wide-strip" not in {each.id for each in notes(known)}


def test_the_note_of_a_wide_strip_is_reviewed_and_absent_where_it_bends_on_edge_or_is_narrow() -> None:
    def found(height: float, width: float, **fields: object) -> list[str]:
        strip = {"section.square": fl.Section(shape="rectangle", height=height, width=width)}
        return [each for each in notes(make_scene(flexible("b", **fields)).varied(strip)) if each.id == "wide-strip"]

    (note,) = found(0.003, 0.04)
    reviewed("wide-strip", note)
    assert found(0.04, 0.003, flex="yz")
    assert not found(0.04, 0.003)
    assert not found(0.0041, 0.04)


def test_a_strip_on_edge_is_noted_and_softer_by_the_stated_factor_if_height_and_width_are_exchanged() -> None:
    strip = fl.Section(shape="rectangle", height=0.04, width=0.003)
    scene = make_scene(flexible("b")).varied({"section.square": strip})
    (note,) = (each for each in notes(scene) if each.id != "no-effect")
    reviewed("bends-on-edge", note)
    EI, factor = (float(number) for number in re.findall(r"= ([\d.]+) N m², ([\d.]+) ×", note)[0])
    young = scene.arm.materials["aluminium"].young
    assert young * 0.003 * 0.04**3 / 12 == pytest.approx(EI, rel=1e-3)
    mended = scene.varied({"section.square": fl.Section(shape="rectangle", height=0.003, width=0.04)})
    assert note.id not in {each.id for each in notes(mended)}
    stiff, soft = (fl.modes(fl.lump(each), locked=["b"]).hertz[0] for each in (scene, mended))
    assert (stiff / soft) ** 2 == pytest.approx(factor, rel=0.01)
