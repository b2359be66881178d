"""Sensor readings agree with closed forms, exact filters, and readings in other runs."""

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.data.csv_table import read_measured
from flexlink.describe.sensor import Sensor
from flexlink.dynamics.notes import notes
from flexlink.dynamics.sensors.instrument import Instrument, Signal, coarse_samples, noise
from flexlink.dynamics.sensors.signals import signal_of, slopes_of
from tests.conftest import MODELS, SQUARE, flexible, make_scene
from tests.motion.test_ties import fourbar
from tests.support.words import refused

LENGTH, WIDTH = 1.25, 0.04
TURN = {"times": (0.0, 2.0), "rate_deg": (90.0, 90.0), "acceleration_deg": (0.0, 0.0), "angle_deg": (0.0, 180.0)}


def turning(*sensors: Sensor, **fields: object) -> fl.Trajectory:
    """A rigid rod that turns at π/2 rad/s about Z, in gravity along −Y."""
    rod = fl.Link(name="rod", length=LENGTH, material="aluminium", section="square")
    scene = make_scene(
        rod, motion=(fl.PrescribedMotion(link="rod", **TURN),), gravity=(0.0, -9.81, 0.0), sensor=sensors,
        initial=fl.InitialState(joint_deg=(0.0,), rate_deg=(90.0,)), **fields,
    )  # fmt: skip
    return fl.simulate(scene.varied({"run.step": 1e-3, "run.duration": 1.0, "run.sample": 0.01}))


def test_sensors_on_a_rod_of_constant_rate_agree_with_formulas() -> None:
    ω, r = np.pi / 2, 0.5
    run = turning(
        Sensor(name="imu", kind="accelerometer", link="rod", x=r), Sensor(name="gyro", kind="gyroscope", link="rod"),
        Sensor(name="marker", kind="position", link="rod", point=(r, 0.1, 0.2)),
        Sensor(name="across", kind="accelerometer", link="rod", x=r, axis=(0, -2, 0)),
        Sensor(name="encoder", kind="joint", link="rod"), Sensor(name="motor", kind="torque", link="rod"),
        Sensor(name="amps", kind="current", link="rod", torque_constant=0.5, gain=1e3, unit="mA"),
    )  # fmt: skip
    seen, θ, none = run.columns, ω * run.t, 0 * run.t
    mass = 2700.0 * WIDTH**2 * LENGTH
    expected = {
        "imu x [m/s²]": 9.81 * np.sin(θ) - ω**2 * r, "imu y [m/s²]": 9.81 * np.cos(θ), "imu z [m/s²]": none,
        "gyro x [rad/s]": none, "gyro y [rad/s]": none, "gyro z [rad/s]": none + ω,
        "marker x [m]": r * np.cos(θ) - 0.1 * np.sin(θ), "marker y [m]": r * np.sin(θ) + 0.1 * np.cos(θ),
        "marker z [m]": none + 0.2, "across [m/s²]": -9.81 * np.cos(θ), "encoder [rad]": θ,
        "motor [N m]": mass * 9.81 * LENGTH / 2 * np.cos(θ),
        "amps [mA]": 1e3 * mass * 9.81 * LENGTH / 2 * np.cos(θ) / 0.5,
    }  # fmt: skip
    assert list(seen)[-len(expected) :] == list(expected)
    for name, column in expected.items():
        np.testing.assert_allclose(seen[name], column, rtol=0, atol=1e-10 * max(1.0, abs(column).max()), err_msg=name)


def cantilever(*sensors: Sensor, lumping: str = "gauss", segments: int = 9, **link: object) -> fl.Scene:
    beam = flexible("beam", lumping=lumping, segments=segments, joint=fl.Joint(locked=True), **link)
    return make_scene(beam, wrench=fl.Wrench(force=(0, -20.0, 0)), initial=fl.InitialState(passive="static"),
                      sensor=sensors, gravity=(0, 0, 0), run=fl.RunSettings(duration=0.0, sample=0.01))  # fmt: skip


