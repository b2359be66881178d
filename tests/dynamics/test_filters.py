"""Filters of sensors agree with H(iω), closed forms and SciPy; random walks have the variance of their time."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy import signal

import flexlink as fl
from flexlink.describe.scene import scene_from
from flexlink.dynamics.sensors.instrument import Instrument, walk
from tests.conftest import make_scene
from tests.support.words import refused

PLACE = {"name": "s", "kind": "joint", "link": 1}
RECORDER, HUM = {"low_pass": 2.0, "damping": 0.9}, {"notch": 50.0, "damping": 0.1}
LAG = {"numerator": (1.0,), "denominator": (0.08, 1.0)}


def shown(t: np.ndarray, u: np.ndarray, *filters: dict, **fields: object) -> np.ndarray:
    instrument = Instrument(fl.Sensor(filter=filters, **PLACE, **fields), float(t[1] - t[0]))
    instrument.signal.add(t, u[:, None])
    return instrument.readings(t)[:, 0]


def response(s: complex, each: dict) -> complex:
    """H(s) of a filter, as documented; Butterworth by its squared magnitude's poles."""
    if "numerator" in each:
        return complex(np.polyval(each["numerator"], s) / np.polyval(each["denominator"], s))
    ω = 2 * math.pi * (each.get("low_pass") or each["notch"])
    if "damping" in each:
        top = ω**2 + (s**2 if "notch" in each else 0.0)
        return complex(top / (s**2 + 2 * each["damping"] * ω * s + ω**2))
    roots = np.roots([(-1) ** each["order"], *[0] * (2 * each["order"] - 1), 1.0])  # of 1 + (−s²)ⁿ, s in units of ω
    return complex(1 / np.prod([1 - s / (ω * root) for root in roots if root.real < 0]))


HERTZ, RATIO = st.floats(1.0, 50.0), st.floats(0.1, 2.0)
FILTERS = st.one_of(
    st.fixed_dictionaries({"low_pass": HERTZ, "damping": RATIO}),
    st.fixed_dictionaries({"low_pass": HERTZ, "order": st.integers(1, 8)}),
    st.fixed_dictionaries({"notch": HERTZ, "damping": RATIO}),
    st.builds(
        lambda b, T, ζ, ω: {"numerator": b, "denominator": np.polymul([T, 1.0], [1 / ω**2, 2 * ζ / ω, 1.0]).tolist()},
        st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=4), st.floats(0.01, 0.3), RATIO, st.floats(5.0, 200.0),
    ),
)  # fmt: skip


@settings(max_examples=25)
@given(st.lists(FILTERS, min_size=1, max_size=3), st.floats(0.5, 10.0))
def test_gain_and_phase_of_any_chain_are_those_of_its_transfer_function(filters: list[dict], hertz: float) -> None:
    """Settled response to cos ωt, interpolated linearly: its first harmonic is smaller by sinc²(f/f_s)."""
    per_period, periods = 16, 4
    ω = 2 * math.pi * hertz
    slowest = min(-pole.real for each in filters for pole in poles(each))
    settled = math.ceil(27.0 / slowest * hertz)
    k = np.arange(per_period * (settled + periods) + 1)
    y = shown(k / (per_period * hertz), np.cos(2 * np.pi * k / per_period), *filters)
    found = 2 * np.mean(
        y[1:][-periods * per_period :] * np.exp(-2j * np.pi * k[1:][-periods * per_period :] / per_period)
    )
    # samples of the response to the interpolated signal contain all of its harmonics m f_s + f
    m = np.arange(-400, 401)
    direct = chain(1e15j, filters).real  # a part without lag is exact at samples
    aliases = [(1 / per_period + n, 1j * ω * (1 + n * per_period)) for n in m]
    expected = direct + sum(np.sinc(x) ** 2 * (chain(s, filters) - direct) for x, s in aliases)
    # the sum ends at |m| = 400; the part without lag aside, the gain falls at least as 1/m, and sinc² as 1/(π m)²
    tail = 2 * abs(chain(1j * ω * per_period * m[-1], filters) - direct) / (math.pi**2 * m[-1])
    # rounding errors are those of the largest signal between two filters, whose gain may be 1e9
    between = max(abs(chain(1e15j, filters[:count])) for count in range(len(filters) + 1))
    assert abs(found - expected) < 2e-6 * max(1.0, abs(expected)) + tail + 1e-8 * between, filters


