"""Runs whose steps follow from a tolerance, and fixed steps of implicit methods."""

import signal
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.describe.schemes.methods import method
from flexlink.motion.batch import outcomes
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.campaigns.random_jumps import random_jump
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import refused, reviewed
from validation.random_arms import Dice

pytestmark = compiled
SHORT: dict[str, Any] = {"run.duration": 0.3, "run.sample": 0.02}


def swinging(**changes: Any) -> fl.Scene:
    """Two links that bend in a plane, released at an angle, with loss in the material."""
    links = flexible("a", segments=3), flexible("b", segments=3)
    scene = make_scene(*links, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(40.0, -70.0)))
    return scene.varied({"material.aluminium.loss_time": 1e-4, **SHORT, **changes})


@pytest.mark.parametrize(("name", "steps"), [("Radau5", (8, 12)), ("Gauss4", (12, 18)), ("Gauss6", (6, 9))])
def test_fixed_steps_have_the_order_of_their_method(name: str, steps: tuple[int, int]) -> None:
    """The motion is smooth: a compliant arm without damping starts at rest with slack springs."""
    links = flexible("a", segments=2), flexible("b", segments=2)
    scene = make_scene(*links, gravity=(1.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(40.0, -70.0)))
    scene = scene.varied({"material.aluminium.young": 7e6, "run.duration": 0.3, "run.sample": 0.3})
    exact = fl.simulate(scene, method="RK10", step=1e-3).state(-1)
    runs = [fl.simulate(scene, method=name, step=0.3 / n, sample=0.3) for n in steps]
    assert [run.steps.taken for run in runs] == list(steps)
    errors = [max(np.abs(run.q[-1] - exact.q).max(), np.abs(run.qd[-1] - exact.qd).max()) for run in runs]
    order = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    assert order == pytest.approx(method(name).order, abs=0.05)  # allowance for the effect of the next error term


def test_samples_may_be_anywhere_between_steps() -> None:
    scene = swinging()
    coarse, fine = (fl.simulate(scene, method="Radau5", tolerance=1e-4, sample=sample) for sample in (0.06, 0.002))
    np.testing.assert_array_equal(coarse.q[::1], fine.q[::30])
    exact = fl.simulate(scene, method="RK10", step=1e-4, sample=0.002)
    assert np.abs(fine.tip - exact.tip).max() <= 1e-4


def test_a_fixed_step_whose_stages_do_not_converge_is_refused_with_a_remedy() -> None:
    scene = swinging(**{"initial.rate_deg": (3e4, 0.0)})
    with refused(fl.errors.DivergenceError, "newton-failed"):
        fl.simulate(scene, method="Radau5", step=0.1, sample=0.1)


@pytest.mark.parametrize("knots", [False, True], ids=["grid", "knots between grid points"])
def test_a_fixed_step_whose_stages_do_not_converge_is_split_and_the_run_continues(knots: bool) -> None:
    scene = random_jump(Dice(659))
    if knots:
        times = np.arange(0.0, 2.0, 0.0031)
        forces = [scene.wrench.forces[-1] if t >= 0.5 else (0.0, 0.0, 0.0) for t in times]
        scene = scene.varied({"wrench": fl.Wrench(times=tuple(times.tolist()), forces=tuple(forces))})
    run = fl.simulate(scene, method="Gauss6", step=0.005, sample=0.05)
    exact = fl.simulate(scene, method="Radau9", tolerance=1e-9)
    assert run.steps is not None and run.steps.failed > 0
    assert np.linalg.norm(run.tip - exact.tip, axis=1).max() <= 1e-4 * np.ptp(exact.tip, axis=0).max()
    if not knots:
        assert 400 < run.steps.taken <= 400 + 2 * run.steps.failed  # 400 steps of 5 ms, and 5 ms after a short step
        assert not run.warnings
    t, q, qd = run.state(20)
    rest = fl.simulate(scene, method="Gauss6", step=0.005, sample=0.05, q0=q, qd0=qd, t0=t, duration=1.0)
    np.testing.assert_array_equal(rest.q, run.q[20:])
    np.testing.assert_array_equal(rest.qd, run.qd[20:])


