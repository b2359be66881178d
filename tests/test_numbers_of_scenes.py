"""Numbers of a scene: units of tables, dampers of the posture that a run starts from, hints by formulas of the book."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ALUMINIUM, SQUARE, flexible, make_scene

import flexlink as fl
from flexlink.data.csv_table import UNITS, read_csv
from flexlink.describe.plausibility.hints import hints
from flexlink.errors import SceneError
from tests.words import refused

SIZES = {"k": 1e3, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "": 1.0}
HELD = fl.Joint(locked=True)


def in_si(unit: str) -> float:
    """A unit's size by its prefixes: "N mm²" is 1e-6 N m², "g/m" 1e-3 kg/m."""
    if unit in {"rad", "deg", "mrad"}:
        return {"rad": 1.0, "deg": np.pi / 180, "mrad": 1e-3}[unit]
    size = 1.0
    over, _, under = unit.partition("/")
    for sign, part in [*((1, part) for part in over.split()), *((-1, part) for part in under.split())]:
        base = part.removesuffix("^2").removesuffix("²")
        prefix, letter = base[:-1], base[-1]
        of_kilogram = 1e-3 if letter == "g" else 1.0
        size *= (SIZES[prefix] * of_kilogram) ** (sign * (1 if base == part else 2))
    return size


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_is_what_its_prefixes_say(unit: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(f"a [{unit}]\n3\n", encoding="utf-8")
    column = read_csv(tmp_path / "table.csv").column("a", UNITS[unit][0])
    assert column[0] == pytest.approx(3 * in_si(unit), rel=1e-14)


def test_a_table_of_rigidities_may_be_in_millimetres_and_grams(tmp_path: Path) -> None:
    (tmp_path / "spar.csv").write_text("x [mm],EI_z [N mm²],rhoA [g/m]\n0,5e7,2000\n800,4e7,600\n", encoding="utf-8")
    table = fl.Rigidity(file=str(tmp_path / "spar.csv"))
    np.testing.assert_allclose((table.x, table.ei_z, table.rho_a), ((0.0, 0.8), (50.0, 40.0), (2.0, 0.6)), rtol=1e-14)


def test_a_table_neither_jumps_at_its_tip_nor_is_without_rigidity(tmp_path: Path) -> None:
    for x in ((0.0, 1.0, 1.0), (0.0, 0.0, 1.0)):
        with refused(SceneError, "rigidity-table"):
            fl.Rigidity(x=x, rho_a=(1.0,) * 3)
    for row in ("0,50,2\n1,0,2", "0,50,2\n1,50,0"):
        (tmp_path / "spar.csv").write_text(f"x [m],EI_z [N m²],rhoA [kg/m]\n{row}\n", encoding="utf-8")
        with refused(fl.errors.DataFileError, "out-of-range"):
            fl.Rigidity(file=str(tmp_path / "spar.csv"))


@pytest.mark.parametrize("first", [0.3, 1.2])
def test_dampers_of_one_ratio_are_those_of_the_posture_that_angles_of_all_joints_say(first: float) -> None:
    """Not those of a scene that was lumped before."""
    damping = fl.Damping(ratio=0.02, law="constant")
    scene = make_scene(*(flexible(name, "z", 3, damping=damping) for name in "ab"), gravity=(0.0, 0.0, 0.0))
    for elbow in (first, 0.1, first):
        q = np.zeros(fl.lump(scene).n)
        q[fl.lump(scene).active] = 0.0, elbow
        chain = fl.lump(scene.varied({"initial": fl.InitialState(joint_deg=(0.0, float(np.degrees(elbow))))}))
        np.testing.assert_allclose(fl.modes(chain, q, locked=chain.active).damping_ratios, 0.02, rtol=1e-8)


def test_dampers_between_hinges_stand_in_their_order_beside_coupled_cells() -> None:
    """Cells of the first link are coupled, all hinges of the second damped: kernels go through both in one pass."""
    alike = fl.Damping(ratio=0.02, law="constant")
    links = flexible("a", "z", 5, lumping="lobatto2"), flexible("b", "z", 5, damping=alike)
    chain = fl.lump(make_scene(*links))
    pairs = [(int(row[0]), int(row[1])) for row in chain.couplings.tolist()]
    assert pairs == sorted(pairs)
    assert {chain.coordinates[i].link for i, _ in pairs} == {1, 2}


def test_a_link_that_is_fixed_in_frame_0_feels_no_drag(rng: np.random.Generator) -> None:
    rod = {"length": 1.0, "material": "aluminium", "section": "square"}
    drag = fl.Drag(coefficient=1.2, breadth=(0.1, 0.1))
    fixed = make_scene(fl.Link(name="post", joint=HELD, **rod), fl.Link(name="arm", **rod))
    q, qd, tau = rng.normal(size=(3, 1))
    still = fl.forward_dynamics(fl.lump(fixed), q, qd, tau)
    np.testing.assert_array_equal(
        fl.forward_dynamics(fl.lump(fixed.varied({"link.post.drag": drag})), q, qd, tau), still
    )
    moved = fl.forward_dynamics(fl.lump(fixed.varied({"link.arm.drag": drag})), q, qd, tau)
    assert abs(moved - still).max() > 1e-3


def cantilever(**fields: object) -> fl.Scene:
    """A square bar of 2 m that is clamped, its weight along −Y."""
    return make_scene(flexible("bar", length=2.0, joint=HELD), gravity=(0.0, -9.81, 0.0), **fields)


WEIGHT = 2700.0 * 0.04**2 * 2.0 * 9.81
YIELD = 0.1  # of `strain` in data/plausibility
MOMENT = YIELD * 70e9 * (0.04**4 / 12) / 0.02 - WEIGHT * 1.0  # M c/(E I), beside its own weight


@pytest.mark.parametrize(
    ("key", "load"),
    [
        ("tip.mass", lambda part: {"tip": fl.RigidBody(mass=part * MOMENT / 9.81 / 2.0)}),
        ("wrench.force", lambda part: {"wrench": fl.Wrench(force=(0.0, part * MOMENT / 2.0, 0.0))}),
        ("wrench.moment", lambda part: {"wrench": fl.Wrench(moment=(0.0, 0.0, part * MOMENT))}),
    ],
)
def test_a_load_is_told_from_the_strain_on_that_no_metal_bears(key: str, load) -> None:
    assert not [text for text in hints(cantilever(**load(0.99))) if "would strain" in text]
    (told,) = [text for text in hints(cantilever(**load(1.01))) if "would strain" in text]
    assert told.startswith(f"{key} = ")
    assert "would strain by 0.1:" in told


def test_places_bodies_and_roots_are_told_from_their_limits_on() -> None:
    """A place beyond 20 reaches, a radius of gyration beyond the reach, a root that its arm turns by 0.5 rad."""
    arm = make_scene(flexible("bar", length=2.0), gravity=(0.0, -9.81, 0.0))
    moment = WEIGHT * 1.0
    cases = {
        "tip.center": lambda part: {"tip": fl.RigidBody(mass=1e-6, center=(0.0, 40.0 * part, 0.0))},
        "tip.inertia": lambda part: {"tip": fl.RigidBody(mass=1.0, inertia=(3.0 * (3.0 * part**2),) * 3)},
        "link.bar.root_stiffness.z": lambda part: {
            "link.bar.joint": HELD,
            "link.bar.root_stiffness": fl.details.RootStiffness(z=moment / (0.5 * part)),
        },
        "link.bar.joint.gear_stiffness": lambda part: {
            "link.bar.joint": fl.Joint(gear_stiffness=moment / (0.5 * part), armature=0.01)
        },
        "drive.torque.bar": lambda part: {"drive": fl.Drive(kind="constant", torque=(300.0 * moment * part,))},
    }
    for key, change in cases.items():
        below, above = (hints(arm.varied(change(part))) for part in (0.99, 1.01))
        assert not [text for text in below if text.startswith(key)], key
        assert len([text for text in above if text.startswith(key)]) == 1, key


@pytest.mark.parametrize(
    ("angle", "radians"),
    [
        (1.5708, True),
        (1.57, True),
        (0.524, True),
        (3.1416, True),
        (1.6, False),
        (0.528, False),
        (0.53, False),
        (2, False),
    ],
)
def test_an_angle_whose_digits_are_those_of_a_whole_angle_in_radians_is_told(angle: float, radians: bool) -> None:
    """A multiple of 5°, rounded where its decimals end; with two decimals only, a right angle."""
    scene = make_scene(flexible("a"), gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(angle,)))
    told = [text for text in hints(scene) if "whole angles in radians" in text]
    assert len(told) == radians


