"""Sensors as data: read from a file, varied by name, and refused where they do not fit the arm."""

import tomllib

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.scene import scene_from
from tests.conftest import make_scene
from tests.support.words import refused

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


REFUSED = {
    "missing-key": [{"fibre": None}],
    "key-of-another-kind": [{"axis": (1, 0, 0)}],
    "out-of-range": [{"x": 1.5}],
    "unknown-link": [{"link": "bom"}],
    "sensor-on-fixed-part": [{"link": "base"}],
    "unit-missing": [{"unit": "µm/m"}],
    "zero-gain": [{"gain": 0}],
    "needs-another-key": [{"order": 2}, {"seed": 2}],
    "wrong-value": [{"noise": 1e308}, {"gain": -1e308}, {"bias": 1e308}, {"resolution": 5e-324}],
    "noise-too-small": [{"noise": 1e-308}],
    "sensor-name": [{"name": "tip"}, {"name": "tau boom"}, {"name": "a [V]"}],
    "link-is-rigid": [{"flex": "rigid", "segments": 1}],
}


@pytest.mark.parametrize("id", REFUSED)
def test_quantities_that_cannot_be_measured_are_refused_by_name(id: str) -> None:
    for changes in REFUSED[id]:
        link = changes if id == "link-is-rigid" else {}
        with refused(fl.errors.SceneError, id):
            scene_with(GAUGE | (changes if not link else {}), **link)


def test_a_measured_column_in_another_unit_needs_a_gain() -> None:
    for kind, unit, factor in (
        ("joint", "deg", 57.29577951), ("joint", "mm", 1000), ("torque", "N mm", 1000),
        ("accelerometer", "g", 0.1019716213),
    ):  # fmt: skip
        with refused(fl.errors.SceneError, "unit-missing") as caught:
            fl.Sensor(name="s", kind=kind, link=1, unit=unit)
        assert f" {factor} ({unit} per " in str(caught.value)
        axes = (" x", " y", " z") if kind == "accelerometer" else ("",)
        columns = fl.Sensor(name="s", kind=kind, link=1, unit=unit, gain=factor).columns()
        assert columns == tuple(f"s{axis} [{unit}]" for axis in axes)
    assert fl.Sensor(name="s", kind="torque", link=1, unit="V").columns() == ("s [V]",)  # 1 V per N m


def test_two_places_of_one_sensor_and_duplicate_names_are_refused() -> None:
    with refused(fl.errors.SceneError, "both-given"):
        fl.Sensor(**PLACE, x=0.5, point=(0, 0, 0))
    with refused(fl.errors.SceneError, "name-twice"):
        scene_with(PLACE, PLACE)


def test_a_locked_joint_has_no_angle() -> None:
    with refused(fl.errors.SceneError, "sensor-of-locked-joint"):
        scene_with({"name": "e", "kind": "joint", "link": "boom"}, joint=fl.Joint(locked=True))


def test_single_brackets_instead_of_double_ones_are_reported() -> None:
    table = tomllib.loads(scene_with(PLACE).to_toml().replace("[[sensor]]", "[sensor]"))
    with refused(fl.errors.SceneError, "wrong-value"):
        scene_from(table)


@pytest.mark.slow
def test_readings_at_the_limits_of_allowed_settings_are_finite() -> None:
    extremes = {"noise": 1e30, "gain": 1e30, "bias": -1e30, "resolution": 1e-30}
    place = {key: value for key, value in extremes.items() if key != "resolution"}
    scene = scene_with(GAUGE | extremes | {"noise": 0.0, "gain": 1.0, "bias": 1.0}, PLACE | place)
    run = fl.simulate(scene, duration=0.01, sample=0.005)
    assert all(np.isfinite(column).all() for column in run.readings.values())
