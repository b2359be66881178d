"""Conditions under which a second run makes a run doubtful, tested with constructed tip paths of known error."""

import dataclasses
import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import flexlink as fl
from flexlink.kernels.stepping.judgement import WRONG
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.motion.monitor import Monitor
from flexlink.motion.verification import doubt, exceeded, multiplies, second_runs
from flexlink.results.balance import Balance
from flexlink.results.samples import Steps
from tests.conftest import flexible, make_scene
from tests.support.words import reviewed

CHAIN = fl.lump(make_scene(flexible("a")))
T = np.linspace(0.0, 4.0, 41)


def path(off: float) -> np.ndarray:
    """Path of a tip that moves by 1 m along x, with this error along y [m]."""
    return np.column_stack([T / 4.0, np.full_like(T, off), np.zeros_like(T)])


def monitor(run: fl.RunSettings, off: float) -> Monitor:
    """The parts of an implicit run's monitor that a second run needs."""
    record = SimpleNamespace(tip=path(off), chain=CHAIN, t=T, q=np.zeros((41, CHAIN.n)), qd=np.zeros((41, CHAIN.n)))
    record.run, record.least_tolerance, record.compared = run, 1e-12, lambda stop: record.tip[:stop]
    of_a_run = SimpleNamespace(run=run, record=record, control=None, explicit=False, extent=1.0, tip_error=0.0)
    of_a_run.n_valid, of_a_run.before = len(T), None
    of_a_run.tolerance, of_a_run.suspicious, of_a_run.travelled = run.tolerance, False, 20.0
    of_a_run.steps = Steps("Radau5", 100, 500)
    return cast("Monitor", of_a_run)


def test_a_second_order_error_is_a_third_of_the_change_with_doubled_steps() -> None:
    """Second-order errors grow fourfold if the step is doubled: tips with errors of 1 cm and 4 cm are 3 cm apart."""
    of_a_run = monitor(fl.RunSettings(step=0.1, sample=0.1, duration=4.0), 0.01)
    second = next(second_runs(of_a_run))
    assert (second.run.step, second.every) == (0.2, 2)
    warning = doubt(of_a_run, second, path(0.04)[::2])
    assert re.findall(r"[\d.]+ m?s?\b", warning) == ["0.01 m", "0.2 s", "1 m"]
    reviewed("doubtful-comparison", warning)


def test_a_tolerance_that_is_exceeded_is_named_with_its_factor() -> None:
    warning = exceeded(monitor(fl.RunSettings(tolerance=1e-3, sample=0.1, duration=4.0), 0.01), 0.01)
    assert re.findall(r"[\d.]+ (?:m|times)\b", warning) == ["0.01 m", "10 times"]
    reviewed("doubtful-comparison", warning)


@pytest.mark.parametrize(("rejected", "taken", "compared"), [(90, 100, True), (70, 100, False), (30, 10, False)])
def test_a_run_that_rejects_most_steps_is_compared(rejected: int, taken: int, compared: bool) -> None:
    """If a motor keeps switching between its limits, errors of 22,000 accurate steps add up to 12 tolerances."""
    of_a_run = monitor(fl.RunSettings(tolerance=1e-3, sample=0.1, duration=4.0), 0.02)
    of_a_run.angle_travelled, cast("Any", of_a_run).travelled = 0.0, 0.0
    cast("Any", of_a_run).steps = Steps("Radau5", taken, 500, rejected)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flexlink.motion.verification.loop_grows", lambda _record: False)
        assert bool(multiplies(of_a_run)) == compared


def test_joint_travel_is_the_sum_over_driven_joints_without_prescribed_motion() -> None:
    """Two driven joints at ±3 and ±2 rad/s travel 12 + 8 rad in 4 s; a prescribed joint and a hinge do not count."""
    links = flexible("a", segments=2), fl.Link(name="b", length=1.0), fl.Link(name="led", length=1.0)
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.0)))
    hinges = chain.hinges.copy()
    hinges["prescribed"][chain.index("led", 0, 0)] = 1
    known = Balance(dataclasses.replace(chain, hinges=hinges), np.zeros(3))
    rates = np.array([3.0, 50.0, 2.0, 100.0]) * np.where(T < 2.0, 1.0, -1.0)[:, None]
    still, rows = np.zeros_like(rates), len(T)
    samples = T, still, rates, still, np.zeros((rows, 3)), np.zeros((3, rows)), np.zeros(rows)
    samples = *samples, np.zeros((rows, SO_FAR.size))
    for first, stop in ((0, 7), (7, rows)):  # the monitor reads the rows in two pieces
        assert known.look(first, stop, samples) == (stop, WRONG.nothing)
    seen = cast("Any", SimpleNamespace(_balance=known, angle_travelled=0.0))
    assert Monitor.travelled.fget(seen) == pytest.approx(20.0)
    seen.angle_travelled = 25.0  # path summed over all steps, longer than the sum over samples
    assert Monitor.travelled.fget(seen) == 25.0