def test_a_rope_that_the_weight_stretches_by_half_a_metre_is_told() -> None:
    """F/k = 0.5 m and more, F the weight of all that slides; likely the stiffness is in N/mm."""
    slide = fl.Joint(kind="prismatic", axis=(0.0, 1.0, 0.0))
    beam = fl.Link(name="car", length=2.0, material="aluminium", section="square", joint=slide)
    scene = make_scene(beam, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_m=(0.0,)))
    for part, told in ((0.99, 0), (1.01, 1)):
        stiffness = WEIGHT / (0.5 * part)
        changes = {"link.car.joint.gear_stiffness": stiffness, "link.car.joint.armature": 1.0}
        said = [text for text in hints(scene.varied(changes)) if text.startswith("link.car.joint.gear_stiffness")]
        assert len(said) == told
        assert all("would stretch it by 0.51 m; likely given in N/mm" in text for text in said), said


@pytest.mark.parametrize(("length", "side", "key"), [(30.0, 5e-3, "link.bar.length"), (0.03, 0.04, "section.square.")])
def test_of_a_link_that_is_no_beam_its_length_is_told_or_its_section(length: float, side: float, key: str) -> None:
    """Too slender, L/h = 6000: likely the length is wrong; wider than long: the section."""
    section = fl.Section(shape="rectangle", height=side, width=side)
    scene = make_scene(flexible("bar", length=length), gravity=(0.0, 0.0, 0.0)).varied({"section.square": section})
    (told,) = [text for text in hints(scene) if "times as long as wide" in text]
    assert told.startswith(key)
    assert f"{length / side:.2g} times as long as wide" in told


assert ALUMINIUM.young == 70e9
assert SQUARE.properties.i_z == pytest.approx(0.04**4 / 12)
