"""Numbers of a scene: units of tables, dampers that depend on the configuration, hints from textbook formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.data.csv_table import UNITS, read_csv
from flexlink.describe.plausibility.hints import hints
from flexlink.errors import SceneError
from tests.conftest import ALUMINIUM, SQUARE, flexible, make_scene
from tests.support.words import refused, reviewed

SIZES = {"k": 1e3, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "": 1.0}
HELD = fl.Joint(locked=True)


def in_si(unit: str) -> float:
    """Size of a unit in SI units, from its prefixes: "N mm²" is 1e-6 N m², "g/m" 1e-3 kg/m."""
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
def test_the_size_of_a_unit_follows_from_its_prefixes(unit: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(f"a [{unit}]\n3\n", encoding="utf-8")
    column = read_csv(tmp_path / "table.csv").column("a", UNITS[unit][0])
    assert column[0] == pytest.approx(3 * in_si(unit), rel=1e-14)


def test_a_table_of_rigidities_accepts_millimetres_and_grams(tmp_path: Path) -> None:
    (tmp_path / "spar.csv").write_text("x [mm],EI_z [N mm²],rhoA [g/m]\n0,5e7,2000\n800,4e7,600\n", encoding="utf-8")
    table = fl.Rigidity(file=str(tmp_path / "spar.csv"))
    np.testing.assert_allclose((table.x, table.ei_z, table.rho_a), ((0.0, 0.8), (50.0, 40.0), (2.0, 0.6)), rtol=1e-14)


def test_a_table_with_a_jump_at_an_end_or_without_rigidity_is_refused(tmp_path: Path) -> None:
    for x in ((0.0, 1.0, 1.0), (0.0, 0.0, 1.0)):
        with refused(SceneError, "rigidity-table"):
            fl.Rigidity(x=x, rho_a=(1.0,) * 3)
    for row in ("0,50,2\n1,0,2", "0,50,2\n1,50,0"):
        (tmp_path / "spar.csv").write_text(f"x [m],EI_z [N m²],rhoA [kg/m]\n{row}\n", encoding="utf-8")
        with refused(fl.errors.DataFileError, "out-of-range"):
            fl.Rigidity(file=str(tmp_path / "spar.csv"))


@pytest.mark.parametrize("first", [0.3, 1.2])
def test_dampers_of_a_constant_ratio_depend_on_the_configuration(first: float) -> None:
    """A scene lumped earlier with another configuration must not affect the dampers."""
    damping = fl.Damping(ratio=0.02, law="constant")
    scene = make_scene(*(flexible(name, "z", 3, damping=damping) for name in "ab"), gravity=(0.0, 0.0, 0.0))
    for elbow in (first, 0.1, first):
        q = np.zeros(fl.lump(scene).n)
        q[fl.lump(scene).active] = 0.0, elbow
        chain = fl.lump(scene.varied({"initial": fl.InitialState(joint_deg=(0.0, float(np.degrees(elbow))))}))
        np.testing.assert_allclose(fl.modes(chain, q, locked=chain.active).damping_ratios, 0.02, rtol=1e-8)


def test_dampers_between_hinges_are_sorted_with_coupled_cells() -> None:
    """The first link has coupled cells, the second a damper at every hinge; kernels process both in one loop."""
    alike = fl.Damping(ratio=0.02, law="constant")
    links = flexible("a", "z", 5, lumping="lobatto2"), flexible("b", "z", 5, damping=alike)
    chain = fl.lump(make_scene(*links))
    pairs = [(int(row[0]), int(row[1])) for row in chain.couplings.tolist()]
    assert pairs == sorted(pairs)
    assert {chain.coordinates[i].link for i, _ in pairs} == {1, 2}


def test_a_link_fixed_in_frame_0_has_no_drag(rng: np.random.Generator) -> None:
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
    """A clamped square bar of 2 m, with gravity along −Y."""
    return make_scene(flexible("bar", length=2.0, joint=HELD), gravity=(0.0, -9.81, 0.0), **fields)


WEIGHT = 2700.0 * 0.04**2 * 2.0 * 9.81
YIELD = 0.1  # limit of the strain in data/plausibility
MOMENT = YIELD * 70e9 * (0.04**4 / 12) / 0.02 - WEIGHT * 1.0  # strain · E I/c, minus the moment of the weight


@pytest.mark.parametrize(
    ("key", "load"),
    [
        ("tip.mass", lambda part: {"tip": fl.RigidBody(mass=part * MOMENT / 9.81 / 2.0)}),
        ("wrench.force", lambda part: {"wrench": fl.Wrench(force=(0.0, part * MOMENT / 2.0, 0.0))}),
        ("wrench.moment", lambda part: {"wrench": fl.Wrench(moment=(0.0, 0.0, part * MOMENT))}),
    ],
)
def test_a_load_beyond_the_largest_strain_of_metals_has_a_hint(key: str, load) -> None:
    assert not hints(cantilever(**load(0.99)))
    (hint,) = hints(cantilever(**load(1.01)))
    assert hint.id == "likely-unit"
    assert hint.startswith(f"{key} = ")
    assert " 0.1" in hint and "'bar'" in hint
    reviewed(hint.id, hint)


def test_points_bodies_and_springs_beyond_their_limits_have_a_hint() -> None:
    """Limits: 3 times the reach for points, the reach for radii of gyration, 0.5 rad for root and gear springs."""
    arm = make_scene(flexible("bar", length=2.0), gravity=(0.0, -9.81, 0.0))
    moment = WEIGHT * 1.0
    cases = {
        "tip.center": lambda part: {"tip": fl.RigidBody(mass=1e-6, center=(0.0, 6.0 * part, 0.0))},
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
        assert not [hint for hint in below if hint.startswith(key)], key
        (hint,) = (hint for hint in above if hint.startswith(key))
        reviewed(hint.id, hint)


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
def test_an_angle_with_the_digits_of_a_round_angle_in_radians_has_a_hint(angle: float, radians: bool) -> None:
    """The number is a multiple of 5° in radians, rounded to its decimals; with two decimals, only 90° has a hint."""
    scene = make_scene(flexible("a"), gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(angle,)))
    found = [hint for hint in hints(scene) if hint.id == "likely-radians"]
    assert len(found) == radians
    for hint in found:
        reviewed(hint.id, hint)


def test_a_spring_that_the_weight_stretches_by_half_a_metre_has_a_hint() -> None:
    """F/k ≥ 0.5 m, with the weight F of the sliding bodies: the stiffness is probably in N/mm."""
    slide = fl.Joint(kind="prismatic", axis=(0.0, 1.0, 0.0))
    beam = fl.Link(name="car", length=2.0, material="aluminium", section="square", joint=slide)
    scene = make_scene(beam, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_m=(0.0,)))
    for part, count in ((0.99, 0), (1.01, 1)):
        stiffness = WEIGHT / (0.5 * part)
        changes = {"link.car.joint.gear_stiffness": stiffness, "link.car.joint.armature": 1.0}
        found = [hint for hint in hints(scene.varied(changes)) if hint.startswith("link.car.joint.gear_stiffness")]
        assert len(found) == count
        for hint in found:
            assert "0.51 m" in hint and "N/mm" in hint
            reviewed("likely-unit", hint)


@pytest.mark.parametrize(("length", "side", "key"), [(30.0, 5e-3, "link.bar.length"), (0.03, 0.04, "section.square.")])
def test_a_link_too_slender_or_too_short_for_a_beam_has_a_hint(length: float, side: float, key: str) -> None:
    """If L/h = 6000, the length is probably wrong; if the link is wider than long, the section is probably wrong."""
    section = fl.Section(shape="rectangle", height=side, width=side)
    scene = make_scene(flexible("bar", length=length), gravity=(0.0, 0.0, 0.0)).varied({"section.square": section})
    (hint,) = hints(scene)
    assert hint.startswith(key)
    assert f" {length / side:.2g} " in hint
    reviewed("likely-unit", hint)


assert ALUMINIUM.young == 70e9
assert SQUARE.properties.i_z == pytest.approx(0.04**4 / 12)
