"""Sampled control laws whose torques act later than their sampling instants: drives of a scene, and laws in Python."""

import collections
import dataclasses
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion.hindrance import sampled_growth
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.conftest import ALUMINIUM, flexible, make_scene
from tests.support.words import refused

RATE, KP, KD, TARGET = 100.0, 400.0, 30.0, 0.3
DELAYS = [0.0, 0.01, 0.02, 0.004, 0.017, 0.0333]  # none, whole samples, parts of a sample [s]
STEPS: dict[str, dict[str, Any]] = {
    "RK4": {"method": "RK4", "step": 1e-4},
    "Radau5": {"method": "Radau5", "step": 1e-4},
    "tolerance": {"tolerance": 1e-9},
}


def rod(delay: float, **changes: object) -> fl.Scene:
    """A rigid rod of 1 m that turns about a vertical axis under a sampled PD drive."""
    link = fl.Link(name="rod", length=1.0, material="aluminium", section="square", joint=fl.Joint(armature=0.5))
    drive = fl.Drive(kind="pd", kp=(KP,), kd=(KD,), target_deg=(np.degrees(TARGET),), rate=RATE, delay=delay)
    run = fl.RunSettings(step=1e-4, duration=0.3, sample=0.01)
    return make_scene(link, gravity=(0.0, 0.0, 0.0), drive=drive, run=run).varied(changes)


def exact_rod(delay: float, times: np.ndarray) -> np.ndarray:
    """Angle and rate of the rod at these times: parabolas between the instants at which the torque changes."""
    side = 0.04  # of the section [m]
    inertia = 0.5 + ALUMINIUM.density * side**2 * (1 / 3 + side**2 / 12)
    instants = np.arange(31) / RATE
    events = sorted({*instants, *(instants + delay), *times})
    torques, acting, state, found, t = collections.deque[tuple[float, float]](), 0.0, np.zeros(2), [], 0.0
    for k, event in enumerate(events):
        h, a = event - t, acting / inertia
        state, t = np.array([state[0] + state[1] * h + a * h**2 / 2, state[1] + a * h]), event
        if event in instants:
            torque = KP * (TARGET - state[0]) - KD * state[1]
            torques.append((event + delay, torque))
            acting = torque if k == 0 else acting
        while torques and torques[0][0] <= event + 1e-12:
            acting = torques.popleft()[1]
        if event in times:
            found.append(state)
    return np.array(found)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("delay", DELAYS)
def test_a_rod_moves_as_by_parabolas_between_the_changes_of_torque(delay: float, steps: str) -> None:
    run = fl.simulate(rod(delay), **STEPS[steps])
    wanted = exact_rod(delay, run.t)
    np.testing.assert_allclose(np.hstack([run.q, run.qd]), wanted, rtol=0, atol=1e-8 if steps == "tolerance" else 1e-11)


def arm(delay: float, **changes: object) -> fl.Scene:
    links = flexible("upper", segments=3, joint=fl.Joint(armature=0.1)), flexible("fore", segments=3)
    drive = fl.Drive(
        kind="pd", kp=(40.0, 20.0), kd=(1.0, 0.5), target_deg=(-80.0, -10.0), gravity="static", rate=500.0, delay=delay
    )
    start = fl.InitialState(joint_deg=(-75.0, -10.0))
    run = fl.RunSettings(step=1e-4, duration=0.08, sample=0.01)
    gravity = (0.0, -9.81, 0.0)
    tip = fl.RigidBody(mass=0.5)
    return make_scene(*links, tip=tip, gravity=gravity, initial=start, drive=drive, run=run).varied(changes)


def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """A law in Python; the driven joints of `arm` are 0 and 3."""
    return np.array([40.0 * np.sin(50.0 * t) - 20.0 * q[0] - qd[0], -10.0 * q[3] - 0.5 * qd[3]])


GIVEN: dict[str, tuple[dict[str, object], dict[str, Any]]] = {
    "drive": ({}, {}),
    "law": ({"drive": None}, {"control": law, "rate": 500.0}),
}


def given(name: str, delay: float) -> tuple[fl.Scene, dict[str, Any]]:
    changes, options = GIVEN[name]
    return arm(0.0 if options else delay, **changes), {**options, "delay": delay} if options else {}


@pytest.mark.parametrize("name", GIVEN)
@pytest.mark.parametrize("method", ["RK4", "Radau5"])
@pytest.mark.parametrize("delay", [0.0007, 0.002, 0.0051])
def test_a_run_after_another_equals_the_uninterrupted_run_to_the_bit(delay, method, name, tmp_path) -> None:
    scene, options = given(name, delay)
    whole, first = (fl.simulate(scene, method=method, duration=duration, **options) for duration in (0.08, 0.03))
    read = fl.Trajectory.load(first.save(tmp_path / "first.npz"))
    problem = fl.Problem(scene.varied({"run.method": method}))
    rests = [
        fl.simulate(scene, method=method, after=read, duration=0.05, **options),
        problem.simulate(after=first, duration=0.05, **options),
    ]
    for rest in rests:
        for part in ("t", "q", "qd", "tau", "tip"):
            np.testing.assert_array_equal(getattr(rest, part), getattr(whole, part)[3:], err_msg=part)


