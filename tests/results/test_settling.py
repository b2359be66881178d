"""Settling of the tip, and conversion of runs to pandas and xarray tables."""

import dataclasses
import math
import sys

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.data.csv_table import Measured
from flexlink.describe.numbers import within
from flexlink.identification.data import recorded
from flexlink.scene_report.fitting import Comparison
from flexlink.sweeps.measures import SweepOutput
from tests.conftest import nasty_scene
from tests.support.words import refused

ζ, ω, STEP = 0.1, 2 * np.pi, 0.3  # of a tip that moves by 0.3 m to its target as an oscillator of 1 Hz
TARGET = (1.0 + STEP, 2.0, 0.0)


@pytest.fixture(scope="module")
def short_run() -> fl.Trajectory:
    return fl.simulate(nasty_scene(), duration=2e-3, sample=1e-3)


@pytest.fixture(scope="module")
def step_response(short_run: fl.Trajectory) -> fl.Trajectory:
    """x = 1 + 0.3 (1 − exp(−ζωt) (cos ω_d t + ζ/√(1 − ζ²) sin ω_d t)), the textbook response of second order."""
    t = np.linspace(0.0, 10.0, 10_001)
    damped = ω * math.sqrt(1 - ζ**2)
    x = 1 - np.exp(-ζ * ω * t) * (np.cos(damped * t) + ζ / math.sqrt(1 - ζ**2) * np.sin(damped * t))
    tip = np.column_stack([1.0 + STEP * x, np.full(len(t), 2.0), np.zeros(len(t))])
    return dataclasses.replace(short_run, t=t, tip=tip)


def test_the_overshoot_equals_the_textbook_value(step_response: fl.Trajectory) -> None:
    wanted = math.exp(-np.pi * ζ / math.sqrt(1 - ζ**2))
    near = STEP * (ω * 1e-3) ** 2 / 8  # the peak is at most half a sample away
    assert step_response.overshoot(target=TARGET) == pytest.approx(STEP * wanted, abs=near)
    assert step_response.overshoot(target=(2.0, 2.0, 0.0)) == 0.0
    with refused(fl.errors.ArgumentError, "no-travel"):
        step_response.overshoot(target=(1.0, 2.0, 0.0))


def test_the_settling_time_is_when_the_tip_leaves_the_tolerance_for_the_last_time(step_response: fl.Trajectory) -> None:
    tolerance = 0.02 * STEP
    found = step_response.settling_time(target=TARGET, tolerance=tolerance)
    away = np.linalg.norm(step_response.tip - TARGET, axis=1)
    k = round(found / 1e-3)
    assert away[k - 1] > tolerance >= away[k:].max()
    envelope = -math.log(0.02 * math.sqrt(1 - ζ**2)) / (ζ * ω)
    assert envelope - 0.5 <= found <= envelope + 1e-3  # within half a period plus one sample of the envelope
    later = step_response.settling_time(target=TARGET, tolerance=tolerance, after=2.0)
    assert later == pytest.approx(found - 2.0, abs=1e-12)
    assert step_response.settling_time(target=TARGET, tolerance=1.0) == 0.0
    assert step_response.settling_time(target=(5.0, 0.0, 0.0), tolerance=1.0) == math.inf


def test_residual_vibration_is_the_amplitude_about_any_rest_position(step_response: fl.Trajectory) -> None:
    t, (a, b) = step_response.t, np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 0.5]])
    swing = np.outer(0.01 * np.cos(5 * t), a) + np.outer(0.01 * np.sin(5 * t), b)
    run = dataclasses.replace(step_response, tip=np.array([7.0, -3.0, 1.0]) + swing)
    assert run.residual_vibration(after=5.0) == pytest.approx(0.01, rel=2e-5)  # sampled at 1/1000 of its period
    assert step_response.residual_vibration(after=9.0) < step_response.residual_vibration(after=5.0) < STEP


