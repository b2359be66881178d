"""Units of rotary joints (degrees) and sliding joints (metres) in scenes; free bases and branches."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.chain.layout import as_lines, branches_of
from flexlink.data.csv_table import read_csv, units
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.scene import scene_from
from flexlink.results.pictures.outline import outline_of
from flexlink.results.samples import sources_of
from tests.support.words import refused, reviewed

GANTRY = """
name = "gantry"
gravity = [0.0, 0.0, -9.81]
material.steel = { young = 210e9, density = 7850.0 }
section.tube = { shape = "tube", outer = 0.04, inner = 0.03 }
initial = { joint_deg = [0.0, -80.0], joint_m = [1.0, 0.0], rate_m = [0.2, 0.0] }
[[link]]
name = "trolley"
joint = { kind = "prismatic", axis = [1.0, 0.0, 0.0], limits_m = [0.0, 8.0], viscous = 20.0 }
hub.mass = 50.0
[[link]]
name = "boom"
mount.rpy_deg = [90.0, 0.0, 0.0]
joint = { viscous = 5.0, armature = 0.1 }
length = 3.0
flex = "z"
segments = 3
material = "steel"
section = "tube"
"""
SATELLITE = """
name = "satellite"
gravity = [0.0, 0.0, 0.0]
base = { kind = "free", mass = 100.0, inertia = [10.0, 10.0, 10.0] }
initial.base = { xyz = [1.0, 2.0, 3.0], rpy_deg = [0.0, 0.0, 90.0], spin_deg = [0.0, 0.0, 18.0] }
[[link]]
name = "left"
mount.xyz = [0.5, 0.0, 0.0]
length = 2.0
end.mass = 2.0
[[link]]
name = "right"
on = "base"
mount = { xyz = [-0.5, 0.0, 0.0], rpy_deg = [0.0, 0.0, 180.0] }
joint = { kind = "prismatic", axis = [1.0, 0.0, 0.0] }
length = 2.0
end.mass = 2.0
[[link]]
name = "hand"
on = "right"
length = 0.3
end.mass = 1.0
"""
GAINS: dict[str, Any] = {"kind": "pd", "kp": [4000.0, 200.0], "kd": [800.0, 100.0]}
MOVE: dict[str, Any] = {"profile": "quintic", "duration": 2.0}


@pytest.fixture
def gantry() -> fl.Scene:
    """A hinged boom on a sliding trolley."""
    return scene_from(tomllib.loads(GANTRY))


@pytest.fixture
def satellite() -> fl.Scene:
    """Two arms on a free base; one arm has a sliding joint."""
    return scene_from(tomllib.loads(SATELLITE))


def test_initial_positions_of_sliding_joints_are_in_metres(gantry: fl.Scene) -> None:
    chain = fl.lump(gantry)
    q, qd = fl.initial_state(gantry, chain)
    assert q[0] == 1.0
    assert q[1] == np.radians(-80.0)
    assert qd[0] == 0.2
    assert fl.frames(chain, q).points[0].tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"initial.joint_deg.trolley": 30.0},
         "unit-of-joint"),
        ({"initial.joint_m.boom": 0.5}, "unit-of-joint"),
        ({"initial.rate_m.boom": 0.5}, "unit-of-joint"),
        ({"initial.joint_m.trolley": 9.0}, "outside-limits"),
        ({"initial.joint_m": [1.0]}, "one-per-link"),
        ({"initial.joint_m": 1.0}, "wrong-value"),
        ({"link.trolley.joint.limits_deg": [0.0, 9.0]}, "key-of-another-kind"),
        ({"link.trolley.joint.kind": "slide"}, "wrong-value"),
        ({"initial.base.xyz": [1.0, 0.0, 0.0]}, "no-effect"),
        ({"drive": {**GAINS, "target_deg": [0.0, 0.0]}}, "missing-key"),
        ({"drive": {**GAINS, "target_deg": [9.0, 0.0], "target_m": [1.0, 0.0]}},
         "unit-of-joint"),
        ({"drive": {**GAINS, "reference": {**MOVE, "to_deg": [0.0, 0.0]}}},
         "missing-key"),
        ({"drive": {**GAINS, "reference": {**MOVE, "to_deg": [0.0, 0.0], "to_m": [9.0, 0.0]}}},
         "wrench-out-of-reach"),
        ({"drive": {**GAINS, "reference": {
            "profile": "quintic", "to_deg": [0.0, 0.0], "to_m": [2.0, 0.0], "max_rate_deg": [0.0, 9.0]}}},
         "missing-key"),
        ({"motion": [{"link": "trolley", "times": [0.0], "angle_deg": [0.0], "rate_deg": [0.0],
                      "acceleration_deg": [0.0]}]},
         "sensor-of-joint"),
        ({"motion": [{"link": "trolley", "times": [0.0], "position_m": [2.0], "rate_m": [0.2],
                      "acceleration_m": [0.0]}]}, "start-differs-from-motion"),
        ({"motion": [{"link": "trolley", "times": [0.0], "position_m": [1.0], "rate_m": [0.2]}]},
         "missing-key"),
        ({"wrench.on": "trolley"}, "unknown-name"),
        ({"wrench.on": "bom"}, "unknown-name"),
    ],
)  # fmt: skip
def test_keys_that_do_not_fit_a_joint_are_refused(gantry: fl.Scene, changes: dict[str, Any], wanted: str) -> None:
    with refused(fl.errors.SceneError, wanted):
        gantry.varied(changes)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"initial.passive": "static"}, "rest-of-free-base"),
        ({"drive": {"kind": "computed_torque", "kp": [1.0] * 3, "kd": [1.0] * 3, "target_deg": [0.0] * 3,
                    "target_m": [0.0] * 3}}, "drive-of-free-base"),
        ({"base.mass": 0.0}, "base-mass"),
        ({"wrench.on": "right"}, "unknown-name"),
    ],
)  # fmt: skip
def test_keys_that_need_a_fixed_base_are_refused_with_a_free_base(satellite, changes, wanted) -> None:
    with refused(fl.errors.SceneError, wanted):
        satellite.varied(changes)


def test_the_initial_state_of_a_free_base_follows_the_scene(satellite: fl.Scene) -> None:
    chain = fl.lump(satellite)
    q, qd = fl.initial_state(satellite, chain)
    assert chain.joint_names[:6] == ("base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz")
    assert q[:6].tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    assert np.allclose(qd[:6], [0, 0, 0, 0, 0, np.pi / 10], atol=1e-15)
    left = fl.tip_position(chain, q, tip="left")
    assert np.allclose(left, [1.0, 4.5, 3.0], atol=1e-15), "turned by 90° about Z with the base"
    assert np.array_equal(left, fl.frames(chain, q).points[chain.tips["left"]])


def test_paths_address_the_base_and_joint_positions(satellite: fl.Scene) -> None:
    other = satellite.varied({"base.mass": 50.0, "initial.joint_m.right": 0.25, "link.hand.on": "left"})
    assert other.values_at("base.mass") == [50.0]
    assert fl.lump(other).mass == fl.lump(satellite).mass - 50.0
    assert fl.initial_state(other, fl.lump(other))[0][7] == 0.25
    assert set(fl.lump(other).tips) == {"right", "hand"}


def test_stars_in_paths_match_the_joints_of_one_kind(gantry: fl.Scene) -> None:
    values = {key: gantry.values_at(f"initial.{key}.*") for key in ("joint_m", "joint_deg")}
    assert values == {"joint_m": [1.0], "joint_deg": [-80.0]}


def test_a_reference_has_the_unit_of_each_joint(gantry: fl.Scene) -> None:
    lists = {"to_deg": [0.0, -60.0], "to_m": [4.0, 0.0], "max_rate_deg": [0.0, 90.0], "max_rate_m": [1.0, 0.0]}
    course = gantry.varied({"drive": {**GAINS, "reference": {"profile": "quintic", **lists}}}).course
    assert course is not None
    (start, end), rates = course(np.array([0.0, course.knots[-1]]))[0], course(np.linspace(0, 6, 10001))[1]
    assert np.allclose(start, [1.0, np.radians(-80.0)])
    assert np.allclose(end, [4.0, np.radians(-60.0)])
    assert abs(rates[:, 0].max() - 1.0) < 1e-6, "the slower joint reaches its limit, in m/s"


def test_a_table_has_the_unit_of_each_joint(gantry: fl.Scene) -> None:
    table = {"times": [0.0, 1.0], "angle_deg": [[0.0, -80.0], [0.0, -60.0]], "position_m": [[1.0, 0.0], [2.0, 0.0]]}
    course = gantry.varied({"drive": {**GAINS, "reference": {"profile": "linear", **table}}}).course
    assert course is not None
    assert np.allclose(course(0.5)[0], [1.5, np.radians(-70.0)])


def test_positions_of_kilometres_are_reported_as_likely_millimetres(gantry: fl.Scene) -> None:
    assert not hints(gantry)
    _, hint = hints(gantry.varied({"link.trolley.joint.limits_m": [0.0, 8000.0], "initial.joint_m.trolley": 1200.0}))
    assert [part for part in (" mm", "[0, 8] m") if part not in hint] == []
    reviewed("likely-unit", hint)


def test_a_rule_with_a_hinge_at_the_root_suits_a_sliding_joint(gantry: fl.Scene) -> None:
    sliding = {"joint.kind": "prismatic", "lumping": "lobatto2"}
    lone = gantry.varied({"initial": None}).varied({f"link.boom.{key}": value for key, value in sliding.items()})
    assert fl.lump(lone).n == 4


def test_pictures_draw_no_line_from_a_tip_to_the_next_branch(satellite: fl.Scene) -> None:
    chain = fl.lump(satellite)
    lines = as_lines(chain, fl.frames(chain, np.zeros(chain.n)).points)
    assert branches_of(chain) == [[2, 3, 4], [2, 5, 6, 7]]
    assert np.isnan(lines).all(axis=1).tolist() == [False, False, False, True, False, False, False, False]
    assert np.array_equal(lines[0], lines[4]), "both begin at the base"


def test_films_draw_rails_and_branches(satellite: fl.Scene) -> None:
    chain = fl.lump(satellite)
    outline = outline_of(satellite, chain)
    stations = len(outline.link)
    place = chain.bodies["translation"][4]  # zero position of the sliding arm
    assert outline.base == 2
    assert outline.rails[0].tolist() == [2]
    assert np.array_equal(outline.rails[1], [place])
    rail, apart = 8 + stations, np.flatnonzero(outline.order == -1).tolist()
    left, right = np.split(outline.order, apart)
    assert left[[0, 1, -1]].tolist() == [2, 3, 4]
    assert right[[1, 2, 3, -1]].tolist() == [2, rail, 5, 7]
    assert not set(left) & set(right[2:]), "no section is on both arms"


def test_columns_have_the_units_of_their_joints(gantry: fl.Scene) -> None:
    names = set(sources_of(fl.lump(gantry)))
    assert {"q trolley [m]", "qd trolley [m/s]", "tau trolley [N]", "q boom [rad]", "tau boom [N m]"} < names


def test_warnings_show_limits_in_the_unit_of_the_joint(gantry: fl.Scene) -> None:
    scene = gantry.varied({"initial.joint_m": [7.99, 0.0], "initial.rate_m": [1.0, 0.0], "run.duration": 0.05})
    (warning,) = fl.simulate(scene).warnings
    position = re.search(r"'trolley'\D*(8\.0\S*) m\b", warning)
    assert position is not None and float(position[1]) > 8.0
    assert "0 m … 8 m" in warning
    id = "joint-past-limits"
    assert (getattr(warning, "id", "") or id) == id
    reviewed(id, warning)


def test_tips_of_a_run_have_names(satellite: fl.Scene) -> None:
    run = fl.simulate(satellite.varied({"run.duration": 0.1}))
    assert np.allclose(run.tip_of("hand"), run.tip, atol=1e-14)
    assert np.linalg.norm(run.tip_of("left")[0] - [1.0, 4.5, 3.0]) < 1e-14
    with refused(fl.errors.ArgumentError, "tip-not-a-tip"):
        run.tip_of("right")


SIZES = {"k": 1e3, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "": 1.0}


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


@pytest.mark.parametrize("unit", units())
def test_the_size_of_a_unit_follows_from_its_prefixes(unit: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(f"a [{unit}]\n3\n", encoding="utf-8")
    column = read_csv(tmp_path / "table.csv").column("a", units()[unit][0])
    assert column[0] == pytest.approx(3 * in_si(unit), rel=1e-14)
