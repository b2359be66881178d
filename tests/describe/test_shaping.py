"""Residual vibration after input shaping is zero at the design frequencies and small near them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import flexlink as fl
from flexlink.describe import data_files
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.shaping import ShaperRule
from tests.conftest import make_scene
from tests.support.words import refused

EPS = np.finfo(float).eps
ZEROS = {"ZV": 1, "ZVD": 2, "ZVDD": 3, "EI": 0}


def left(shaper: fl.InputShaper, pole: complex, derivative: int = 0) -> complex:
    """Residual Σ a_i exp(−λ t_i) of impulses a_i at times t_i for the pole λ, or its derivative with respect to λ."""
    t, a = shaper.impulses
    return complex(np.sum(a * (-t) ** derivative * np.exp(-pole * t)))


def residual(course: ReferenceTrajectory, pole: complex) -> float:
    """Amplitude of y after the end of its reference r: ÿ − 2 Re λ ẏ + |λ|² (y − r) = 0 by matrix exponentials.

    The powers x^j are additional states, (x^j)' = j x^(j−1): one exponential is the exact solution over a piece.
    """
    order = course.coefficients.shape[1]
    A = np.zeros((2 + order, 2 + order))
    A[0, 1], A[1, 0], A[1, 1] = 1.0, -(abs(pole) ** 2), 2 * pole.real
    A[range(3, 2 + order), range(2, 1 + order)] = np.arange(1, order)
    y = np.array([course.coefficients[0, 0, 0], 0.0])
    for x, c in zip(np.diff(course.knots), course.coefficients[:-1, :, 0], strict=True):
        A[1, 2:] = abs(pole) ** 2 * c
        y = (expm(A * x) @ np.concatenate([y, np.eye(order)[0]]))[:2]
    return float(np.hypot(y[0] - course.coefficients[-1, 0, 0], y[1] / abs(pole)))


def test_every_built_in_shaper_is_tested() -> None:
    assert set(data_files.names("shapers")) == set(ZEROS)
    for name, zeros in ZEROS.items():
        assert data_files.load("shapers", "kind", name, ShaperRule).zeros == zeros


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ZV", "ZVD", "ZVDD"])
@settings(max_examples=10)
@given(
    frequency=st.floats(0.5, 20), damping=st.floats(0, 0.5),
    profile=st.sampled_from(["quintic", "trapezoidal", "s_curve"]), duration=st.floats(0.1, 2),
)  # fmt: skip
def test_a_shaped_reference_leaves_no_vibration(kind, frequency, damping, profile, duration) -> None:
    """1e-12 allows rounding of a move of 1 rad with up to 28 pieces; exp(A t) has errors of ε |A| t with |A| = |λ|²."""
    shaper = fl.InputShaper(kind=kind, frequency_hz=(frequency,), damping=(damping,))
    course = fl.Reference(profile=profile, to_deg=(np.degrees(1.0),), duration=duration).course((0.0,))
    pole, shaped = shaper.vibrations[0], course.shaped(*shaper.impulses)
    assert residual(shaped, pole) <= 1e-12 + 10 * EPS * abs(pole) ** 2 * shaped.knots[-1]


def test_convolved_shapers_suppress_two_vibrations() -> None:
    shaper = fl.InputShaper(kind="ZVD", frequency_hz=(1.7, 2.6), damping=(0.02, 0.01))
    course = fl.Reference(profile="trapezoidal", to_deg=(np.degrees(1.0),), duration=0.3).course((0.0,))
    assert len(shaper.impulses[0]) == 9
    for pole in shaper.vibrations:
        assert residual(course, pole) > 0.1
        assert residual(course.shaped(*shaper.impulses), pole) <= 1e-12


@pytest.mark.parametrize("kind", ["ZV", "ZVD", "ZVDD"])
@given(frequency=st.floats(0.1, 100), damping=st.floats(0, 0.9))
def test_derivatives_of_a_shaper_with_respect_to_frequency_vanish_up_to_its_order(kind, frequency, damping) -> None:
    """In units of 1/|λ|^k, each impulse adds |a_i (λ t_i)^k exp(−λ t_i)| with a rounding error of a few ε |λ t_i|."""
    shaper = fl.InputShaper(kind=kind, frequency_hz=(frequency,), damping=(damping,))
    (pole,), (t, a) = shaper.vibrations, shaper.impulses
    for k in range(ZEROS[kind] + 1):
        added = np.sum(np.abs(a * np.exp(-pole * t)) * np.abs(pole * t) ** k * (1 + np.abs(pole * t)))
        found = abs(left(shaper, pole, k)) * abs(pole) ** k
        assert (found <= 8 * EPS * added) == (k < ZEROS[kind])


def test_the_extra_insensitive_shaper_leaves_5_percent_at_most_in_its_band() -> None:
    """Undamped, 5 % remain at the design frequency, and less from 0.83 to 1.17 times it, where ZVD leaves more."""
    shapers = {kind: fl.InputShaper(kind=kind, frequency_hz=(1.0,)) for kind in ("EI", "ZVD")}
    band = 2j * np.pi * np.linspace(0.83, 1.17, 201)
    most = {kind: max(abs(left(shaper, pole)) for pole in band) for kind, shaper in shapers.items()}
    assert abs(left(shapers["EI"], 2j * np.pi)) == pytest.approx(0.05, rel=1e-12)
    assert most["EI"] < 0.05 + 1e-12 < most["ZVD"]


@given(frequency=st.floats(0.1, 100), damping=st.floats(0, 0.99))
def test_impulses_sum_to_one_and_poles_match_frequency_and_damping(frequency: float, damping: float) -> None:
    shaper = fl.InputShaper(kind="ZVD", frequency_hz=(frequency,), damping=(damping,))
    (pole,), (t, a) = shaper.vibrations, shaper.impulses
    assert a.sum() == pytest.approx(1.0, abs=4 * EPS)
    assert abs(pole) == pytest.approx(2 * np.pi * frequency, rel=8 * EPS)
    assert -pole.real / abs(pole) == pytest.approx(damping, rel=8 * EPS)
    for given_by, same in zip(fl.InputShaper.at([pole]).impulses, (t, a), strict=True):
        np.testing.assert_array_equal(given_by, same)
    K = np.exp(np.pi * pole.real / pole.imag)
    np.testing.assert_allclose(a * (1 + K) ** 2, [1, 2 * K, K**2], rtol=EPS * (8 - 2 * np.log(K)))  # as in textbooks


def test_a_shaped_reference_is_the_sum_of_delayed_references(rng: np.random.Generator) -> None:
    """This includes negative impulses; errors are below 64 ε times the largest value of each derivative."""
    times, weights = rng.uniform(0, 1, 5), rng.uniform(-1, 1, 5)
    course = fl.Reference(profile="s_curve", to_deg=(90.0, -45.0), duration=1.0).course((0.0, 10.0))
    shaped, t = course.shaped(times, weights), np.linspace(-1, 4, 777)
    sums = [sum(a * part for a, part in zip(weights, parts, strict=True))
            for parts in zip(*(course(t - later) for later in times), strict=True)]  # fmt: skip
    for ours, theirs in zip(shaped(t), sums, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=64 * EPS * np.abs(theirs).max())


def test_a_user_defined_shaper_is_read_from_a_file(tmp_path: Path) -> None:
    """The unity-magnitude shaper, +1, −1, +1 at sixths of a period, is faster than ZV."""
    path = tmp_path / "um_zv.toml"
    rule = 'about = "UM-ZV"\nsource = "Singhose, Singer & Seering 1994"\nzeros = {}\n'
    rule += "half_periods = [0, 0.3333333333333333, 0.6666666666666666]\nweights = [1, -1, 1]\n"
    path.write_text(rule.format(1), encoding="utf-8")
    shaper = fl.InputShaper(kind=str(path), frequency_hz=(3.0,), damping=(0.1,))
    assert abs(left(shaper, shaper.vibrations[0])) < 8 * EPS
    path.write_text(rule.format(2), encoding="utf-8")
    with refused(fl.errors.DataFileError, "shaper-zeros"):
        _ = shaper.impulses


REFUSED = {
    "frequency": ({"frequency_hz": (0.0,)}, "wrong-value"),
    "negative frequency": ({"frequency_hz": (1.0, -2.0)}, "wrong-value"),
    "damping of 1": ({"frequency_hz": (1.0,), "damping": (1.0,)}, "wrong-value"),
    "damping below 0": ({"frequency_hz": (1.0,), "damping": (-0.1,)}, "wrong-value"),
    "dampings": ({"frequency_hz": (1.0,), "damping": (0.1, 0.1)}, "one-per-frequency"),
    "both": ({"frequency_hz": (1.0,), "poles": ((-1.0, 2.0),)}, "both-given"),
    "neither": ({}, "both-given"),
    "no vibration": ({"frequency_hz": ()}, "frequencies-missing"),
    "a growing pole": ({"poles": ((1.0, 2.0),)}, "poles-not-a-vibration"),
    "an aperiodic pole": ({"poles": ((-1.0, 0.0),)}, "poles-not-a-vibration"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_bad_shaper_is_refused(what: str) -> None:
    given, id = REFUSED[what]
    with refused(fl.errors.SceneError, id):
        fl.InputShaper(kind="ZV", **given)


def test_an_unknown_shaper_and_too_many_vibrations_are_refused() -> None:
    with refused(fl.errors.ArgumentError, "unknown-name"):
        _ = fl.InputShaper(kind="zvd", frequency_hz=(1.0,)).impulses
    with refused(fl.errors.ArgumentError, "too-many-impulses"):
        _ = fl.InputShaper(kind="ZVD", frequency_hz=tuple(range(1, 8))).impulses
    shaper = fl.InputShaper(kind="zvd", frequency_hz=(1.0,))
    with refused(fl.errors.SceneError, "unknown-name"):
        fl.Reference(profile="quintic", to_deg=(1.0,), duration=1.0, shaper=shaper).course((0.0,))
    course = fl.Reference(profile="quintic", to_deg=(1.0,), duration=1.0).course((0.0,))
    with refused(fl.errors.ArgumentError, "too-many-impulses"):
        course.shaped(np.linspace(0, 1, 30_000), np.ones(30_000))
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        course.shaped([0.0, 1.0], [1.0])


def test_poles_of_a_wheel_under_pd_control_equal_the_closed_form() -> None:
    """The poles are the roots of I λ² + kd λ + kp = 0."""
    wheel = fl.RigidBody(mass=1.0, inertia=(2.0, 2.0, 3.0))
    chain = fl.lump(make_scene(fl.Link(name="a"), tip=wheel, gravity=(0, 0, 0)))
    (pole,) = fl.small_motion.pd_poles(chain, [0.0], kp=12.0, kd=[1.5])
    assert pole == pytest.approx(complex(-0.25, np.sqrt(4.0 - 0.25**2)), rel=1e-13)
    assert fl.small_motion.pd_poles(chain, [0.0], kp=12.0, kd=100.0).size == 0, "aperiodic"
    with refused(fl.errors.ArgumentError, "out-of-range"):
        fl.small_motion.pd_poles(chain, [0.0], kp=-1.0, kd=0.0)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.small_motion.pd_poles(chain, [0.0], kp=1.0, kd=[0.0, 0.0])