def chain(s: complex, filters: list[dict]) -> complex:
    return complex(np.prod([response(s, each) for each in filters]))


def poles(each: dict) -> np.ndarray:
    if "numerator" in each:
        return np.roots(each["denominator"])
    ω = 2 * math.pi * (each.get("low_pass") or each["notch"])
    if "damping" in each:
        return ω * np.roots([1.0, 2 * each["damping"], 1.0])
    n = each["order"]
    return np.array([-ω * math.sin(math.pi / (2 * n))])


def test_the_response_of_a_recorder_to_a_step_and_a_ramp_is_exact() -> None:
    """Closed forms of an underdamped second-order low-pass: a ramp lags by 2ζ/ω."""
    t, ω, ζ = np.arange(0.0, 1.0, 0.01), 2 * math.pi * 2.0, 0.9
    damped = ω * math.sqrt(1 - ζ**2)
    decay = np.exp(-ζ * ω * t)
    ramp = t - 2 * ζ / ω + decay * (2 * ζ / ω * np.cos(damped * t) + (2 * ζ**2 - 1) / damped * np.sin(damped * t))
    np.testing.assert_allclose(shown(t, t, RECORDER), ramp, rtol=0, atol=1e-13)
    short = fl.Sensor(low_pass=2.0, damping=0.9, **PLACE)
    assert short.filters == fl.Sensor(filter=(RECORDER,), **PLACE).filters


@pytest.mark.parametrize("sample", [1e-4, 0.01, 1.0])
def test_a_chain_agrees_with_scipy_at_any_sampling(sample: float) -> None:
    rng = np.random.default_rng(3)
    t, u = sample * np.arange(400), np.cumsum(rng.normal(size=400))
    ω, notched = 2 * math.pi * 2.0, 2 * math.pi * 50.0
    b = np.polymul([ω**2], [1.0, 0.0, notched**2])
    a = np.polymul(np.polymul([1.0, 1.8 * ω, ω**2], [1.0, 0.2 * notched, notched**2]), [0.08, 1.0])
    exact = signal.TransferFunction(b, a).to_ss()
    _, y, _ = signal.lsim(exact, u - u[0], t)
    np.testing.assert_allclose(shown(t, u, RECORDER, HUM, LAG), y + u[0], rtol=0, atol=1e-8)


def test_a_filter_starts_in_steady_state_with_its_static_gain() -> None:
    t = np.arange(0.0, 0.5, 0.01)
    still = np.full_like(t, 3.0)
    for filters, gain in (([RECORDER, HUM, LAG], 1.0), ([{"numerator": (5.0, 2.0), "denominator": (1.0, 4.0)}], 0.5),
                          ([{"numerator": (1.0, 0.0), "denominator": (1.0, 4.0)}], 0.0),
                          ([{"numerator": (3.0,), "denominator": (2.0,)}], 1.5)):  # fmt: skip
        np.testing.assert_allclose(shown(t, still, *filters), 3.0 * gain, rtol=0, atol=1e-12)


def test_filters_much_faster_than_the_samples_pass_the_signal() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    u = np.sin(7 * t) + 1.0
    for fast in ({"low_pass": 1e12, "damping": 0.7}, {"low_pass": 1e25, "order": 5}, {"notch": 1e20, "damping": 1.0}):
        np.testing.assert_allclose(shown(t, u, fast), u, rtol=0, atol=1e-10)


