"""Noise and filter of a recorded motion are in the interval, and cross-validation chooses the cutoff."""

import functools
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.types import Array
from flexlink.data.smoothing import best_cutoff, noise_of, smoothed
from flexlink.identification.fitted import Fitted
from tests.support.fits import TOGETHER, boom, problem, write_csv

pytestmark = pytest.mark.slow
YOUNG = "material.steel.young"
TRUE = 2.05e11
T: Array = np.linspace(0.0, 1.2, 241)


def swing() -> tuple[Array, Array, Array]:
    """A turn by 6° in 0.5 s with continuous acceleration [deg, deg/s, deg/s²]."""
    s = np.clip(T / 0.5, 0.0, 1.0)
    shapes = (6 * (10 * s**3 - 15 * s**4 + 6 * s**5), 12 * (30 * s**2 - 60 * s**3 + 30 * s**4),
              24 * (60 * s - 180 * s**2 + 120 * s**3))  # fmt: skip
    q, qd, qdd = (np.asarray(shape, np.float64) for shape in shapes)
    return q, qd, qdd


def led() -> fl.Scene:
    """The strip, whose joint follows the swing."""
    angle, rate, acceleration = swing()
    motion = fl.PrescribedMotion(link="boom", times=T, angle_deg=angle, rate_deg=rate, acceleration_deg=acceleration)
    return boom(3, **{"drive": None, "motion": (motion,), "tip.mass": 0.0, "run.duration": 1.2, **TOGETHER})


@functools.cache
def fitted(cutoff: float | str, noise: float) -> Fitted:
    """Fit E to the tip's position, with 0.1 mm noise, given the recorded angle with `noise` [deg]."""
    scene, rng = led(), np.random.default_rng(3)
    run = fl.simulate(scene.varied({YOUNG: TRUE, "run.step": None, "run.relative_tolerance": 1e-8}))
    seen = run.tip[:, 1] + 1e-4 * rng.standard_normal(len(T))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "angle.csv"
        write_csv(file, {"t [s]": T, "q boom [deg]": swing()[0] + noise * rng.standard_normal(len(T))})
        given = {"motion": [{"link": "boom", "file": str(file), "cutoff": cutoff}]}
        turn = fl.fits.FitRun(name="turn", columns={"t [s]": T, "tip y [m]": seen}, set=given)
        return fl.fit(problem(scene, (YOUNG,), turn), grid="ignore")


@pytest.mark.parametrize(("cutoff", "noise"), [(3.0, 0.0), (6.0, 0.0), (40.0, 0.01), (80.0, 0.03), ("auto", 0.01)])
def test_the_true_value_is_inside_or_the_recorded_motion_is_named(cutoff: float | str, noise: float) -> None:
    found = fitted(cutoff, noise)
    named = any(one.id in ("input-error", "input-cutoff") for one in found.warnings)
    assert found[YOUNG].u_input > 0
    assert found[YOUNG].low < TRUE < found[YOUNG].high or named


def test_a_cutoff_far_above_that_by_cross_validation_is_named() -> None:
    (named,) = (one for one in fitted(80.0, 0.03).warnings if one.id == "input-cutoff")
    cutoff = tomllib.loads(named.rpartition("set ")[2])["cutoff"]
    assert "input-cutoff" not in [one.id for one in fitted(cutoff, 0.03).warnings]


def test_exact_angles_with_the_automatic_cutoff_add_little_to_the_interval() -> None:
    found = fitted("auto", 0.0)
    assert found.passed
    assert found[YOUNG].low < TRUE < found[YOUNG].high
    assert found[YOUNG].u_input < 0.2 * found[YOUNG].statistical


@pytest.mark.parametrize("noise", [1e-3, 1e-2, 5e-2])
def test_cross_validation_gives_less_than_three_times_the_least_error_of_the_acceleration(noise: float) -> None:
    y: Array = np.asarray(swing()[0] + noise * np.random.default_rng(0).standard_normal(len(T)))
    inside = slice(10, -10)  # rates at the ends are less accurate with any cutoff

    def off(cutoff: float) -> float:
        return float(np.std((smoothed(T, y, cutoff)[2] - swing()[2])[inside]))

    chosen = best_cutoff(T, y)
    assert off(chosen) < 3 * min(off(cutoff) for cutoff in np.geomspace(2.0, 80.0, 30))
    assert noise_of(y) == pytest.approx(noise, rel=0.15)
