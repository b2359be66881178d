"""A fit estimates its grid error: it is in the interval, in the verdict, and in the check."""

import argparse
import functools

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli import fit as command
from flexlink.describe.variants import refined, segments_in_words
from flexlink.identification.fitted import Fitted
from tests.support.fits import TOGETHER, boom, problem

pytestmark = pytest.mark.slow
YOUNG, MASS = "material.steel.young", "tip.mass"
TRUE = {YOUNG: 2.05e11, MASS: 0.52}
IMU = fl.Sensor(name="imu", kind="accelerometer", link="boom", axis=(0.0, 1.0, 0.0))


@functools.cache
def measured(segments: int, true: int = 25, sensor: fl.Sensor = IMU, noise: float = 0.01) -> fl.fits.FitProblem:
    """Data of a chain with `true` segments; for 25, the grid error is 1e-5. The noise is a share of the range."""
    run = fl.simulate(boom(true, **TRUE, sensor=(sensor,)).varied({"run.relative_tolerance": 1e-8}))
    (head,) = (head for head in run.columns if head.startswith(f"{sensor.name} ["))
    y = run.columns[head]
    seen = y + noise * np.ptp(y) * np.random.default_rng(1).standard_normal(len(y))
    step = fl.fits.FitRun(name="step", columns={"t [s]": tuple(run.t.tolist()), head: tuple(seen.tolist())})
    return problem(boom(segments, sensor=(sensor,), **TOGETHER | {"run.step": 5e-4}), TRUE, step)


@functools.cache
def fitted() -> Fitted:
    return fl.fit(measured(5))


def test_the_interval_contains_the_true_value_although_five_segments_shift_it_far_beyond_the_noise() -> None:
    found = fitted()
    young = found[YOUNG]
    assert abs(young.value - TRUE[YOUNG]) > 3 * young.statistical
    assert all(found[path].low < true < found[path].high for path, true in TRUE.items())
    assert 0.5 < young.u_num / abs(young.value - TRUE[YOUNG]) < 2


def test_a_grid_error_beyond_half_the_interval_fails_the_fit_and_names_the_segments_that_suffice() -> None:
    found = fitted()
    assert not found.passed
    assert found[YOUNG].doubt is not None and found[YOUNG].doubt.id == "grid-error"
    named = next(one for one in found.warnings if one.id == "grid-error")
    enough = int(named.split("take ")[1].split()[0])
    assert fl.fit(measured(enough)).passed


def test_grid_auto_takes_enough_segments_and_then_passes() -> None:
    found = fl.fit(measured(5), grid="auto")
    assert found.passed
    assert found.scene.arm.links[0].segments > 5
    assert all(one.u_num <= one.statistical for one in found.numbers)
    assert all(found[path].low < true < found[path].high for path, true in TRUE.items())


def test_grid_ignore_gives_the_statistical_interval() -> None:
    assert all(one.u_num == 0 and one.doubt is None for one in fl.fit(measured(5), grid="ignore").numbers)


def test_the_check_predicts_the_grid_error_before_anything_is_fitted() -> None:
    expected = fl.fits.check_fit(measured(5)).grid[0]
    found = fitted()[YOUNG]
    assert expected == pytest.approx(found.u_num / found.value, rel=0.5)


def test_a_check_fails_if_the_grid_error_would_exceed_half_the_interval() -> None:
    options = argparse.Namespace(out=None, propose=None)
    for segments in (5, 11):
        check = fl.fits.check_fit(measured(segments))
        assert check.passed
        assert command._report(check, measured(segments), options) == (segments == 5)


def test_the_covariance_contains_the_grid_error() -> None:
    found = fitted()
    deviations = np.array([one.deviation for one in found.numbers])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), deviations, rtol=1e-9)


def test_a_scene_that_starts_from_coordinates_of_its_hinges_has_an_unknown_grid_error() -> None:
    scene = measured(5).scene
    found = fl.fit(replace(measured(5), scene=scene.varied({"initial.q": [0.0] * fl.lump(scene).n})))
    assert [one.id for one in found.warnings if one.id.startswith("grid")] == ["grid-error-unknown"]


@pytest.mark.parametrize(("rule", "segments", "factor", "after"), [
    ("gauss", 5, 2.0, 9), ("gauss", 5, 1.3, 7), ("midpoint", 2, 2.0, 3), ("lobatto4", 5, 1.5, 9),
])  # fmt: skip
def test_refining_rounds_the_hinges_up_to_a_number_that_the_rule_takes(rule, segments, factor, after) -> None:
    scene = boom(5).varied({"link.boom.lumping": rule, "link.boom.segments": segments})
    assert segments_in_words(refined(scene, factor)) == f"{after} segments"


@pytest.mark.parametrize("x", [0.55, 0.62])
def test_the_error_of_a_gyroscope_on_a_rigid_segment_is_part_of_the_grid_error(x: float) -> None:
    """Refinement from 5 to 9 segments hardly changes the segment's rotation at x, but the beam's rotation differs."""
    gyro = fl.Sensor(name="gyro", kind="gyroscope", link="boom", x=x, axis=(0.0, 0.0, 1.0))
    found = fl.fit(measured(5, 201, gyro, 0.003))
    assert all(found[path].low < true < found[path].high for path, true in TRUE.items())