def test_a_delay_follows_or_precedes_filters_alike_between_samples() -> None:
    """A first-order lag of a delayed ramp, closed form, with gain and bias."""
    t, T = np.arange(0.0, 1.0, 0.01), 0.08
    late = np.maximum(t - 0.0537, 0.0)
    found = shown(t, t, LAG, delay=0.0537, gain=-2.0, bias=0.5)
    np.testing.assert_allclose(found, 0.5 - 2.0 * (late - T * (1 - np.exp(-late / T))), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"low_pass": 2.0, "damping": 0.9, "order": 3}, "both-given"),
        ({"damping": 0.9}, "needs-another-key"),
        ({"low_pass": 2.0, "filter": (HUM,)}, "both-given"),
        ({"filter": ({},)}, "missing-key"),
        ({"filter": ({"low_pass": 2.0, "notch": 3.0},)}, "both-given"),
        ({"filter": ({"notch": 3.0},)}, "missing-key"),
        ({"filter": (HUM | {"order": 2},)}, "key-of-another-kind"),
        ({"filter": ({"numerator": (1.0,)},)}, "missing-key"),
        ({"filter": ({"numerator": (1.0, 0.0, 1.0), "denominator": (1.0, 1.0)},)}, "filter-improper"),
        ({"filter": ({"numerator": (1.0,), "denominator": (0.0, 1.0)},)}, "filter-improper"),
        ({"filter": ({"numerator": (1.0,), "denominator": (1.0, 0.0)},)}, "filter-static-gain"),
        ({"filter": ({"numerator": (1.0,), "denominator": (1.0, -1.0)},)}, "filter-unstable"),
        ({"filter": ({"numerator": (1.0,), "denominator": (1.0, 0.0, 4.0)},)}, "filter-unstable"),
        ({"filter": ({"numerator": (), "denominator": (1.0, 1.0)},)}, "wrong-value"),
        ({"filter": ({"notch": 3.0, "damping": -1.0},)}, "wrong-value"),
        ({"bias_walk": 1e-40}, "noise-too-small"),
    ],
)  # fmt: skip
def test_impossible_filters_are_refused_by_name(fields: dict, message: str) -> None:
    with refused(fl.errors.SceneError, message):
        fl.Sensor(**PLACE, **fields)


@settings(max_examples=200)
@given(st.lists(st.floats(-2.0, 2.0).filter(lambda x: abs(x) > 1e-3), min_size=1, max_size=4),
       st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(0.1, 3.0)), max_size=2))  # fmt: skip
def test_a_denominator_is_accepted_exactly_if_its_roots_are_stable(real: list, pairs: list) -> None:
    roots = [*real, *(complex(*pair) for pair in pairs), *(complex(x, -y) for x, y in pairs)]
    if any(abs(complex(root).real) < 1e-3 for root in roots):
        return
    each = {"numerator": (1.0,), "denominator": tuple(np.real(np.poly(roots)).tolist())}
    stable = all(complex(root).real < 0 for root in roots)
    try:
        fl.Sensor(filter=(each,), **PLACE)
    except fl.errors.SceneError as error:
        assert error.id == "filter-unstable"
        assert not stable
    else:
        assert stable


def scene_of(**fields: object) -> fl.Scene:
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    sensor = fl.Sensor(**{"name": "s", "kind": "joint", "link": "rod"} | fields)
    return make_scene(rod, sensor=(sensor,), gravity=(0, -9.81, 0)).varied(
        {"run.step": 1e-3, "run.duration": 0.5, "run.sample": 0.01, "run.method": "Radau5"}
    )


def test_filters_are_varied_by_number_and_written_and_read_back() -> None:
    scene = scene_of(filter=(RECORDER, HUM, LAG), bias_walk=0.2)
    moved = scene.varied({"sensor.s.filter.1.damping": 0.5, "sensor.s.filter.2.notch": 60.0})
    assert (moved.sensor[0].filter[0].damping, moved.sensor[0].filter[1].notch) == (0.5, 60.0)
    assert scene_from(tomllib.loads(moved.to_toml())) == moved
    for path in ("sensor.s.filter.4.damping", "sensor.s.filter.3.denominator.1"):
        with pytest.raises(fl.FlexlinkError, match=r"sensor\.s\.filter"):
            scene.varied({path: 0.5})
    assert not np.array_equal(fl.simulate(scene).columns["s [rad]"], fl.simulate(moved).columns["s [rad]"])


