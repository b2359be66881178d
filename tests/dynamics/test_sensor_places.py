"""Places and readings of sensors, checked by other means than in `test_sensors`: hinge rates, moments, markers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.describe.sensor import Sensor
from flexlink.dynamics.sensors.columns import coarse_samples
from flexlink.dynamics.sensors.instrument import Signal
from tests.conftest import SQUARE, flexible, make_scene

STILL = fl.RunSettings(duration=0.0, sample=0.01)


def shown(scene: fl.Scene, q: np.ndarray, qd: np.ndarray, *sensors: Sensor) -> dict[str, float]:
    """Readings of sensors in one state."""
    run = fl.simulate(scene.varied({"sensor": sensors, "run": STILL}), q0=q, qd0=qd)
    return {name: float(run.columns[name][0]) for name in run.sensor_names}


def test_sensor_directions_are_in_the_link_frame_for_any_mount() -> None:
    """Only the second link rotates, about its z axis at 2 rad/s, which is another direction in frame 0."""
    rpy = (40.0, -25.0, 70.0)
    rod = {"length": 0.5, "material": "aluminium", "section": "square"}
    scene = make_scene(fl.Link(name="a", **rod), fl.Link(name="b", mount=fl.Mount(rpy_deg=rpy), **rod))
    axes = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "skew": (0.0, 3.0, 4.0)}
    gyros = [Sensor(name=name, kind="gyroscope", link="b", axis=axis) for name, axis in axes.items()]
    seen = list(shown(scene, np.zeros(2), np.array([0.0, 2.0]), *gyros).values())
    np.testing.assert_allclose(seen, [0.0, 0.0, 2.0, 1.6], atol=1e-14)
    about_first = Rotation.from_euler("xyz", rpy, degrees=True).inv().apply([0.0, 0.0, 3.0])
    seen = list(shown(scene, np.zeros(2), np.array([3.0, 0.0]), *gyros).values())
    np.testing.assert_allclose(seen, [*about_first, about_first @ [0.0, 0.6, 0.8]], atol=1e-14)


@pytest.mark.parametrize("length", [0.5, 3.0])
def test_a_marker_on_the_beam_axis_equals_the_place_along_it(length: float, rng: np.random.Generator) -> None:
    scene = make_scene(flexible("a", segments=6, length=length, lumping="midpoint"))
    q = rng.uniform(-0.3, 0.3, fl.lump(scene).n)
    for x in np.array([0.05, 0.3, 0.55, 0.95]) * length:
        by_point = Sensor(name="point", kind="position", link="a", point=(x, 0.0, 0.0))
        seen = shown(scene, q, 0 * q, by_point, Sensor(name="x", kind="position", link="a", x=x))
        one, other = np.array(list(seen.values())).reshape(2, 3)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * length)


def test_at_a_hinge_a_sensor_sits_on_the_outer_segment(rng: np.random.Generator) -> None:
    """The measured rate is the sum of the rates of the joint and of all hinges up to and including that hinge."""
    scene = make_scene(flexible("a", segments=4, length=1.0, lumping="midpoint"))
    qd = rng.normal(size=fl.lump(scene).n)
    hinges = fl.strength.beam_strain(scene, 0 * qd, link="a", fibre=(0.0, 0.0)).x
    assert len(hinges) == len(qd) - 1
    gyros = [Sensor(name=f"g{k}", kind="gyroscope", link="a", x=float(x), axis=(0, 0, 1)) for k, x in enumerate(hinges)]
    seen = list(shown(scene, 0 * qd, qd, *gyros).values())
    np.testing.assert_allclose(seen, np.cumsum(qd)[1:], atol=1e-13)


@pytest.mark.parametrize("x", [0.2, 0.47, 0.8])
def test_between_hinges_the_strain_of_a_uniform_load_is_a_parabola(x: float) -> None:
    """ε = ρ A g (L − x)² / 2 · y / (E I), which linear interpolation between two hinges would miss."""
    length, width, young = 1.25, 0.04, 7e19
    beam = flexible("beam", lumping="gauss", segments=7, joint=fl.Joint(locked=True))
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=x, fibre=(width / 2, 0.0))
    scene = make_scene(
        beam, gravity=(0, -9.81, 0), initial=fl.InitialState(passive="static"), sensor=(gauge,), run=STILL
    ).varied({"material.aluminium.young": young})
    moment = 2700.0 * width**2 * 9.81 * (length - x) ** 2 / 2
    expected = moment * width / 2 / (young * SQUARE.properties.i_z)
    assert fl.simulate(scene).columns["gauge [1]"][0] == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_bending_about_both_axes_strains_a_beam_with_a_rigidity_table() -> None:
    """ε = z κ_y − y κ_z: a rigidity table with the values of a section gives the strains of that section."""
    area, second = 0.04**2, SQUARE.properties.i_z
    table = fl.Rigidity(x=(0.0, 1.25), ei_y=(70e9 * second,) * 2, ei_z=(70e9 * second,) * 2, rho_a=(2700 * area,) * 2)
    plain = make_scene(flexible("a", "yz", 4, lumping="midpoint"))
    tabled = plain.varied({"rigidity": {"t": table}, "link.a.material": None, "link.a.section": None,
                           "link.a.rigidity": "t"})  # fmt: skip
    q = np.linspace(-0.01, 0.02, fl.lump(plain).n)
    fibres = [(y, z) for y in (0.0, 0.02) for z in (0.0, 0.01)]
    gauges = [Sensor(name=f"{place}", kind="strain", link="a", x=0.4, fibre=place) for place in fibres]
    one, other = (list(shown(scene, q, 0 * q, *gauges).values()) for scene in (plain, tabled))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert abs(one[1]) > 1e-6
    assert abs(one[2]) > 1e-6


def test_a_second_sample_at_the_same_time_replaces_the_first() -> None:
    signal = Signal(1, ())
    signal.add(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [1.0], [2.0]]))
    signal.add(np.array([2.0]), np.array([[5.0]]))
    assert signal.count == 3
    np.testing.assert_array_equal(signal.at(np.array([1.0, 1.5, 2.0]))[:, 0], [1.0, 3.0, 5.0])


def test_a_linear_model_shows_gain_times_signal_plus_bias() -> None:
    scene = make_scene(flexible("a"), sensor=(Sensor(name="encoder", kind="joint", link="a", gain=3.0, bias=0.7),))
    q = np.zeros(fl.lump(scene).n)
    q[0] = 0.2
    model = fl.linearize(fl.lump(scene), q, outputs=(fl.small_motion.SensorOutputs(scene),))
    assert model.y[0] == pytest.approx(3.0 * 0.2 + 0.7, abs=1e-14)


@pytest.mark.parametrize("blur", [{"noise": 1e3}, {"resolution": 50.0}])
def test_noise_and_resolution_do_not_affect_the_warning_on_sparse_samples(blur: dict[str, float]) -> None:
    """A swinging arm has a warning, because the delay needs values between samples; an arm at rest has none."""
    sensors = [Sensor(name="encoder", kind="joint", link="a", delay=0.3, **more) for more in ({}, blur)]
    scene = make_scene(flexible("a"), gravity=(0.0, -9.81, 0.0))
    run = fl.simulate(scene, method="Radau5", step=1e-3, sample=0.2, duration=2.0)
    scenes = [scene.varied({"sensor": (sensor,), "run.sample": 0.2}) for sensor in sensors]
    plain, blurred = (list(coarse_samples(each, run)) for each in scenes)
    assert blurred == plain
    assert len(plain) == 1
    rest = dataclasses.replace(run, q=0 * run.q)
    assert not list(coarse_samples(scenes[1], rest))