def test_invalid_arguments_of_measures_are_refused(step_response: fl.Trajectory) -> None:
    with refused(fl.errors.ArgumentError, "too-few-samples"):
        step_response.settling_time(target=TARGET, tolerance=1e-3, after=11.0)
    with refused(fl.errors.ArgumentError, "too-few-samples"):
        step_response.residual_vibration(after=10.0)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        step_response.residual_vibration(after="end")
    with refused(fl.errors.ArgumentError, "out-of-range"):
        step_response.settling_time(target=TARGET, tolerance=0)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        step_response.overshoot(target=(1.0, 2.0))


def test_a_pandas_table_has_every_column_and_is_indexed_by_time(short_run: fl.Trajectory) -> None:
    pytest.importorskip("pandas")
    table = short_run.to_pandas()
    assert [table.index.name, *table.columns] == list(short_run.columns)
    assert np.array_equal(np.column_stack([table.index, table]), np.column_stack(list(short_run.columns.values())))


def test_an_xarray_dataset_has_every_quantity_by_time_and_joint_with_its_unit(short_run: fl.Trajectory) -> None:
    pytest.importorskip("xarray")
    data = short_run.to_xarray()
    assert np.array_equal(data.q.sel(joint="upper.2.z"), short_run.q[:, short_run.chain.index("upper", 2, 3)])
    assert np.array_equal(data.tip.sel(axis="z"), short_run.tip[:, 2])
    for name in ("q", "qd", "tau", "tip", "work", "imbalance"):
        assert np.array_equal(data[name], getattr(short_run, name))
    assert {name: data[name].units for name in ("time", "q", "qd", "tau", "tip", "elastic")} == {
        "time": "s", "q": "rad", "qd": "rad/s", "tau": "N m", "tip": "m", "elastic": "J",
    }  # fmt: skip
    assert "work" not in dataclasses.replace(short_run, work=None).to_xarray()


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_without_the_package_the_error_names_the_command_that_installs_it(short_run, package, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with refused(fl.errors.MissingDependencyError, "package-missing"):
        getattr(short_run, f"to_{package}")()


def test_a_sample_at_a_decimal_time_is_from_this_time_on() -> None:
    """The sample at 0.33 s of a run with samples every 0.03 s is at 11 · 0.03 < 0.33 in binary numbers."""
    scene = fl.load_scene("models/paper_fig5.toml").varied({"run.sample": 0.03, "run.duration": 0.66})
    run = fl.simulate(scene, relative_tolerance=1e-2)
    assert run.t[11] < 0.33 and run.t[22] < 0.66
    assert run.settling_time(target=run.tip[-1], tolerance=10.0, after=0.33) == 0.0
    assert SweepOutput(of="tip z [m]", take="first", after=0.33).measure(run) == run.tip[11, 2]
    columns = {name: tuple(run.columns[name].tolist()) for name in ("t [s]", "tip z [m]")}
    record = fl.fits.FitRun(name="a", columns=columns, window=(0.33, 0.66))
    problem = fl.fits.FitProblem(scene=scene, parameter=(fl.fits.FitParameter(path="tip.mass"),), run=(record,))
    assert len(recorded(problem, record).blocks[0].y) == 12
    late = replace(record, window=None, start=0.33)
    assert len(recorded(problem, late).blocks[0].y) == 12
    assert Comparison(scene, run, Measured(np.array([0.0, 0.33, 0.66]), {})).left_out == 0


def test_times_within_limits_are_judged_up_to_rounding_alone() -> None:
    t = np.array([0.0, 0.1, 0.2, 0.3]) - 0.1 + 0.1
    assert within(t, 0.1, 0.2).tolist() == [False, True, True, False]
    assert within(t, 0.1 + 1e-9, 0.2 - 1e-9).tolist() == [False] * 4
    assert within(1e-9 * t, 0.5e-10).tolist() == [False, True, True, True]
    assert within(t[:0], 0.0).tolist() == []