def test_a_law_in_python_with_a_delay_equals_a_law_with_a_queue() -> None:
    scene, options = given("law", 0.004)
    first = law(0.0, *fl.initial_state(scene, fl.lump(scene)))
    queue = collections.deque([first, first])

    def late(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        queue.append(law(t, q, qd))
        return queue.popleft()

    for steps, near in (({}, 1e-12), ({"tolerance": 1e-6}, 1e-6)):  # gains of the two laws are estimated at other times
        queue = collections.deque([first, first])
        wanted = fl.simulate(scene, control=late, rate=500.0, **steps)
        np.testing.assert_allclose(fl.simulate(scene, **options, **steps).q, wanted.q, rtol=0, atol=near)


def test_an_arm_at_rest_stays_at_rest_until_and_after_the_first_torque_acts() -> None:
    rest = fl.simulate(arm(0.0051, **{"initial.joint_deg": (-80.0, -10.0), "initial.passive": "static"}))
    assert np.abs(rest.qd).max() < 1e-9


def crane(delay: float) -> fl.Scene:
    """A crane of two steel tubes with 200 kg at its tip, its PD drive sampled at 1 kHz."""
    tube = {"pipe": fl.Section(shape="tube", outer=0.16, inner=0.15)}
    steel = {"steel": fl.Material(young=210e9, density=7850.0)}
    links = tuple(
        fl.Link(
            name=name, length=length, flex="z", segments=5, material="steel", section="pipe",
            joint=fl.Joint(axis=(0, -1, 0), armature=armature), damping=fl.Damping(ratio=0.01, at_hz=5.0),
        )
        for name, length, armature in (("boom", 4.0, 20.0), ("jib", 3.0, 10.0))
    )  # fmt: skip
    drive = fl.Drive(
        kind="pd", kp=(4e5, 2e5), kd=(4e4, 1e4), target_deg=(20, -40), gravity="static", rate=1000.0, delay=delay
    )
    return fl.Scene(
        name="crane", arm=fl.Arm(links=links, materials=steel, sections=tube, tip=fl.RigidBody(mass=200.0)),
        gravity=(0, 0, -9.81), initial=fl.InitialState(joint_deg=(20, -40), passive="static"), drive=drive,
        run=fl.RunSettings(duration=0.06, sample=1e-3, tolerance=1e-10),
    )  # fmt: skip


@pytest.mark.parametrize(("delay", "growth"), [(0.0, 0.99938), (0.001, 1.33631), (0.002, 1.35187), (0.0017, None)])
def test_small_motion_grows_from_sample_to_sample_as_the_linear_loop(delay: float, growth: float | None) -> None:
    """The growth with 0, 1 and 2 samples of delay is that of a discrete-time model made with python-control."""
    scene = crane(delay)
    record = SingleRun(problem_of(scene)).monitor.record
    found, _ = sampled_growth(record)
    if growth is not None:
        assert abs(found - growth) < 1e-5
    if found > 1:
        rest = record.q[0]
        run = fl.simulate(scene, q0=rest + 1e-12 * np.cos(np.arange(len(rest))))
        size = np.linalg.norm(run.q - rest, axis=1)
        assert abs((size[-1] / size[-31]) ** (1 / 30) - found) < 0.02  # the mode oscillates, and so does its size


@pytest.mark.parametrize(
    ("changes", "id"),
    [
        ({"drive.rate": None}, "needs-another-key"),
        ({"drive.delay": -0.001}, "wrong-value"),
        ({"drive.delay": 0.00105}, "not-a-multiple"),
    ],
)
def test_a_delay_that_cannot_act_is_refused(changes: dict[str, object], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        fl.simulate(arm(0.001).varied(changes))


def test_a_delay_without_a_sampled_law_is_refused() -> None:
    scene, _ = given("law", 0.0)
    with refused(fl.errors.ArgumentError, "no-effect"):
        fl.simulate(scene, delay=0.001)
    with refused(fl.errors.ArgumentError, "no-effect"):
        fl.simulate(scene, control=law, delay=0.001)
    with refused(fl.errors.ArgumentError, "both-given"):
        fl.simulate(scene, after=fl.simulate(scene), t0=0.0)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.simulate(scene, after=dataclasses.replace(fl.simulate(scene), delayed=np.ones((1, 4))))
