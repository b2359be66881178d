"""Joints that turn have degrees, those that slide metres; bases that float, and branches, in what a scene says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.chain.branches import as_lines, branches_of
from flexlink.describe.plausibility.hints import hints

GANTRY = """
name = "gantry"
gravity = [0.0, 0.0, -9.81]

[material.steel]
young = 210e9
density = 7850.0

[section.tube]
shape = "tube"
outer = 0.04
inner = 0.03

[[link]]
name = "trolley"
joint = { kind = "prismatic", axis = [1.0, 0.0, 0.0], limits_m = [0.0, 8.0], viscous = 20.0 }
hub = { mass = 50.0 }

[[link]]
name = "boom"
mount = { rpy_deg = [90.0, 0.0, 0.0] }
joint = { viscous = 5.0, armature = 0.1 }
length = 3.0
flex = "z"
segments = 3
material = "steel"
section = "tube"

[initial]
joint_deg = [0.0, -80.0]
joint_m = [1.0, 0.0]
rate_m = [0.2, 0.0]
"""
SATELLITE = """
name = "satellite"
gravity = [0.0, 0.0, 0.0]
base = { kind = "free", mass = 100.0, inertia = [10.0, 10.0, 10.0] }

[[link]]
name = "left"
mount = { xyz = [0.5, 0.0, 0.0] }
length = 2.0
end = { mass = 2.0 }

[[link]]
name = "right"
on = "base"
mount = { xyz = [-0.5, 0.0, 0.0], rpy_deg = [0.0, 0.0, 180.0] }
joint = { kind = "prismatic", axis = [1.0, 0.0, 0.0] }
length = 2.0
end = { mass = 2.0 }

[[link]]
name = "hand"
on = "right"
length = 0.3
end = { mass = 1.0 }