def test_a_run_reports_its_method_the_reason_and_its_steps() -> None:
    run = fl.simulate(swinging(**{"run.duration": 2.0}), tolerance=1e-4)
    assert run.steps is not None
    assert run.steps.method == "Radau5"
    assert run.steps.evaluations > run.steps.taken > 0
    reviewed("steps of a run: stiff", str(run.steps), values=False)
    assert str(run.steps).startswith("Radau5 (")
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    rigid = make_scene(rod, gravity=(9.81, 0.0, 0.0), run=fl.RunSettings(duration=0.1, tolerance=1e-6))
    picked = fl.simulate(rigid).steps
    assert picked is not None
    assert picked.method == "DOP853"
    reviewed("steps of a run: not stiff", picked.why)
    assert picked.why.endswith(" 0 rad/s")


def test_deflections_are_accurate_if_the_tolerance_applies_to_them() -> None:
    """Slack springs vibrate under a sudden load by half of the deflection, which is negligible for the tip."""
    scene = swinging(**{"material.aluminium.loss_time": 0.0, "run.duration": 0.5})
    exact = fl.simulate(scene, method="RK10", step=1e-4)
    bent = exact.chain.stiffness > 0
    off = {}
    for accuracy in ("tip", "deflection"):
        run = fl.simulate(scene, method="Radau5", relative_tolerance=1e-2, accuracy=accuracy)
        off[accuracy] = np.abs((run.q - exact.q)[:, bent]).max() / np.abs(exact.q[:, bent]).max()
    assert off["deflection"] <= 0.05
    assert off["tip"] > 0.2


def test_deflections_of_an_arm_that_is_straight_at_first_have_a_tolerance() -> None:
    """Any fraction of the initial deflection of a straight arm is zero; errors up to rounding are allowed.

    The tolerance is a fraction of the largest angle of the run, here within a factor of 2.
    """
    links = flexible("a", segments=3), flexible("b", segments=3)
    pulse = fl.Drive(kind="table", times=(0.0, 0.1, 0.2), torques=((0.0, 0.0), (5.0, 2.0), (0.0, 0.0)))
    scene = make_scene(*links, drive=pulse).varied(SHORT)
    run = fl.simulate(scene, method="Radau5", relative_tolerance=1e-2, accuracy="deflection")
    exact = fl.simulate(scene, method="RK10", step=1e-4)
    bent = exact.chain.stiffness > 0
    assert np.abs((run.q - exact.q)[:, bent]).max() <= 2e-2 * np.abs(exact.q[:, bent]).max()


def test_the_deflection_of_an_arm_that_starts_bent_in_a_stiff_mode_is_not_overestimated() -> None:
    """If the initial q̈ lasted for a period of the slowest mode, the deflection would be a hundred times as large."""
    zigzag = fl.InitialState(q=(0.0, 0.03, -0.03, 0.03, -0.03))
    run = fl.RunSettings(method="DOP853", relative_tolerance=1e-2, accuracy="deflection", duration=0.1, sample=0.01)
    scene = make_scene(flexible("a", segments=5), initial=zigzag).varied({"run": run})
    ready = SingleRun(problem_of(scene))
    there = ready.steps.so_far[0]
    ready.finish(Stop())
    largest = float(np.abs(ready.monitor.record.q).sum(axis=1).max()) * ready.monitor.record.chain.reach
    assert there <= ready.steps.so_far[0] <= largest < ready.monitor.record.chain.reach


def test_only_the_batch_member_with_a_tolerance_below_rounding_is_refused() -> None:
    good = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"))
    good = good.varied({"run": fl.RunSettings(tolerance=1e-3, duration=0.1, sample=0.01)})
    below, (failure, run) = "tolerance-below-rounding", outcomes([good.varied({"run.tolerance": 1e-30}), good], Stop())
    assert isinstance(failure, fl.errors.SceneError)
    assert failure.id == below
    assert isinstance(run, fl.Trajectory)


def test_a_relative_tolerance_needs_a_deflection() -> None:
    link = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    run = fl.RunSettings(relative_tolerance=1e-2, accuracy="deflection", duration=0.1, sample=0.01)
    with refused(fl.errors.SceneError, "nothing-bends"):
        fl.simulate(make_scene(link).varied({"run": run}))


def test_errors_sustained_by_a_sampled_controller_are_within_the_tolerance() -> None:
    """Rate errors of fast vibrations average out, but accelerate the arm if a controller samples and holds them."""
    drive = fl.Drive(kind="computed_torque", kp=(100.0,), kd=(14.0,), rate=12.5, target_deg=(-60.0,))
    run = fl.RunSettings(method="Radau5", tolerance=1e-4, duration=0.8, sample=0.08)
    scene = make_scene(flexible("a", segments=3), drive=drive, gravity=(0.0, -6.0, 0.0)).varied({"run": run})
    exact = fl.simulate(scene, method="DOP853", tolerance=1e-8)
    assert np.abs(fl.simulate(scene).tip - exact.tip).max() <= 5e-4  # 84 tolerances if only vibrations were weighted