@pytest.mark.parametrize("lumping", ["gauss", "midpoint", "lobatto2", "hencky"])
@pytest.mark.parametrize("x", [0.0, 0.3, 1.1])
def test_a_gauge_on_a_loaded_beam_shows_its_moment(lumping: str, x: float) -> None:
    """ε = M y / (E I): the moment of a load at the tip is linear along a beam that hardly bends."""
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=x, fibre=(WIDTH / 2, 0.0), gain=1e6, unit="µm/m")
    scene = cantilever(gauge, lumping=lumping).varied({"material.aluminium.young": 70e18})
    expected = 1e6 * 20.0 * (LENGTH - x) * WIDTH / 2 / (70e18 * SQUARE.properties.i_z)
    assert fl.simulate(scene).columns["gauge [µm/m]"][0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(("segments", "x"), [(5, 0.2), (7, 0.2), (7, 0.47), (7, 0.8)])
def test_from_three_hinges_on_the_strain_of_a_uniform_load_is_a_parabola(segments: int, x: float) -> None:
    """ε = ρ A g (L − x)² / 2 · y / (E I), which linear interpolation between two hinges would miss."""
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=x, fibre=(WIDTH / 2, 0.0))
    weight = {"wrench": None, "gravity": (0, -9.81, 0), "material.aluminium.young": 7e19}
    moment = 2700.0 * WIDTH**2 * 9.81 * (LENGTH - x) ** 2 / 2
    expected = moment * WIDTH / 2 / (7e19 * SQUARE.properties.i_z)
    found = fl.simulate(cantilever(gauge, segments=segments).varied(weight)).columns["gauge [1]"][0]
    assert found == pytest.approx(expected, rel=1e-9, abs=0.0)


def shown(t: np.ndarray, u: np.ndarray, times: np.ndarray | None = None, **fields: object) -> np.ndarray:
    instrument = Instrument(Sensor(**{"name": "s", "kind": "joint", "link": 1} | fields), 0.01)
    instrument.signal.add(t, u[:, None])
    return instrument.readings(t if times is None else times)[:, 0]


def test_readings_are_held_between_instants_and_rounded() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    found = shown(t, t, rate=20.0, resolution=0.02)
    np.testing.assert_allclose(found, 0.02 * np.round(np.floor(20 * t + 1e-9) / 20 / 0.02), rtol=0, atol=1e-14)
    assert len(np.unique(found)) == 20
    np.testing.assert_allclose(shown(t, t, rate=100.0), t, rtol=0, atol=1e-14)  # in floats, 0.29 · 100 < 29


def test_noise_is_white_and_normal_and_repeatable_by_its_seed() -> None:
    t = np.arange(0.0, 200.0, 0.01)
    still, some = np.zeros_like(t), slice(1000, 1100)
    first = shown(t, still, noise=0.3, seed=1)
    assert first.std() == pytest.approx(0.3, rel=0.02)
    assert abs(first.mean()) < 0.01
    assert np.abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.03
    assert np.mean(np.abs(first) < 0.3) == pytest.approx(0.6827, abs=0.01)
    np.testing.assert_array_equal(shown(t, still, t[some], noise=0.3, seed=1), first[some])
    for other in ({"seed": 2}, {"seed": 1, "name": "other"}):
        assert abs(np.corrcoef(first, shown(t, still, noise=0.3, **other))[0, 1]) < 0.03


def test_noise_of_a_seed_does_not_change_with_numpy_versions() -> None:
    """Noise comes from Philox with our own conversion to a normal distribution, so NumPy versions do not change it."""
    found = shown(np.arange(3) / 100, np.zeros(3), noise=1.0, seed=1)
    np.testing.assert_allclose(found, [1.4092493637369143, 0.7193025410542524, -1.4400850108307892], rtol=1e-12)
    np.testing.assert_allclose(
        noise("1 s", np.arange(256.0, 259.0)), [1.1931000311153763, -0.7118232722036318, 1.0859994016770351], rtol=1e-12
    )


