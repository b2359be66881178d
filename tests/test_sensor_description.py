"""Sensors as data: read from a file, varied by name, and refused where they do not fit the arm."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from conftest import make_scene

import flexlink as fl
from flexlink.describe.scene import scene_from

BENDS = {"length": 1.0, "flex": "z", "segments": 5, "material": "aluminium", "section": "square"}
GAUGE = {"name": "root", "kind": "strain", "link": "boom", "x": 0.1, "fibre": (0.0, 0.02)}
PLACE = {"name": "marker", "kind": "position", "link": "boom"}


def scene_with(*sensors: dict, **link: object) -> fl.Scene:
    return make_scene(fl.Link(name="boom", **BENDS | link), sensor=tuple(fl.Sensor(**sensor) for sensor in sensors))


def test_a_sensor_is_varied_by_its_name_or_number() -> None:
    scene = scene_with(GAUGE, PLACE).varied({"sensor.root.gain": 2.0, "sensor.2.noise": 1e-3})
    assert [(each.gain, each.noise) for each in scene.sensor] == [(2.0, 0.0), (1.0, 1e-3)]


def test_columns_are_named_with_their_unit() -> None:
    assert fl.Sensor(**PLACE).columns() == ("marker x [m]", "marker y [m]", "marker z [m]")
    assert fl.Sensor(name="e", kind="joint", link=1).columns() == ("e [rad]",)
    assert fl.Sensor(name="e", kind="torque", link=1).columns(slides=True) == ("e [N]",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fibre": None}, r"fibre: missing; kind 'strain' needs it"),
        ({"axis": (1, 0, 0)}, r"axis = \(1.*\): kind 'strain' takes x, fibre"),
        ({"x": 1.5}, r"sensor\.root\.x = 1.5: beyond the beam of link 'boom', which is 1 m long"),
        ({"link": "bom"}, r"sensor\.root\.link = 'bom'"),
        ({"link": "base"}, r"sensor\.root\.link = 'base': the base is fixed"),
        ({"unit": "µm/m"}, r"unit = 'µm/m': the column would be in 1; give gain = 1000000, µm/m per 1, or leave"),
        ({"gain": 0}, r"gain = 0.0: must not be 0"),
        ({"order": 2}, r"order = 2: has no effect without low_pass"),
        ({"seed": 2}, r"seed = 2: has no effect without noise"),
        ({"noise": 1e308}, r"noise = 1e\+308: expected float <= 1e\+30"),
        ({"noise": 1e-308}, r"noise = 1e-308: must be 0, or at least 1e-30"),
        ({"gain": -1e308}, r"gain = -1e\+308: expected float >= -1e\+30"),
        ({"bias": 1e308}, r"bias = 1e\+308: expected float <= 1e\+30"),
        ({"resolution": 5e-324}, r"resolution = 5e-324: expected float >= 1e-30"),
        ({"name": "tip"}, r"name = 'tip': columns of a run are called so"),
        ({"name": "tau boom"}, r"name = 'tau boom': columns of a run are called so"),
        ({"name": "a [V]"}, r"name = 'a \[V\]': expected a text without brackets"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_name(changes: dict, message: str) -> None:
    with pytest.raises(fl.errors.SceneError, match=message):
        scene_with(GAUGE | changes)


def test_a_column_in_another_unit_of_what_is_measured_needs_its_gain() -> None:
    for kind, unit, factor in (("joint", "deg", 57.29577951), ("joint", "mm", 1000), ("torque", "N mm", 1000)):
        message = rf"unit = '{unit}': the column would be in .*; give gain = {factor}"
        with pytest.raises(fl.errors.SceneError, match=message):
            fl.Sensor(name="s", kind=kind, link=1, unit=unit)
        assert fl.Sensor(name="s", kind=kind, link=1, unit=unit, gain=factor).columns() == (f"s [{unit}]",)
    assert fl.Sensor(name="s", kind="torque", link=1, unit="V").columns() == ("s [V]",)  # 1 V per N m


def test_two_places_and_two_names_are_refused() -> None:
    with pytest.raises(fl.errors.SceneError, match=r"point = .*: x = 0.5 is given, too; give only one"):
        fl.Sensor(**PLACE, x=0.5, point=(0, 0, 0))
    with pytest.raises(fl.errors.SceneError, match=r"sensor\.2\.name = 'marker': names of sensors must differ"):
        scene_with(PLACE, PLACE)


def test_a_rigid_link_has_no_strain_and_a_locked_joint_no_angle() -> None:
    stiff = {"flex": "rigid", "segments": 1}
    with pytest.raises(fl.errors.SceneError, match=r"link = 'boom': is rigid; a strain gauge needs a link that bends"):
        scene_with(GAUGE, **stiff)
    with pytest.raises(fl.errors.SceneError, match=r"link = 'boom': its joint is locked; a joint sensor needs one"):
        scene_with({"name": "e", "kind": "joint", "link": "boom"}, joint=fl.Joint(locked=True))


def test_one_pair_of_brackets_is_named() -> None:
    table = tomllib.loads(scene_with(PLACE).to_toml().replace("[[sensor]]", "[sensor]"))
    with pytest.raises(fl.errors.SceneError, match=r"sensor = .*: expected \[\[sensor\]\], a table for each sensor"):
        scene_from(table)


@pytest.mark.slow
def test_readings_at_the_ends_of_what_is_allowed_are_finite() -> None:
    extremes = {"noise": 1e30, "gain": 1e30, "bias": -1e30, "resolution": 1e-30}
    place = {key: value for key, value in extremes.items() if key != "resolution"}
    scene = scene_with(GAUGE | extremes | {"noise": 0.0, "gain": 1.0, "bias": 1.0}, PLACE | place)
    run = fl.simulate(scene, duration=0.01, sample=0.005)
    assert all(np.isfinite(column).all() for column in run.readings.values())