def test_vibrations_below_the_tolerance_are_not_resolved() -> None:
    """A sudden load excites the fastest modes without damping, but their bodies hardly move."""
    scene = swinging(**{"material.aluminium.loss_time": 0.0, "run.duration": 1.0})
    run = fl.simulate(scene, method="Radau5", tolerance=1e-4)
    assert run.steps is not None
    assert run.steps.taken * fl.stable_step(run.chain, run.q[0], method="RK4") < 0.1


def test_a_signal_stops_a_run_with_a_tolerance_and_saves_its_samples() -> None:
    scene = swinging(**{"run.duration": 2000.0})

    def stop(part: float) -> None:
        if part > 0:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(fl.errors.InterruptedRunError) as caught:
        fl.simulate(scene, method="Radau5", tolerance=1e-6, progress=stop)
    run = caught.value.trajectory
    assert 0 < len(run.t) < 100_001
    assert np.isfinite(run.q).all()


@pytest.mark.parametrize(
    ("changes", "id"),
    [
        ({"run.step": 1e-4, "run.tolerance": 1e-3}, "both-given"),
        ({"run.relative_tolerance": 1e-4, "run.tolerance": 1e-3}, "both-given"),
        ({"run.accuracy": "deflection", "run.tolerance": 1e-3}, "needs-another-key"),
        ({"run.method": "auto"}, "method-and-step"),
        ({"run.tolerance": -1e-3}, "wrong-value"),
        ({"run.method": "RK4", "run.tolerance": 1e-3}, "method-without-error"),
    ],
)  # fmt: skip
def test_settings_that_exclude_each_other_are_refused(changes: dict[str, Any], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        swinging(**changes)


@pytest.mark.parametrize(("angle", "tolerance"), [(40.0, 1e-14), (360.0 * 1e7, 1e-8)])
def test_a_tolerance_below_the_rounding_error_which_grows_with_the_angles_is_refused(angle, tolerance) -> None:
    with refused(fl.errors.SceneError, "tolerance-below-rounding"):
        fl.simulate(swinging(**{"initial.joint_deg": (angle, -70.0)}), tolerance=tolerance)


@pytest.mark.parametrize("width", [1e-3, 1e-7])
def test_dry_friction_that_reverses_within_a_step_is_seen_by_the_error_estimate(width: float) -> None:
    """This is true for any regularization width: the final Jacobian of the iteration does not hide the reversal."""
    scene = swinging(**{"link.*.joint.coulomb": 3.0, "link.*.joint.coulomb_width": width, "run.duration": 0.6})
    exact = fl.simulate(scene, method="Radau5", tolerance=1e-8)
    for tolerance in (1e-3, 1e-5):
        run = fl.simulate(scene, method="Radau5", tolerance=tolerance)
        assert np.abs(run.tip - exact.tip).max() <= 5 * tolerance


def test_fixed_implicit_steps_end_at_kinks_of_a_table_and_return_to_their_grid() -> None:
    """A pulse of 2.8 ms is off the grid. Halving the step divides errors by over 8 (by 2 if steps crossed kinks)."""
    torques = (0.0, 0.0), (0.0, 0.0), (900.0, 0.0), (0.0, 0.0)
    drive = fl.Drive(kind="table", times=(0.0, 0.0993, 0.1007, 0.1021), torques=torques)
    scene = swinging(drive=drive, **{"material.aluminium.young": 7e7})
    exact = fl.simulate(scene, method="RK10", step=2e-5).tip
    errors = []
    for step in (2.5e-3, 1.25e-3):
        run = fl.simulate(scene, method="Gauss6", step=step)
        assert run.steps is not None
        assert run.steps.taken == round(0.3 / step) + 3  # one additional step for each of three kinks
        errors.append(np.abs(run.tip - exact).max())
    assert errors[1] <= errors[0] / 8


@pytest.mark.parametrize("passive", ["zero", "static"])
@pytest.mark.parametrize("name", ["Radau5", "Radau9", "DOP853"])
def test_an_arm_at_rest_almost_upright_is_not_doubted(name: str, passive: str) -> None:
    """Almost no energy is exchanged, so an allowed energy error is a large fraction of the energy exchanged."""
    scene = swinging(**{"initial.joint_deg": (179.999, 0.0), "initial.passive": passive})
    assert fl.simulate(scene, method=name, relative_tolerance=1e-3).warnings == ()