ARM = {"gravity": (0.5, -9.0, 1.0)}
SENSORS = (
    {"kind": "strain", "link": "upper", "x": 0.4, "fibre": (0.01, 0.02)},
    {"kind": "accelerometer", "link": "upper", "x": 0.4}, {"kind": "gyroscope", "link": "fore"},
    {"kind": "position", "link": "upper", "point": (0.7, 0.1, 0.0)}, {"kind": "joint", "link": "fore"},
    {"kind": "torque", "link": "fore"}, {"kind": "current", "link": "upper", "torque_constant": 2.0},
)  # fmt: skip


class Here:
    """One state with the attributes of a run."""

    def __init__(self, chain: fl.Chain, *parts: np.ndarray) -> None:
        self.chain, (self.q, self.qd, self.qdd, self.tau) = chain, (part[None] for part in parts)


@pytest.mark.parametrize("fields", SENSORS, ids=lambda fields: fields["kind"])
@pytest.mark.parametrize("lumping", ["gauss", "lobatto2_rotation"])
def test_derivatives_of_readings_agree_with_finite_differences(fields: dict, lumping: str, rng) -> None:
    slide = fl.Joint(kind="prismatic", axis=(0, 1, 0))
    links = (
        fl.Link(name="rail", joint=slide, hub=fl.RigidBody(mass=1.0)),
        flexible("upper", "xyz", lumping=lumping, mount=fl.Mount(rpy_deg=(20.0, 30.0, 0.0))), flexible("fore", "yz"),
    )  # fmt: skip
    scene, sensor = make_scene(*links, **ARM), Sensor(name="s", **fields)
    chain = fl.lump(scene)
    parts = rng.uniform(-0.5, 0.5, (4, chain.n))
    slopes, h = slopes_of(sensor, scene, chain, *parts[:3]), 1e-3
    for which, name in enumerate(("q", "qd", "qdd", "tau")):
        slope = slopes.get(name, np.zeros((len(sensor.components), chain.n)))
        for k in range(chain.n):
            values = []
            for step in (h, -h, 2 * h, -2 * h):
                moved = parts.copy()
                moved[which, k] += step
                values.append(signal_of(sensor, scene, Here(chain, *moved))[:, 0])
            near, nearer, far, farther = values
            found = (8 * (near - nearer) - (far - farther)) / (12 * h)
            np.testing.assert_allclose(slope[:, k], found, rtol=0, atol=1e-10 * max(1.0, np.abs(slope).max()))


def test_sensor_columns_are_saved_and_read_back(tmp_path: Path) -> None:
    gauge = Sensor(name="a, b", kind="strain", link="beam", x=0.1, fibre=(0.02, 0.0), noise=1e-6, low_pass=20.0)
    run = fl.simulate(cantilever(gauge).varied({"run.duration": 0.05}))
    assert run.columns["a, b [1]"].std() > 0
    again = fl.Trajectory.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.columns["a, b [1]"], run.columns["a, b [1]"])
    with np.load(tmp_path / "run.npz") as archive:
        assert archive["sensors"].tolist() == ["a, b [1]"]
        np.testing.assert_array_equal(archive["readings"][0], run.columns["a, b [1]"])
    head, *_ = csv.reader(run.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines())
    assert head == list(run.columns)
    assert "a, b [1]" in run.to_pandas()
    np.testing.assert_array_equal(run.to_xarray()["readings"].sel(sensor="a, b [1]"), run.columns["a, b [1]"])


