"""Monitoring of runs: each check of the samples finds what is wrong, in single runs and in batches."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.types import Array
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.kernels.inputs.record import PiecewisePolynomial
from flexlink.motion import monitor
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.static_feedforward import holding_torque
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import tolerance_of
from flexlink.results import resolved_modes
from flexlink.results.record import Record
from flexlink.results.stop_reasons import Failure
from tests.conftest import ALUMINIUM, SQUARE, compiled, flexible, make_scene
from tests.support.words import reviewed


def monitor_of(scene: fl.Scene, *postures: Array) -> Monitor:
    """Monitor of a run with these configurations, at rest."""
    last = 0.01 * (len(postures) - 1)
    problem = problem_of(replace(scene, run=replace(scene.run, sample=0.01, duration=last)))
    q = np.array(postures)
    return Monitor(Record(problem, 0.01 * np.arange(len(q)), q, np.zeros_like(q)))


@pytest.mark.parametrize(("angle", "shown"), [(-31.0, "-31"), (-29.0, ""), (44.0, ""), (46.0, "46")])
def test_a_joint_beyond_either_limit_has_a_warning(angle: float, shown: str) -> None:
    scene = make_scene(flexible("a", joint=fl.Joint(limits_deg=(-30.0, 45.0))))
    q = np.zeros(fl.lump(scene).n)
    bent = q.copy()
    bent[0] = np.radians(angle)
    seen = monitor_of(scene, q, bent)
    seen.check(2)
    expected = ["joint-past-limits"] * bool(shown)
    assert [warning.id for warning in seen.warnings] == expected
    for warning in seen.warnings:
        assert all(part in warning for part in ("'a'", f" {shown}°", "-30°", "45°"))
        reviewed(warning.id, warning)


def test_m_is_checked_where_hinges_are_bent_most() -> None:
    """With matched twist, M is indefinite at 80° (see `test_monitor`), but not at the start of the run."""
    scene = make_scene(
        flexible("a", "xyz", 9, lumping="gauss_matched"), run=fl.RunSettings(step=1e-4, unstable="allow")
    )
    chain = fl.lump(scene)
    bent = np.where(chain.stiffness > 0, np.radians(80.0), 0.0)
    seen = monitor_of(scene, 0 * bent, bent, 0.1 * bent)
    assert not seen.check(3)
    assert "80.0°" in seen.failure
    reviewed("watching: matched twist", seen.failure)
    assert seen.n_valid == 1


def test_the_remedy_is_a_smaller_tolerance_or_for_vanishing_steps_a_larger_one() -> None:
    scene = make_scene(flexible("a"), run=fl.RunSettings(tolerance=1e-4, duration=0.1))
    still = np.zeros(fl.lump(scene).n)
    wrong, stuck = monitor_of(scene, still, still), monitor_of(scene, still, still)
    for each in (wrong, stuck):
        each.check(1)
    wrong.failure = "energy"
    smaller, larger = str(wrong.diverged()), str(stuck.diverged(Failure("t = 0.01 s: steps")))
    assert "a smaller tolerance" in smaller
    assert "a larger tolerance" in larger
    reviewed("watching: remedies", f"{smaller}\n{larger}")


@compiled
def test_m_of_matched_twist_is_checked_in_batches_like_in_single_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_scene(flexible("a", "xyz", 5, lumping="gauss_matched"), run=fl.RunSettings(step=1e-6, duration=4e-6))
    monkeypatch.setattr(monitor, "mass_matrix", lambda chain, q: -np.eye(chain.n))
    texts = []
    for run in (lambda: fl.simulate(scene), lambda: fl.simulate_many([scene, scene])):
        with pytest.raises(fl.errors.DivergenceError) as caught:
            run()
        texts.append(str(caught.value))
    assert texts[1] == texts[0]
    reviewed("watching: M is indefinite", texts[0])


def test_a_controller_is_called_once_per_instant_even_if_the_motion_amplifies_errors() -> None:
    """A controller may have an internal state, so no verification run calls it."""
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    start = fl.InitialState(joint_deg=(0.0,), rate_deg=(4000.0,))
    scene = make_scene(
        rod, initial=start, run=fl.RunSettings(method="DOP853", tolerance=1e-5, duration=0.5, sample=0.1)
    )
    times = []

    def controller(t: float, q: Array, qd: Array) -> Array:
        times.append(t)
        return np.array([50.0])

    run = fl.simulate(scene, control=controller, rate=100.0)
    assert np.abs(run.q).max() > 30.0
    np.testing.assert_allclose(times, 0.01 * np.arange(51), atol=1e-12)
    assert not run.warnings, run.warnings


def test_references_with_equal_times_have_separate_feed_forward_torques() -> None:
    """For two references with the same times, a rod is held at rest by m g L/2 cos θ at its target."""
    scene = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), gravity=(0, -9.81, 0))
    chain, weight = fl.lump(scene), 2700.0 * 0.04**2 * 9.81
    for angle in (0.0, 0.5, 1.0, 0.5):
        target = PiecewisePolynomial(np.array([0.0]), np.array([[[angle]]]))
        torque = holding_torque(chain, target)
        assert torque.coefficients[0, 0, 0] == pytest.approx(weight / 2 * np.cos(angle), rel=1e-12)


@pytest.fixture(scope="module")
def tumbling() -> fl.Scene:
    """A satellite that turns by more than 0.5 rad every 0.1 s."""
    base = fl.Base(kind="free", mass=3.0, center=(0.05, -0.02, 0.03), inertia=(0.2, 0.25, 0.3))
    rod = fl.Link(name="rod", length=0.6, mount=fl.Mount(xyz=(0.2, 0.0, 0.0)), material="aluminium", section="square")
    arm = fl.Arm(links=(rod,), materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE}, base=base)
    start = fl.InitialState(joint_deg=(0.0,), base=fl.details.BaseState(spin_deg=(40.0, 400.0, 60.0)))
    run = fl.RunSettings(method="RK4", step=2e-3, duration=0.2, sample=0.05)
    return fl.Scene(name="tumbling", arm=arm, gravity=(0.0, 0.0, 0.0), initial=start, run=run)


def test_a_control_law_of_zero_torque_leaves_the_base_attitude_unchanged(tumbling: fl.Scene) -> None:
    free = fl.simulate(tumbling)
    driven = fl.simulate(tumbling, control=lambda t, q, qd: np.zeros(len(free.chain.active)))
    assert free.base is not None and driven.base is not None
    assert np.linalg.norm(free.base.attitude[-1] - free.base.attitude[0]) > 0.5
    np.testing.assert_allclose(driven.base.attitude, free.base.attitude, atol=1e-10)
    np.testing.assert_allclose(driven.tip, free.tip, atol=1e-10)


def test_restoring_a_base_restores_its_attitudes(tumbling: fl.Scene) -> None:
    base = FloatingBase(fl.lump(tumbling))
    q = np.zeros((4, base.chain.n))
    q[:, 3:6] = 0.1 * np.arange(12).reshape(4, 3)
    before, saved = base.attitudes(q), base.saved()
    base.turn(2, q[2].copy(), np.zeros(base.chain.n))
    assert np.abs(base.attitudes(q) - before).max() > 0.1
    base.restore(saved)
    np.testing.assert_array_equal(base.attitudes(q), before)


def test_the_work_of_a_constant_force_is_force_times_displacement() -> None:
    force = np.array([1.0, -3.0, 0.5])
    scene = make_scene(flexible("a", "yz", 3, lumping="midpoint"), wrench=fl.Wrench(force=tuple(force)))
    run = fl.simulate(scene, tolerance=1e-5, duration=0.2, sample=0.02)
    assert run.work is not None and np.abs(run.work).max() > 0.01
    np.testing.assert_allclose(run.work, (run.tip - run.tip[0]) @ force, rtol=0, atol=1e-15)


def test_rigid_gravity_compensation_is_evaluated_at_the_reference() -> None:
    """τ = kp (q_d − q) + kd (q̇_d − q̇) + m g L/2 cos q_d for a rod that lags behind its reference."""
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    course = fl.Reference(profile="linear", times=(0.0, 1.0), angle_deg=((0.0,), (60.0,)))
    drive = fl.Drive(kind="pd", kp=(5.0,), kd=(1.0,), gravity="rigid", reference=course)
    scene = make_scene(rod, gravity=(0.0, -9.81, 0.0), drive=drive)
    run = fl.simulate(scene, step=1e-3, method="RK4", sample=0.1, duration=0.9)
    q, qd, weight = run.q[1:, 0], run.qd[1:, 0], 2700.0 * 0.04**2 * 9.81
    led, rate = np.radians(60.0) * run.t[1:], np.radians(60.0)
    expected = 5.0 * (led - q) + (rate - qd) + weight / 2 * np.cos(led)
    np.testing.assert_allclose(run.tau[1:, 0], expected, rtol=1e-9)
    assert np.abs(np.cos(led) - np.cos(q)).max() > 1e-3


def test_the_holding_torque_is_accurate_along_a_long_move() -> None:
    """Polynomial pieces represent m g L/2 cos 1.5 t within 1e-6 of the largest torque."""
    scene = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), gravity=(0, -9.81, 0))
    move = PiecewisePolynomial(np.array([-1.0, 0.0, 1.0]), np.array([[[0.0], [0.0]], [[0.0], [1.5]], [[1.5], [0.0]]]))
    knots, c = holding_torque(fl.lump(scene), move)
    assert len(knots) > 5
    assert (np.diff(knots) > 0).all()
    t = np.linspace(0.0, 1.2, 97)
    piece = np.searchsorted(knots, t, side="right") - 1
    found = ((t - knots[piece])[:, None] ** np.arange(c.shape[1]) * c[piece, :, 0]).sum(axis=1)
    weight = 2700.0 * 0.04**2 * 9.81
    np.testing.assert_allclose(found, weight / 2 * np.cos(1.5 * np.minimum(t, 1.0)), rtol=0, atol=1e-6 * weight / 2)


@pytest.mark.parametrize("waves", [1, 2, 3, 7])
def test_half_waves_of_a_mode_are_counted_by_sign_changes_of_its_moments(waves: int) -> None:
    x = (np.arange(40) + 0.5) / 40
    for sign in (1.0, -1.0):
        assert resolved_modes._half_waves(sign * np.sin(waves * np.pi * x)) == waves


def test_a_relative_tolerance_is_a_fraction_of_the_reach_or_of_the_deflection() -> None:
    chain = fl.lump(make_scene(flexible("a", length=2.0)))
    of_reach = fl.RunSettings(relative_tolerance=1e-3)
    assert tolerance_of(of_reach, chain, 0.05) == pytest.approx(1e-3 * chain.reach, rel=1e-14)
    of_deflection = fl.RunSettings(relative_tolerance=1e-3, accuracy="deflection")
    assert tolerance_of(of_deflection, chain, 0.05) == pytest.approx(1e-3 * 0.05, rel=1e-14)


def test_rounding_errors_next_to_large_moments_are_not_half_waves() -> None:
    moments = -np.sin(np.pi * (np.arange(40) + 0.5) / 40)
    moments[[0, -1]] = 1e-12
    assert resolved_modes._half_waves(moments) == resolved_modes._half_waves(-moments) == 1