def test_a_bias_walk_has_the_variance_of_its_time() -> None:
    """Over 400 seeds, σ √t at three times; increments of different intervals are independent."""
    times = np.array([0.37, 2.0, 9.3])
    values = np.array([walk(f"{seed} s", times) for seed in range(400)])
    np.testing.assert_allclose(values.std(axis=0), np.sqrt(times), rtol=0.12)
    steps = np.diff(values, axis=1, prepend=0.0) / np.sqrt(np.diff(times, prepend=0.0))
    assert np.abs(np.corrcoef(steps.T) - np.eye(3)).max() < 0.2
    fine = np.diff(walk("a", np.arange(0.0, 20.0, 1e-4)))
    assert fine.std() == pytest.approx(1e-2, rel=0.01)
    assert abs(np.corrcoef(fine[1:], fine[:-1])[0, 1]) < 0.01


def test_a_bias_walk_depends_only_on_seed_name_and_time(tmp_path: Path) -> None:
    """Runs with other samples, a simulator and an archive have the same walk; noise is independent of it."""
    scene = scene_of(bias_walk=0.3, seed=4)
    plain = fl.simulate(scene.varied({"sensor.s.bias_walk": None, "sensor.s.seed": None}))
    run, finer = fl.simulate(scene), fl.simulate(scene, sample=0.005)
    drift = run.columns["s [rad]"] - plain.columns["s [rad]"]
    assert drift[0] == 0.0
    assert np.abs(drift[1:]).min() > 0
    np.testing.assert_allclose(finer.columns["s [rad]"][::2], run.columns["s [rad]"], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(
        fl.Trajectory.load(run.save(tmp_path / "run.npz")).columns["s [rad]"], run.columns["s [rad]"]
    )
    arm, rows = fl.Simulator(scene), []
    for _ in run.t:
        rows.append(arm.readings["s [rad]"])
        arm.step()
    np.testing.assert_allclose(rows, run.columns["s [rad]"], rtol=0, atol=1e-11)
    other = fl.simulate(scene.varied({"sensor.s.seed": 5})).columns["s [rad]"]
    assert np.abs(other - run.columns["s [rad]"])[1:].min() > 0
    both = fl.simulate(scene.varied({"sensor.s.noise": 0.1})).columns["s [rad]"] - run.columns["s [rad]"]
    alone = fl.simulate(scene.varied({"sensor.s.noise": 0.1, "sensor.s.bias_walk": None})).columns["s [rad]"]
    np.testing.assert_allclose(both, alone - plain.columns["s [rad]"], rtol=0, atol=1e-14)


def test_a_sampled_sensor_holds_its_walk() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    found = shown(t, 0 * t, bias_walk=2.0, rate=10.0)
    np.testing.assert_array_equal(found, 2.0 * walk("0 s", np.floor(t * 10 + 1e-9) / 10))


def test_a_fit_finds_the_damping_of_a_filter_and_refuses_a_bias_walk() -> None:
    scene = scene_of(filter=(RECORDER,), noise=1e-3)
    run = fl.simulate(scene.varied({"sensor.s.filter.1.damping": 0.7}))
    recorded = fl.fits.FitRun(name="fall", columns={"t [s]": run.t, "s [rad]": run.columns["s [rad]"]})
    sought = (fl.fits.FitParameter(path="sensor.s.filter.1.damping"),)
    found = fl.fit(fl.fits.FitProblem(scene=scene, parameter=sought, run=(recorded,)))
    damping = found["sensor.s.filter.1.damping"]
    assert damping.low < 0.7 < damping.high
    assert damping.half < 0.05
    drifting = scene.varied({"sensor.s.bias_walk": 1e-3})
    with refused(fl.errors.SceneError, "fit-bias-walk"):
        fl.fit(fl.fits.FitProblem(scene=drifting, parameter=sought, run=(recorded,)))


ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


def test_gain_and_bias_of_a_filtered_sensor_apply_to_its_output_in_a_linear_model() -> None:
    sensor = fl.Sensor(name="a", kind="joint", link="rod", low_pass=5.0)
    scenes = (replace(ROD, sensor=(replace(sensor, gain=gain, bias=0.7),)) for gain in (1.0, 3.0))
    one, three = (fl.linearize(fl.lump(ROD), [0.2], outputs=[fl.small_motion.SensorOutputs(scene)]) for scene in scenes)
    np.testing.assert_allclose(three.C, 3 * one.C, rtol=1e-14)
    assert three.y[0] == pytest.approx(3.0 * 0.2 + 0.7, abs=1e-14)