def test_a_sweep_records_and_varies_a_sensor() -> None:
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=0.1, fibre=(0.02, 0.0))
    scene = cantilever(gauge).varied({"run.duration": 0.02})
    plan = fl.Sweep(
        scene=scene, grid={"sensor.gauge.gain": [2.0, 5.0], "material.aluminium.young": [50e9, 70e9]},
        quantity={"most": {"of": "gauge [1]", "take": "largest"}},
    )  # fmt: skip
    table = fl.sweep(plan)
    for gain, young, most in zip(*map(table.column, [*plan.grid, "most"]), strict=True):
        run = fl.simulate(scene.varied({"sensor.gauge.gain": gain, "material.aluminium.young": young}))
        assert most == np.abs(run.columns["gauge [1]"]).max() > 0
    assert len(set(table.column("most"))) == 4


def test_a_sensor_on_the_base_is_refused_and_one_beyond_the_first_hinge_is_allowed() -> None:
    """The first segment of a clamped beam is part of the base."""
    near, far = (Sensor(name="imu", kind="accelerometer", link="beam", x=x) for x in (0.01, 0.9))
    with refused(fl.errors.SceneError, "sensor-on-fixed-part"):
        fl.simulate(cantilever(near))
    marker = Sensor(name="end", kind="position", link="beam")
    run = fl.simulate(cantilever(far, marker).varied({"gravity": (0, 0, -9.81), "wrench": None}))
    np.testing.assert_allclose([run.columns[f"imu {axis} [m/s²]"][0] for axis in "xyz"], [0, 0, 9.81], atol=1e-10)
    np.testing.assert_array_equal([run.columns[f"end {axis} [m]"][0] for axis in "xyz"], run.tip[0])


def test_sensors_on_a_free_base_measure_its_motion(models: Path) -> None:
    scene = fl.load_scene(models / "satellite.toml").varied({"run.duration": 0.2})
    sensors = (Sensor(name="gyro", kind="gyroscope", link="base"), Sensor(name="place", kind="position", link="base"))
    run = fl.simulate(scene.varied({"sensor": sensors}))
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(run.columns[f"gyro {axis} [rad/s]"], run.base.spin[:, k], rtol=0, atol=1e-10)
        np.testing.assert_allclose(run.columns[f"place {axis} [m]"], run.q[:, k], rtol=0, atol=1e-12)


INSTRUMENTS = (
    Sensor(name="gauge", kind="strain", link="upper", x=0.3, fibre=(0.01, 0.02), low_pass=30.0, order=3, gain=1e6,
           unit="µm/m", bias=5.0),
    Sensor(name="imu", kind="accelerometer", link="fore", point=(0.4, 0.0, 0.1), axis=(0, 1, 1),
           filter=({"notch": 50.0, "damping": 0.2}, {"numerator": (1.0, 3.0), "denominator": (0.01, 1.0)})),
    Sensor(name="gyro", kind="gyroscope", link="fore", axis=(0, 0, 1), low_pass=10.0, delay=0.01, order=2),
    Sensor(name="motor", kind="current", link="upper", torque_constant=0.5, low_pass=100.0),
    Sensor(name="encoder", kind="joint", link="fore"), Sensor(name="marker", kind="position", link="fore"),
)  # fmt: skip


def two_links(**fields: object) -> fl.Scene:
    links = flexible("upper", "xyz", mount=fl.Mount(rpy_deg=(20.0, 30.0, 0.0))), flexible("fore", "yz")
    return make_scene(*links, gravity=(0.5, -9.0, 1.0), sensor=INSTRUMENTS, **fields)


