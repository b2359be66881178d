"""Times at which steps must end apart from their regular grid: knots of inputs, samples, instants of a control law."""

import itertools
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.schemes.methods import method
from flexlink.motion.inputs.actuation import corners
from flexlink.motion.inputs.drives import drive_arrays
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.tstops import breakpoints, instants, merged_breakpoints
from flexlink.motion.stop_times import StopTimes
from flexlink.results.record import Record
from tests.conftest import ROOT, flexible, make_scene

ARM = make_scene(flexible("a", segments=3))


def stop_times(scene: fl.Scene) -> StopTimes:
    problem = problem_of(scene)
    rows = scene.run.samples, problem.chain.n
    record = Record(problem, scene.run.times, np.zeros(rows), np.zeros(rows))
    return StopTimes(method(scene.run.method), record, by_drive=True)


def driven(times: tuple[float, ...], torques: tuple[float, ...], **run: object) -> fl.Scene:
    drive = fl.Drive(kind="table", times=times, torques=tuple((x,) for x in torques))
    return ARM.varied({"drive": drive, "run": fl.RunSettings(sample=0.1, duration=1.0, **run)})


def test_a_fixed_step_is_split_at_a_kink_and_the_next_one_ends_on_the_grid() -> None:
    scene = driven((0.0, 0.0125, 1.0), (0.0, 1.0, 0.0), method="Radau5", step=0.01)
    assert stop_times(scene).between(0.0, 0.1)[0] == pytest.approx([0.0125, 0.02, 0.1], abs=1e-15)


def test_steps_end_at_table_kinks_above_the_threshold() -> None:
    """A triangular bump of height b deviates by b/2 from the cubic through the neighbouring knots."""
    times, part = np.linspace(0.0, 1.0, 65), 1e-3
    for bump, landed in ((1.0, False), (5.0, True)):
        torques = times + bump * part * (np.arange(65) == 33)
        scene = driven(tuple(times), tuple(torques))
        found = merged_breakpoints(drive_arrays(scene, fl.lump(scene)).feedforward, part)
        assert (times[33] in found) == landed


def test_a_sampled_law_is_evaluated_at_the_last_instant_before_the_end() -> None:
    drive = fl.Drive(kind="pd", kp=(1.0,), kd=(0.1,), target_deg=(0.0,), rate=10.0)
    scene = ARM.varied(
        {"drive": drive, "run": fl.RunSettings(sample=0.5, duration=0.5, method="Radau5", tolerance=1e-3)}
    )
    law = drive_arrays(scene, fl.lump(scene))
    assert instants(law, 0.0, 0.34) == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert stop_times(scene).between(0.0, 0.34)[0] == pytest.approx([0.1, 0.2, 0.3, 0.34])


def test_steps_end_at_the_breakpoints_of_the_feed_forward() -> None:
    """The holding torque of a bent arm along a move has more breakpoints than the move."""
    scene = fl.load_scene(ROOT / "models" / "ptp_move.toml")
    assert scene.drive.gravity == "static"
    law = drive_arrays(scene, fl.lump(scene))
    assert len(law.feedforward.knots) > len(law.reference.knots)
    assert {*law.feedforward.knots, *law.reference.knots} <= {*breakpoints(law, 1e-3)}


@pytest.mark.parametrize("smooth", [False, True])
def test_a_table_of_torques_has_corners_at_its_times_unless_it_is_smooth_and_alone(smooth: bool) -> None:
    """Added to a PD drive, whose fixed reference has one knot at 0, even a smooth table has corners."""
    table: dict[str, Any] = {"times": (0.0, 0.3, 1.0), "torques": ((0.0,), (1.0,), (0.0,)), "smooth": smooth}
    servo: dict[str, Any] = {"kp": (1.0,), "kd": (0.1,), "target_deg": (0.0,)}
    drives = fl.Drive(kind="table", **table), fl.Drive(kind="pd", **servo, **table)
    found = [corners(drive_arrays(ARM.varied({"drive": drive}), fl.lump(ARM))).tolist() for drive in drives]
    assert found == [[] if smooth else [0.0, 0.3, 1.0], [0.0, 0.0, 0.3, 1.0]]


def test_long_steps_of_dop853_pass_samples_but_stop_at_control_instants() -> None:
    """A step of 15 evaluations ends at every third sample, where the law is evaluated: fewer than 12 per sample."""
    drive = fl.Drive(kind="pd", kp=(1.0,), kd=(0.1,), target_deg=(0.0,), rate=8 / 3)
    run = fl.RunSettings(sample=0.125, duration=0.75, method="DOP853", tolerance=1e-3)
    times, passed_by = stop_times(ARM.varied({"drive": drive, "run": run})).between(0.0, 0.75)
    assert times == pytest.approx([0.125, 0.25, 0.375, 0.5, 0.625, 0.75])
    assert passed_by.tolist() == pytest.approx([0.15625, 0.15625, np.inf, 0.15625, 0.15625, np.inf])