[initial.base]
xyz = [1.0, 2.0, 3.0]
rpy_deg = [0.0, 0.0, 90.0]
spin_deg = [0.0, 0.0, 18.0]
"""
GAINS: dict[str, Any] = {"kind": "pd", "kp": [4000.0, 200.0], "kd": [800.0, 100.0]}
MOVE: dict[str, Any] = {"profile": "quintic", "duration": 2.0}


def read(text: str, folder: Path) -> fl.Scene:
    """A scene of a file."""
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return fl.load_scene(path)


@pytest.fixture
def gantry(tmp_path: Path) -> fl.Scene:
    """A boom that turns on a trolley that slides."""
    return read(GANTRY, tmp_path)


@pytest.fixture
def satellite(tmp_path: Path) -> fl.Scene:
    """Two arms on a base that floats, one of which slides."""
    return read(SATELLITE, tmp_path)


def test_a_start_is_in_metres_where_the_joint_slides(gantry: fl.Scene) -> None:
    chain = fl.lump(gantry)
    q, qd = fl.initial_state(gantry, chain)
    assert q[0] == 1.0
    assert q[1] == np.radians(-80.0)
    assert qd[0] == 0.2
    assert fl.frames(chain, q).points[0].tolist() == [1.0, 0.0, 0.0]


def test_a_scene_writes_what_it_reads(gantry: fl.Scene, satellite: fl.Scene, tmp_path: Path) -> None:
    for scene in (gantry, satellite):
        assert fl.load_scene(scene.save(tmp_path / "again.toml")) == scene


def test_a_scene_without_sliding_joints_says_nothing_of_metres() -> None:
    text = fl.load_scene("models/ptp_move.toml").to_toml()
    assert not [word for word in ("_m ", 'kind = "prismatic"', "[base]", "[initial.base]") if word in text]


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"initial.joint_deg.trolley": 30.0},
         "initial.joint_deg.trolley = 30.0: joint 'trolley' is prismatic; give initial.joint_m"),
        ({"initial.joint_m.boom": 0.5}, "initial.joint_m.boom = 0.5: joint 'boom' is revolute; give initial.joint_deg"),
        ({"initial.rate_m.boom": 0.5}, "initial.rate_m.boom = 0.5: joint 'boom' is revolute; give initial.rate_deg"),
        ({"initial.joint_m.trolley": 9.0}, r"initial.joint_m.trolley = 9.0: outside limits_m = \[0.0, 8.0\]"),
        ({"initial.joint_m": [1.0]}, "initial.joint_m = .*: expected one number per link, 2"),
        ({"initial.joint_m": 1.0}, "expected a list of one position per link"),
        ({"link.trolley.joint.limits_deg": [0.0, 9.0]}, "limits_deg = .*: a prismatic joint takes limits_m"),
        ({"link.trolley.joint.kind": "slide"}, "allowed are 'revolute', 'prismatic'.*: a joint that slides is written"),
        ({"initial.base.xyz": [1.0, 0.0, 0.0]}, "initial.base = .*: the base is fixed"),
        ({"drive": {**GAINS, "target_deg": [0.0, 0.0]}}, "drive.target_m: missing; joint 'trolley' is prismatic"),
        ({"drive": {**GAINS, "target_deg": [9.0, 0.0], "target_m": [1.0, 0.0]}},
         "drive.target_deg.trolley = 9.0: joint 'trolley' is prismatic; give drive.target_m"),
        ({"drive": {**GAINS, "reference": {**MOVE, "to_deg": [0.0, 0.0]}}},
         "drive.reference.to_m: missing; there are prismatic joints"),
        ({"drive": {**GAINS, "reference": {**MOVE, "to_deg": [0.0, 0.0], "to_m": [9.0, 0.0]}}},
         "drive.reference reaches 9 m: outside limits_m"),
        ({"drive": {**GAINS, "reference": {
            "profile": "quintic", "to_deg": [0.0, 0.0], "to_m": [2.0, 0.0], "max_rate_deg": [0.0, 9.0]}}},
         "max_rate_m: missing; there are prismatic joints that move"),
        ({"motion": [{"link": "trolley", "times": [0.0], "angle_deg": [0.0], "rate_deg": [0.0],
                      "acceleration_deg": [0.0]}]},
         "motion.trolley.angle_deg = .*: joint 'trolley' is prismatic; give position_m, rate_m, acceleration_m"),
        ({"motion": [{"link": "trolley", "times": [0.0], "position_m": [2.0], "rate_m": [0.2],
                      "acceleration_m": [0.0]}]}, r"position_m\[0\] = 2.0: must be the initial value, 1.0"),
        ({"motion": [{"link": "trolley", "times": [0.0], "position_m": [1.0], "rate_m": [0.2]}]},
         "acceleration_m: missing"),
        ({"wrench.on": "trolley"}, "wrench.on = 'trolley': other links hang on it; allowed are boom"),
        ({"wrench.on": "bom"}, "wrench.on = 'bom': no such link; allowed are boom; did you mean 'boom'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_a_joint_is_refused_by_its_path(
    gantry: fl.Scene, changes: dict[str, Any], wanted: str
) -> None:
    with pytest.raises(fl.errors.SceneError, match=wanted):
        gantry.varied(changes)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"initial.passive": "static"}, "initial.passive = 'static': an arm on a free base has no rest"),
        ({"drive": {"kind": "computed_torque", "kp": [1.0] * 3, "kd": [1.0] * 3, "target_deg": [0.0] * 3,
                    "target_m": [0.0] * 3}}, "drive.kind = 'computed_torque': takes the base for fixed"),
        ({"base.mass": 0.0}, "base.mass = 0.0.*: a free base needs mass"),
        ({"wrench.on": "right"}, "other links hang on it; allowed are left, hand"),
    ],
)  # fmt: skip
def test_what_needs_a_fixed_base_is_refused_with_a_free_one(
    satellite: fl.Scene, changes: dict[str, Any], wanted: str
) -> None:
    with pytest.raises(fl.errors.SceneError, match=wanted):
        satellite.varied(changes)


def test_a_free_base_starts_as_it_is_told(satellite: fl.Scene) -> None:
    chain = fl.lump(satellite)
    q, qd = fl.initial_state(satellite, chain)
    assert chain.joint_names[:6] == ("base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz")
    assert q[:6].tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    assert np.allclose(qd[:6], [0, 0, 0, 0, 0, np.pi / 10], atol=1e-15)
    left = fl.tip_position(chain, q, tip="left")
    assert np.allclose(left, [1.0, 4.5, 3.0], atol=1e-15), "turned by 90° about Z, where it floats"
    assert np.array_equal(left, fl.frames(chain, q).points[chain.tips["left"]])


def test_paths_lead_to_the_base_and_to_positions(satellite: fl.Scene) -> None:
    other = satellite.varied({"base.mass": 50.0, "initial.joint_m.right": 0.25, "link.hand.on": "left"})
    assert other.values_at("base.mass") == [50.0]
    assert fl.lump(other).mass == fl.lump(satellite).mass - 50.0
    assert fl.initial_state(other, fl.lump(other))[0][7] == 0.25
    assert set(fl.lump(other).tips) == {"right", "hand"}


def test_stars_in_paths_are_joints_of_the_kind(gantry: fl.Scene) -> None:
    assert gantry.values_at("initial.joint_m.*") == [1.0]
    assert gantry.values_at("initial.joint_deg.*") == [-80.0]


def test_a_reference_leads_either_kind_of_joint_in_its_unit(gantry: fl.Scene) -> None:
    lists = {"to_deg": [0.0, -60.0], "to_m": [4.0, 0.0], "max_rate_deg": [0.0, 90.0], "max_rate_m": [1.0, 0.0]}
    course = gantry.varied({"drive": {**GAINS, "reference": {"profile": "quintic", **lists}}}).course
    assert course is not None
    (start, end), rates = course(np.array([0.0, course.knots[-1]]))[0], course(np.linspace(0, 6, 10001))[1]
    assert np.allclose(start, [1.0, np.radians(-80.0)])
    assert np.allclose(end, [4.0, np.radians(-60.0)])
    assert abs(rates[:, 0].max() - 1.0) < 1e-6, "the slower one reaches its limit, in m/s"


def test_a_table_leads_either_kind_of_joint_in_its_unit(gantry: fl.Scene) -> None:
    table = {"times": [0.0, 1.0], "angle_deg": [[0.0, -80.0], [0.0, -60.0]], "position_m": [[1.0, 0.0], [2.0, 0.0]]}
    course = gantry.varied({"drive": {**GAINS, "reference": {"profile": "linear", **table}}}).course
    assert course is not None
    assert np.allclose(course(0.5)[0], [1.5, np.radians(-70.0)])


def test_the_rigid_twin_starts_where_the_arm_does(gantry: fl.Scene) -> None:
    twin = fl.rigidified(gantry)
    chain = fl.lump(twin)
    q, qd = fl.initial_state(twin, chain)
    assert chain.joint_names == ("trolley", "boom")
    assert q.tolist() == [1.0, np.radians(-80.0)]
    assert qd.tolist() == [0.2, 0.0]


def test_places_of_kilometres_are_likely_millimetres(gantry: fl.Scene) -> None:
    assert not hints(gantry)
    (told, _) = hints(gantry.varied({"link.trolley.joint.limits_m": [0.0, 8000.0], "initial.joint_m.trolley": 1200.0}))
    assert "likely given in mm: in SI [0, 8] m" in told


def test_a_rule_with_a_hinge_at_the_root_fits_a_joint_that_slides(gantry: fl.Scene) -> None:
    sliding = {"joint.kind": "prismatic", "lumping": "lobatto2"}
    lone = gantry.varied({"initial": None}).varied({f"link.boom.{key}": value for key, value in sliding.items()})
    assert fl.lump(lone).n == 4


def test_pictures_join_no_tip_with_the_next_branch(satellite: fl.Scene) -> None:
    chain = fl.lump(satellite)
    lines = as_lines(chain, fl.frames(chain, np.zeros(chain.n)).points)
    assert branches_of(chain) == [[2, 3, 4], [2, 5, 6, 7]]
    assert np.isnan(lines).all(axis=1).tolist() == [False, False, False, True, False, False, False, False]
    assert np.array_equal(lines[0], lines[4]), "both begin at the base"