def test_a_linear_model_has_sensors_as_outputs_next_to_a_moving_state(rng: np.random.Generator) -> None:
    scene = two_links()
    chain, outputs = fl.lump(scene), (fl.small_motion.SensorOutputs(scene), "tip")
    n, driven = chain.n, chain.active
    q, qd, tau = rng.uniform(-0.3, 0.3, n), rng.normal(size=n), np.zeros(n)
    tau[driven] = 1.0, -2.0
    model = fl.linearize(chain, q, qd, tau, outputs=outputs)
    δx, δu = rng.normal(size=2 * n), rng.normal(size=len(driven))
    values = []
    for h in 1e-3 * np.array([1, -1, 2, -2]):
        moved = tau.copy()
        moved[driven] += h * δu
        there = fl.linearize(chain, q + h * δx[:n], qd + h * δx[n:], moved, outputs=outputs)
        values.append(np.concatenate([there.y, there.x[2 * n :]]))
    near, nearer, far, farther = values
    slope = (8 * (near - nearer) - (far - farther)) / 12e-3
    moving = model.A[2 * n :, : 2 * n] @ δx + model.B[2 * n :] @ δu
    settled = -np.linalg.solve(model.A[2 * n :, 2 * n :], moving)
    expected = np.concatenate([model.C @ np.concatenate([δx, settled]) + model.D @ δu, settled])
    np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert model.delays.tolist() == [0.01 if "gyro" in name else 0.0 for name in model.outputs]
    assert len(model.eigenvalues) == len(model.states) == 2 * n + 3 + 3 + 2 + 1
    assert len(model.y) == len(model.outputs) == len(outputs[0].sensors) + 2 + 3


def test_a_law_receives_the_readings_of_sensors() -> None:
    scene = two_links().varied({"run.step": 1e-3, "run.sample": 0.01, "run.duration": 0.1, "run.method": "Radau5"})
    received = []

    def law(t: float, q: np.ndarray, qd: np.ndarray, sensors: dict[str, float]) -> np.ndarray:
        received.append(sensors)
        return np.array([5.0, -300.0 * sensors["encoder [rad]"]])

    run = fl.simulate(scene, control=law, rate=100.0)
    by_state = fl.simulate(scene, control=lambda t, q, qd: [5.0, -300.0 * q[run.chain.index("fore", 0, 0)]], rate=100.0)
    np.testing.assert_array_equal(run.q, by_state.q)
    for name in ("gauge [µm/m]", "encoder [rad]", "gyro [rad/s]", "marker x [m]"):
        column = run.columns[name]
        np.testing.assert_allclose(
            [row[name] for row in received], column[: len(received)], rtol=0, atol=1e-10 * np.abs(column).max()
        )


def test_a_control_law_with_sensors_needs_sensors_and_a_rate() -> None:
    def law(t: float, q: np.ndarray, qd: np.ndarray, sensors: dict[str, float]) -> np.ndarray:
        return np.zeros(2)

    scene = two_links().varied({"run.step": 1e-3, "run.duration": 0.1})
    with refused(fl.errors.ArgumentError, "controller-needs-rate"):
        fl.simulate(scene, control=law)
    with refused(fl.errors.ArgumentError, "no-sensors"):
        fl.simulate(scene.varied({"sensor": None}), control=law, rate=100.0)


def test_only_samples_too_far_apart_for_a_low_pass_filter_are_reported() -> None:
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=0.1, fibre=(0.02, 0.0), low_pass=50.0)
    scene = cantilever(gauge).varied({"initial.passive": "zero", "run.duration": 0.4, "run.tolerance": 1e-5})
    coarse, fine = (fl.simulate(scene, sample=sample) for sample in (0.005, 0.0005))
    reported = [note for note in coarse.notes if note.id == "coarse-samples"]
    assert len(reported) == 1
    assert not [note for note in fine.notes if "sensor" in note]
    exact = np.interp(coarse.t, fine.t, fine.columns["gauge [1]"])
    off = np.abs(coarse.columns["gauge [1]"] - exact).max() / np.ptp(coarse.columns["gauge [1]"])
    reported_error = float(re.search(r"([0-9.]+) ?%", reported[0])[1]) / 100
    assert off < reported_error < 5 * off
    plain = scene.varied({"sensor.gauge.low_pass": None, "sensor.gauge.delay": 0.04, "sensor.gauge.rate": 25.0})
    assert not [note for note in fl.simulate(plain, sample=0.02).notes if "sensor" in note]