@pytest.mark.parametrize("passes", [True, False])
def test_a_verification_run_stops_halfway_between_the_stops_of_the_run(passes: bool) -> None:
    """The verification run steps past a sample exactly if the run does."""
    run = fl.RunSettings(sample=0.1, duration=0.4, method="DOP853", tolerance=1e-3)
    problem = problem_of(ARM.varied({"run": run}))
    record = Record(problem, run.times, np.zeros((5, 3)), np.zeros((5, 3)))
    times, passed_by = StopTimes(method("DOP853"), record, by_drive=True, halved=True, passes=passes).between(0.0, 0.2)
    assert times == pytest.approx([0.05, 0.1, 0.15, 0.2])
    assert passed_by.tolist() == pytest.approx([0.125, 0.125, 0.125, np.inf] if passes else [np.inf] * 4)


def test_steps_of_tumbling_bodies_end_at_samples() -> None:
    """Tumbling amplifies the errors of longer steps; only steps of damped motion pass samples."""
    stub = fl.Link(name="stub", on="base", length=1.0, end=fl.RigidBody(mass=1e-3))
    body = fl.Scene(
        name="body", arm=fl.Arm(links=(stub,), base=fl.Base(kind="free", mass=10.0, inertia=(1.0, 2.0, 3.0))),
        initial=fl.InitialState(joint_deg=(0.0,)),
        run=fl.RunSettings(sample=0.1, duration=0.4, method="DOP853", tolerance=1e-3),
    )  # fmt: skip
    held = body.varied({"base.mass": 10.0, "link.stub.joint": fl.Joint(viscous=1e4, armature=1e-3)})
    passed = [stop_times(scene).between(0.0, 0.4)[1].tolist() for scene in (body, held)]
    assert passed == [[np.inf] * 4, pytest.approx([0.125, 0.125, 0.125, np.inf])]


TIMES = np.linspace(0.0, 1.0, 241)
LINK = make_scene(flexible("a"))


def table(torques: np.ndarray, smooth: bool = True, times: np.ndarray = TIMES):
    drive = fl.Drive(kind="table", smooth=smooth, times=tuple(times), torques=tuple((x,) for x in torques))
    scene = LINK.varied({"drive": drive})
    return drive_arrays(scene, fl.lump(scene)).feedforward


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("part", [1e-2, 1e-4])
def test_between_merged_breakpoints_a_cubic_fits_the_table_within_the_tolerance(smooth: bool, part: float) -> None:
    """The least-squares cubic has no larger residual at the knots than the cubic that was checked.

    A smooth table keeps few breakpoints; the corners of a piecewise linear table deviate by 2e-4 of its range.
    """
    torques = 3.0 * np.sin(2 * np.pi * TIMES) ** 3
    kept = merged_breakpoints(table(torques, smooth), part)
    assert kept[[0, -1]].tolist() == [0.0, 1.0]
    assert len(kept) < 241 / 4 or (not smooth and part < 2e-4)
    for a, b in itertools.pairwise(kept):
        inside = (a <= TIMES) & (b >= TIMES)
        if inside.sum() > 4:
            x = TIMES[inside] - a
            off = np.polyval(np.polyfit(x, torques[inside], 3), x) - torques[inside]
            assert np.sqrt(np.mean(off**2)) <= part * 3.0


def test_a_smaller_tolerance_keeps_more_breakpoints() -> None:
    drive = table(np.sin(7.0 * TIMES))
    assert (
        len(merged_breakpoints(drive, 1e-2))
        < len(merged_breakpoints(drive, 1e-4))
        < len(merged_breakpoints(drive, 1e-6))
    )
    assert len(merged_breakpoints(drive, 0.0)) == 121  # pairs of pieces are always merged


def test_an_isolated_torque_pulse_keeps_its_breakpoints() -> None:
    torques = np.zeros(241)
    torques[100] = 5.0
    kept = merged_breakpoints(table(torques, smooth=False), 1e-3)
    assert set(TIMES[[99, 100, 101]]) <= set(kept)
    assert len(kept) < 20


def test_a_constant_drive_has_one_breakpoint() -> None:
    scene = LINK.varied({"drive": fl.Drive(kind="constant", torque=(2.0,))})
    assert merged_breakpoints(drive_arrays(scene, fl.lump(scene)).feedforward, 1e-3).tolist() == [0.0]
    assert merged_breakpoints(drive_arrays(LINK, fl.lump(LINK)).feedforward, 1e-3).tolist() == [0.0]


def test_a_linear_torque_table_keeps_few_breakpoints() -> None:
    assert merged_breakpoints(table(2.0 * TIMES, smooth=False), 1e-9)[[0, -1]].tolist() == [0.0, 1.0]
    assert (
        len(merged_breakpoints(table(2.0 * TIMES, smooth=False), 1e-9)) <= 8
    )  # 240 pieces merged in powers of two: 128 + 64 + 32 + 16


def test_breakpoints_at_jumps_of_piecewise_constant_torques_are_kept() -> None:
    drive = table(np.repeat([0.0, 4.0, 1.0], [80, 80, 81]), smooth=False)
    jumps = TIMES[[0, 80, 160]]
    kept = merged_breakpoints(drive._replace(coefficients=drive.coefficients[:, :1]), 1e-3)
    assert set(jumps) <= set(kept)
    assert len(kept) < 40
