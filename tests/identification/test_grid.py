"""A fit estimates its grid error: it is in the interval, in the verdict, and in the check."""

import functools

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.variants import refined, segments_in_words
from flexlink.identification.fitted import Fitted

pytestmark = pytest.mark.slow
YOUNG, MASS = "material.steel.young", "tip.mass"
TRUE = {YOUNG: 2.05e11, MASS: 0.52}
IMU = fl.Sensor(name="imu", kind="accelerometer", link="boom", axis=(0.0, 1.0, 0.0))


def boom(segments: int, **true: float) -> fl.Scene:
    """A strip that a PD controller turns by 8°, with an accelerometer at its tip."""
    strip = fl.Link(name="boom", length=1.0, flex="z", segments=segments, material="steel", section="strip",
                    joint=fl.Joint(armature=0.05))  # fmt: skip
    arm = fl.Arm(links=(strip,), materials={"steel": fl.Material(young=2.1e11, density=7850.0, loss_time=2e-4)},
                 sections={"strip": fl.Section(shape="rectangle", height=0.004, width=0.03)},
                 tip=fl.RigidBody(mass=0.5))  # fmt: skip
    drive = fl.Drive(kind="pd", kp=(40.0,), kd=(4.0,), target_deg=(8.0,))
    run = fl.RunSettings(duration=1.0, sample=0.005)
    return fl.Scene(name="boom", arm=arm, gravity=(0.0, 0.0, 0.0), drive=drive, run=run, sensor=(IMU,)).varied(true)


@functools.cache
def problem(segments: int) -> fl.fits.FitProblem:
    """Data of a chain with 25 segments, for which the grid error is 1e-5, with 1 % noise."""
    run = fl.simulate(boom(25, **TRUE).varied({"run.relative_tolerance": 1e-8}))
    y = run.columns["imu [m/s²]"]
    seen = y + 0.01 * np.ptp(y) * np.random.default_rng(1).standard_normal(len(y))
    columns = {"t [s]": tuple(run.t.tolist()), "imu [m/s²]": tuple(seen.tolist())}
    sought = tuple(fl.fits.FitParameter(path=path) for path in TRUE)
    fall = fl.fits.FitRun(name="step", columns=columns)
    return fl.fits.FitProblem(scene=boom(segments), parameter=sought, run=(fall,))


@functools.cache
def fitted() -> Fitted:
    return fl.fit(problem(5))


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
    assert fl.fit(problem(enough)).passed


def test_grid_auto_takes_enough_segments_and_then_passes() -> None:
    found = fl.fit(problem(5), grid="auto")
    assert found.passed
    assert found.scene.arm.links[0].segments > 5
    assert all(one.u_num <= one.statistical for one in found.numbers)
    assert all(found[path].low < true < found[path].high for path, true in TRUE.items())


def test_grid_ignore_gives_the_statistical_interval() -> None:
    assert all(one.u_num == 0 and one.doubt is None for one in fl.fit(problem(5), grid="ignore").numbers)


def test_the_check_predicts_the_grid_error_before_anything_is_fitted() -> None:
    expected = fl.fits.check_fit(problem(5)).grid[0]
    found = fitted()[YOUNG]
    assert expected == pytest.approx(found.u_num / found.value, rel=0.5)


def test_the_covariance_contains_the_grid_error() -> None:
    found = fitted()
    deviations = np.array([one.deviation for one in found.numbers])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), deviations, rtol=1e-9)


def test_a_scene_that_starts_from_coordinates_of_its_hinges_has_an_unknown_grid_error() -> None:
    bent = problem(5).scene.varied({"initial.q": [0.0] * fl.lump(problem(5).scene).n})
    found = fl.fit(fl.fits.FitProblem(scene=bent, parameter=problem(5).parameter, run=problem(5).run))
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
    fine = boom(201, **TRUE).varied({"sensor": (gyro,), "run.relative_tolerance": 1e-6})
    run, rng = fl.simulate(fine), np.random.default_rng(1)
    y = run.columns["gyro [rad/s]"]
    seen = y + 0.003 * np.ptp(y) * rng.standard_normal(len(y))
    columns = {"t [s]": tuple(run.t.tolist()), "gyro [rad/s]": tuple(seen.tolist())}
    found = fl.fit(
        fl.fits.FitProblem(
            scene=boom(5).varied({"sensor": (gyro,)}), parameter=problem(5).parameter,
            run=(fl.fits.FitRun(name="step", columns=columns),),
        )
    )  # fmt: skip
    assert all(found[path].low < true < found[path].high for path, true in TRUE.items())