def test_measurements_are_compared_with_sensor_readings(tmp_path: Path) -> None:
    encoder = Sensor(name="encoder", kind="joint", link="rod")
    volts = Sensor(name="volts", kind="torque", link="rod", gain=0.1, unit="V")
    (tmp_path / "measured.csv").write_text("t [ms],volts [V],encoder [deg]\n0,1,180\n10,2,90\n", encoding="utf-8")
    found = read_measured([tmp_path / "measured.csv"], turning(encoder, volts).columns)
    assert found.columns["volts [V]"].tolist() == [1.0, 2.0]
    np.testing.assert_allclose(found.columns["encoder [rad]"], [np.pi, np.pi / 2], rtol=1e-15)


@pytest.mark.parametrize("fields", [{}, {"flex": "yz", "segments": 5}], ids=["rigid", "bends"])
def test_sensor_places_and_directions_are_in_the_link_frame_for_any_beam_line(fields: dict) -> None:
    """A beam along y, offset from its joint about y: R = R_y(θ) for a link that is not bent."""
    θ, beam = 0.7, {"material": "aluminium", "section": "square", "line": ((0.1, 0.0, 0.0), (0.1, 0.6, 0.0))}
    arm = fl.Link(name="arm", joint=fl.Joint(axis=(0, 1, 0)), **beam, **fields)
    scene = make_scene(arm, gravity=(0, 0, -9.81))
    chain, R = fl.lump(scene), np.array([[np.cos(θ), 0, np.sin(θ)], [0, 1, 0], [-np.sin(θ), 0, np.cos(θ)]])
    none, turned, turns = np.zeros((3, chain.n))
    turned[0], turns[0] = θ, 2.0
    here, moving = Here(chain, turned, none, none, none), Here(chain, turned, turns, none, none)
    places = {"x": (0.25, (0.1, 0.25, 0.0)), "point": ((0.3, 0.2, 0.1),) * 2, "axis": (None, (0.1, 0.6, 0.0))}
    for key, (value, where) in places.items():
        sees = {"name": "s", "link": "arm", key: value}
        np.testing.assert_allclose(
            signal_of(Sensor(kind="position", **sees), scene, here)[:, 0], R @ where, rtol=0, atol=1e-15
        )
        np.testing.assert_allclose(
            signal_of(Sensor(kind="accelerometer", **sees), scene, here)[:, 0], R.T @ [0, 0, 9.81], rtol=0, atol=1e-14
        )
        np.testing.assert_allclose(
            signal_of(Sensor(kind="gyroscope", **sees), scene, moving)[:, 0], [0, 2, 0], rtol=0, atol=1e-15
        )


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_markers_sit_where_links_begin_and_end(path: Path, rng: np.random.Generator) -> None:
    """Markers are at the tips of all branches, at the joint of every moving link, and on the line between them."""
    scene = fl.load_scene(path)
    chain = fl.lump(scene)
    q = rng.uniform(-0.5, 0.5, chain.n)
    placed, here = fl.frames(chain, q), Here(chain, q, *np.zeros((3, chain.n)))

    def at(link: str, **place: object) -> np.ndarray:
        return signal_of(Sensor(name="s", kind="position", link=link, **place), scene, here)[:, 0]

    for link in chain.tips:
        np.testing.assert_allclose(at(link), fl.tip_position(chain, q, tip=link), rtol=0, atol=1e-14)
    for link in scene.arm.links:
        if link.joint.locked or link.joint.gear_stiffness:
            continue
        body = chain.body(link.name)
        np.testing.assert_allclose(at(link.name, point=(0, 0, 0)), placed.points[body], rtol=0, atol=1e-14)
        if link.beam.length and link.flex == "rigid":
            start, stop = (at(link.name, x=x) for x in (0.0, link.beam.length))
            middle = at(link.name, x=link.beam.length / 2)
            np.testing.assert_allclose(middle, (start + stop) / 2, rtol=0, atol=1e-14)
            assert np.linalg.norm(stop - start) == pytest.approx(link.beam.length)


