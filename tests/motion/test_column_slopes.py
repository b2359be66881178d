"""Sensitivities of all columns of a run, including sensors, agree with finite differences."""

from __future__ import annotations

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import flexible, make_scene
from tests.support.words import refused

SENSORS = (
    fl.Sensor(name="gauge", kind="strain", link="boom", x=0.1, fibre=(0.02, 0.0), low_pass=30.0, order=2, delay=0.003,
              noise=1e-3, resolution=1e-3),
    fl.Sensor(name="imu", kind="accelerometer", link="boom", x=0.7, axis=(0, 1, 0)),
)  # fmt: skip
RUN = fl.RunSettings(method="RK4", step=2e-4, duration=0.1, sample=0.01)
COLUMNS = "gauge [1]", "imu [m/s²]", "tip y [m]", "tau boom [N m]", "kinetic [J]"


def scene_of(ratio: float) -> fl.Scene:
    boom = flexible("boom", segments=3, damping=fl.Damping(ratio=ratio, at_hz=5.0), joint=fl.Joint(armature=0.5))
    drive = fl.Drive(kind="pd", kp=(300.0,), kd=(20.0,), target_deg=(30.0,))
    return make_scene(boom, drive=drive, sensor=SENSORS, gravity=(0, -9.81, 0), run=RUN, tip=fl.RigidBody(mass=2.0))


@pytest.mark.parametrize("path", ["tip.mass", "material.aluminium.young", "drive.kp.boom", "link.boom.length"])
def test_column_sensitivities_agree_with_finite_differences_of_runs(path: str) -> None:
    scene = scene_of(0.01)
    slopes = fl.sensitivities(scene, [path])
    smooth = scene.varied({"sensor.gauge.noise": None, "sensor.gauge.resolution": None})
    h = 1e-4 * slopes.values[0]
    runs = [fl.simulate(smooth.varied({path: slopes.values[0] + step * h})).columns for step in (1, -1, 2, -2)]
    for name in COLUMNS:
        near, nearer, far, farther = (columns[name] for columns in runs)
        exact = (8 * (near - nearer) - (far - farther)) / (12 * h)
        np.testing.assert_allclose(
            slopes.column(name)[:, 0], exact, rtol=0, atol=1e-7 * np.abs(exact).max(), err_msg=name
        )
        assert np.abs(slopes.column(name)[:, 0] - exact).max() <= 4 * slopes.column_error(name)[0]


def test_a_parameter_at_its_lower_bound_uses_one_sided_differences() -> None:
    """The arm is undamped, so its damping cannot decrease."""
    slopes = fl.sensitivities(scene_of(0.0), ["link.boom.damping.ratio"])
    near = [
        fl.sensitivities(scene_of(ratio), ["link.boom.damping.ratio"]).column("imu [m/s²]") for ratio in (1e-8, 2e-8)
    ]
    expected = 2 * near[0] - near[1]
    found = slopes.column("imu [m/s²]")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    assert np.abs(found).max() > 0


def test_work_has_a_sensitivity_but_imbalance_and_time_do_not() -> None:
    slopes = fl.sensitivities(scene_of(0.01), ["tip.mass"])
    energy = sum(slopes.column(f"{name} [J]") for name in ("kinetic", "gravity", "elastic"))
    work = slopes.column("work [J]")
    assert np.abs(energy - energy[0] - work).max() <= 1e-6 * np.abs(work).max()
    for name in ("imbalance [J]", "t [s]", "tip y"):
        with refused(fl.errors.ArgumentError, "unknown-name"):
            slopes.column(name)