@pytest.mark.parametrize(("segments", "doubted"), [(2, True), (3, True), (5, False)])
def test_a_gauge_on_few_hinges_is_doubted(segments: int, doubted: bool) -> None:
    gauge = Sensor(name="gauge", kind="strain", link="beam", x=0.1, fibre=(0.02, 0.0))
    shown = notes(cantilever(gauge, segments=segments, lumping="midpoint"))
    found = [note for note in shown if "sensor.gauge" in note]
    assert [note.id for note in found] == ["few-hinges"] * doubted
    assert all(f"only {segments - 1} hinge" in note for note in found)  # midpoints of the segments


def test_reading_sensors_does_not_change_the_run() -> None:
    """The torques of a sampled drive also stay the same."""
    drive = fl.Drive(kind="pd", kp=(30.0, 30.0), kd=(3.0, 3.0), target_deg=(10.0, 20.0), rate=200.0)
    settings = {"run.step": 1e-3, "run.sample": 0.01, "run.duration": 0.1, "run.method": "Radau5"}
    seen = two_links(drive=drive).varied(settings)
    unseen = seen.varied({"sensor": None})
    arms = fl.Simulator(seen), fl.Simulator(unseen)
    for duration in (0.01, 0.003, 0.007, 0.02):
        states = [arm.step(duration=duration) for arm in arms]
        np.testing.assert_array_equal(states[0].q, states[1].q)
    np.testing.assert_array_equal(fl.simulate(seen).q, fl.simulate(unseen).q)


def simulated(models: Path) -> dict[str, fl.Scene]:
    steps = {"run.step": 2e-3, "run.method": "Radau5", "run.sample": 0.05, "run.tolerance": None}
    satellite = fl.load_scene(models / "satellite.toml").varied(
        {**steps, "run.duration": 0.5, "initial.base.spin_deg": (200.0, 50.0, 30.0)}
    )
    gyro = Sensor(name="gyro", kind="gyroscope", link="base")
    imu = Sensor(name="imu", kind="accelerometer", link=satellite.arm.links[-1].name)
    slow = Sensor(name="slow", kind="accelerometer", link=satellite.arm.links[-1].name, low_pass=5.0)
    motion = fl.PrescribedMotion(link="upper", times=(0.0, 0.5), angle_deg=(0.0, 30.0), rate_deg=(0.0, 0.0),
                                 acceleration_deg=(0.0, 0.0))  # fmt: skip
    drive = fl.Drive(kind="pd", kp=(300.0, 300.0), kd=(30.0, 30.0), target_deg=(10.0, 20.0))
    noisy = {"sensor.gauge.noise": 3.0, "sensor.gyro.rate": 50.0, "sensor.encoder.resolution": 1e-3}
    return {
        "free base": satellite.varied({"sensor": (gyro, imu, slow)}),
        "motion": two_links(motion=(motion,)).varied({**steps, "run.duration": 0.2}),
        "drive": two_links(drive=drive).varied(
            {**steps, "run.step": 1e-3, "run.sample": 0.01, "run.duration": 0.2, **noisy}
        ),
    }


@pytest.mark.parametrize("name", ["free base", "motion", "drive"])
def test_readings_of_a_simulator_equal_the_columns_of_a_run(name: str, models: Path) -> None:
    """This covers the torque of a prescribed motion, and an attitude whose reference changes during the run."""
    scene = simulated(models)[name]
    run, arm = fl.simulate(scene), fl.Simulator(scene)
    rows = [arm.readings]
    for _ in run.t[1:]:
        arm.step()
        rows.append(arm.readings)
    for column_name in run.sensor_names:
        column = run.columns[column_name]
        seen = [row[column_name] for row in rows]
        np.testing.assert_allclose(seen, column, rtol=0, atol=1e-9 * np.abs(column).max())
    arm.reset()
    assert arm.readings == rows[0]


STILL = fl.RunSettings(duration=0.0, sample=0.01)


def read_at(scene: fl.Scene, q: np.ndarray, qd: np.ndarray, *sensors: Sensor) -> dict[str, float]:
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
    seen = list(read_at(scene, np.zeros(2), np.array([0.0, 2.0]), *gyros).values())
    np.testing.assert_allclose(seen, [0.0, 0.0, 2.0, 1.6], atol=1e-14)
    about_first = Rotation.from_euler("xyz", rpy, degrees=True).inv().apply([0.0, 0.0, 3.0])
    seen = list(read_at(scene, np.zeros(2), np.array([3.0, 0.0]), *gyros).values())
    np.testing.assert_allclose(seen, [*about_first, about_first @ [0.0, 0.6, 0.8]], atol=1e-14)


@pytest.mark.parametrize("length", [0.5, 3.0])
def test_a_marker_on_the_beam_axis_equals_the_place_along_it(length: float, rng: np.random.Generator) -> None:
    scene = make_scene(flexible("a", segments=6, length=length, lumping="midpoint"))
    q = rng.uniform(-0.3, 0.3, fl.lump(scene).n)
    for x in np.array([0.05, 0.3, 0.55, 0.95]) * length:
        by_point = Sensor(name="point", kind="position", link="a", point=(x, 0.0, 0.0))
        seen = read_at(scene, q, 0 * q, by_point, Sensor(name="x", kind="position", link="a", x=x))
        one, other = np.array(list(seen.values())).reshape(2, 3)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * length)


def test_at_a_hinge_a_sensor_sits_on_the_outer_segment(rng: np.random.Generator) -> None:
    """The measured rate is the sum of the rates of the joint and of all hinges up to and including that hinge."""
    scene = make_scene(flexible("a", segments=4, length=1.0, lumping="midpoint"))
    qd = rng.normal(size=fl.lump(scene).n)
    hinges = fl.strength.beam_strain(scene, 0 * qd, link="a", fibre=(0.0, 0.0)).x
    assert len(hinges) == len(qd) - 1
    gyros = [Sensor(name=f"g{k}", kind="gyroscope", link="a", x=float(x), axis=(0, 0, 1)) for k, x in enumerate(hinges)]
    seen = list(read_at(scene, 0 * qd, qd, *gyros).values())
    np.testing.assert_allclose(seen, np.cumsum(qd)[1:], atol=1e-13)


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
    one, other = (list(read_at(scene, q, 0 * q, *gauges).values()) for scene in (plain, tabled))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert abs(one[1]) > 1e-6
    assert abs(one[2]) > 1e-6


def test_a_second_sample_at_the_same_time_replaces_the_first() -> None:
    signal = Signal(1, ())
    signal.add(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [1.0], [2.0]]))
    signal.add(np.array([2.0]), np.array([[5.0]]))
    assert signal.count == 3
    np.testing.assert_array_equal(signal.at(np.array([1.0, 1.5, 2.0]))[:, 0], [1.0, 3.0, 5.0])


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


def test_axes_of_an_accelerometer_have_independent_noise() -> None:
    instrument = Instrument(fl.Sensor(name="a", kind="accelerometer", link="rod", noise=1.0), 0.01)
    t = 0.01 * np.arange(500)
    instrument.signal.add(t, np.zeros((500, 3)))
    assert np.abs(np.corrcoef(instrument.readings(t).T) - np.eye(3)).max() < 0.2


def test_the_force_in_a_pin_is_the_length_of_its_vector_at_every_sample() -> None:
    scene = fourbar().varied({"sensor": [{"name": "load", "kind": "force", "tie": "pin"}]})
    run = fl.simulate(scene, duration=0.05, sample=0.01)
    x, y, z = run.tie_forces["pin"].T
    assert len(x) == 6
    np.testing.assert_allclose(run.readings["load [N]"], np.sqrt(x**2 + y**2 + z**2), rtol=1e-12)
