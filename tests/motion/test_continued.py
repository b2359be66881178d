"""A run can be continued from any of its samples or states as if it had never stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.data_files import names
from flexlink.describe.schemes.methods import method as load_method
from tests.conftest import flexible, make_scene
from tests.support.words import refused

TABLE = {"kind": "table", "times": [0.0, 0.02, 0.06], "torques": [[1.0, 0.0], [-3.0, 1.0], [2.0, 0.5]]}
PD = {"kind": "pd", "kp": [40.0, 20.0], "kd": [1.0, 0.5], "target_deg": [-80.0, -10.0]}
DRIVES: dict[str, dict[str, Any]] = {
    "none": {"kind": "none"},
    "constant": {"kind": "constant", "torque": [2.0, -1.0]},
    "pd": PD,
    "linear": TABLE,
    "smooth": {**TABLE, "smooth": True},
    "hold": {**TABLE, "hold": True},
    "limited": {**TABLE, "effort": [1.5, 0.75]},
    "sampled": {**PD, "gravity": "static", "effort": [3.0, 0.5], "rate": 500.0},
    "computed": {**PD, "kind": "computed_torque"},
    "computed, sampled": {**PD, "kind": "computed_torque", "rate": 500.0},
}


def arm(drive: str, **changes: object) -> fl.Scene:
    friction = fl.Joint(viscous=0.1, coulomb=0.3, coulomb_width=0.05, armature=0.01)
    links = flexible("upper", segments=3, joint=friction), flexible("fore", segments=3)
    scene = make_scene(*links, tip=fl.RigidBody(mass=0.5), initial=fl.InitialState(joint_deg=(-80.0, -10.0)))
    run = {"run.duration": 0.08, "run.sample": 0.01, "run.step": 1e-4}
    return scene.varied({"drive": DRIVES[drive], "wrench.force": [1.0, -2.0, 0.0], **run, **changes})


MOTION = fl.PrescribedMotion(
    link="upper", times=(0.0, 0.0137), angle_deg=(-80.0, -78.0), rate_deg=(0.0, 50.0), acceleration_deg=(0.0, 0.0)
)


def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """A sampled control law; the driven joints of `arm` are 0 and 3."""
    return np.array([40.0 * np.sin(50.0 * t) - 20.0 * q[0] - qd[0], -10.0 * q[3] - 0.5 * qd[3]])


@pytest.mark.parametrize("given", [*DRIVES, "motion", "law"])
@pytest.mark.parametrize("method", names("methods"))
def test_a_continued_run_equals_the_uninterrupted_run_to_the_bit(method: str, given: str) -> None:
    """The arm has friction and a tip wrench; knots of tables and of the motion lie within implicit steps of 2 ms."""
    step = 2e-3 if not load_method(method).explicit else 5e-5 if method in {"RK2", "RK3"} else 1e-4
    drive = given if given in DRIVES else "linear" if given == "motion" else "none"
    scene = arm(drive, **{"run.method": method, "run.step": step, "run.unstable": "allow"})
    scene = scene.varied({"motion": (MOTION,)}) if given == "motion" else scene
    options = {"control": law, "rate": 500.0} if given == "law" else {}
    whole = fl.simulate(scene, **options)
    for k in (3, 5):
        t, q, qd = whole.state(k)
        rest = fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=(8 - k) * 0.01, **options)
        for name in ("t", "q", "qd", "tau", "tip"):
            np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[k:], err_msg=name)


ALIKE = {"ratio": 0.05, "law": "constant"}


@pytest.mark.parametrize("method", ["RK4", "Radau5"])
def test_constant_ratio_dampers_stay_the_same_in_continued_runs(method: str, tmp_path: Path) -> None:
    scene = arm("pd", **{"link.*.damping": ALIKE, "run.method": method})
    whole = fl.simulate(scene)
    t, q, qd = whole.state(4)
    start = {"q0": q, "qd0": qd, "t0": t, "duration": 0.04}
    described = scene.varied({"initial.q": q, "initial.qd": qd, "initial.time": t, "run.duration": 0.04})
    read = fl.load_scene(described.save(tmp_path / "continued.toml"))
    rests = [fl.simulate(scene, **start), fl.Problem(scene).simulate(**start), fl.simulate(read)]
    rests += [fl.load_trajectory(rests[0].save(tmp_path / "rest.npz"))]
    for rest in rests:
        assert rest.chain.couplings.tobytes() == whole.chain.couplings.tobytes()
        assert rest.chain.hinges.tobytes() == whole.chain.hinges.tobytes()
        for name in ("t", "q", "qd", "tau", "tip"):
            np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name)[4:], err_msg=name)
    stepped = fl.Simulator(scene)
    stepped.reset(q, qd, time=t)
    assert stepped.step().q.tolist() == whole.q[5].tolist()
    elsewhere = fl.lump(scene.varied({"initial.joint_deg": [-80.0, 60.0]}))
    assert elsewhere.couplings.tobytes() != whole.chain.couplings.tobytes()


@pytest.mark.parametrize("method", ["Gauss6", "RK4"])
def test_a_sampled_law_with_inexact_step_times_causes_no_tiny_extra_step(method: str) -> None:
    """Each sampling interval has 17 steps, but the times k / rate and 17 k · step differ in the last bits."""
    scene = arm(
        "sampled", **{"run.method": method, "drive.rate": 200.0, "run.step": 1 / 200 / 17 / 2 ** (method == "RK4")}
    )
    run, stepped = fl.simulate(scene), fl.Simulator(scene)
    assert run.steps.taken == round(0.08 / scene.run.step)
    for q in run.q[1:]:
        assert stepped.step().q.tolist() == q.tolist()


def test_a_continued_run_of_a_free_base_agrees_within_rounding() -> None:
    """The continued run uses other attitude angles: errors of 1e-16 per step added up to 4e-15 over 2,000 steps."""
    spinning = fl.InitialState(
        joint_deg=(20.0,), base=fl.details.BaseState(rpy_deg=(10.0, 20.0, 30.0), spin=(3.0, 4.0, 5.0))
    )
    base = fl.Base(kind="free", mass=4.0, inertia=(0.2, 0.3, 0.4))
    bent = make_scene(flexible("a", segments=3)).arm
    run = fl.RunSettings(method="RK4", step=1e-4, sample=0.05, duration=0.4)
    scene = fl.Scene(
        name="free", arm=msgspec.structs.replace(bent, base=base), initial=spinning, run=run, gravity=(0.0, 0.0, 0.0)
    )
    whole = fl.simulate(scene)
    t, q, qd = whole.state(4)
    rest = fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=0.2)
    np.testing.assert_allclose(rest.q, whole.q[4:], rtol=0, atol=1e-11)


def test_an_initial_state_that_contradicts_a_prescribed_motion_is_refused() -> None:
    scene = arm("linear", motion=(MOTION,))
    t, q, qd = fl.simulate(scene).state(-4)
    with refused(fl.errors.SceneError, "start-differs-from-motion"):
        fl.simulate(scene, q0=q + 0.01, qd0=qd, t0=t, duration=0.03)


def test_a_continued_run_stays_within_its_tolerance() -> None:
    scene = arm("smooth").varied({"run.tolerance": 1e-5})
    whole = fl.simulate(scene)
    t, q, qd = whole.state(4)
    rest = fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=0.04)
    np.testing.assert_array_equal(rest.t, whole.t[4:])
    assert np.linalg.norm(rest.tip - whole.tip[4:], axis=1).max() < 2e-5  # each run is within its tolerance


def test_a_piecewise_constant_torque_jumps_exactly_between_two_steps() -> None:
    """Until the jump, the run is bitwise equal to a run with the first torque only; then the next torque acts."""
    before = fl.simulate(arm("constant", **{"drive.torque": [1.0, 0.0]}))
    run = fl.simulate(arm("hold"))
    np.testing.assert_array_equal(run.q[:3], before.q[:3])
    active = run.chain.active
    assert run.tau[:, active].tolist() == [[1.0, 0.0]] * 2 + [[-3.0, 1.0]] * 4 + [[2.0, 0.5]] * 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"initial.q": [0.0]}, "one-per-joint"),
        ({"initial.q": [float("nan")] * 6}, "not-finite"),
        ({"initial.q": [0.0] * 6, "initial.passive": "static"}, "both-given"),
        ({"initial.qd": [0.0] * 6, "initial.rate_deg": [1.0, 0.0]}, "both-given"),
        ({"initial.time": 0.00005}, "not-a-multiple"),
        ({"initial.time": -1.0}, "wrong-value"),
        ({"drive": {**TABLE, "hold": True, "smooth": True}}, "needs-another-key"),
        ({"drive": {**TABLE, "hold": True, "times": [0.0, 0.02, 0.06005]}}, "not-a-multiple"),
    ],
)  # fmt: skip
def test_an_initial_state_that_does_not_fit_is_refused(changes: dict[str, object], message: str) -> None:
    with refused(fl.errors.SceneError, message):
        fl.simulate(arm("none").varied(changes))


def test_the_state_of_a_missing_sample_is_an_error() -> None:
    with refused(fl.errors.ArgumentError, "out-of-range"):
        fl.simulate(arm("none")).state(9)


def test_a_full_initial_state_needs_no_joint_angles(tmp_path: Path) -> None:
    joint = fl.Joint(limits_deg=(10.0, 90.0))
    q = tuple(np.linspace(0.2, 0.3, 9))
    links = flexible("a", joint=joint), flexible("b", joint=fl.Joint(locked=True))
    whole = make_scene(*links, initial=fl.InitialState(q=q))
    assert whole.initial.joint_deg == (0.0, 0.0), "angle of the locked joint; the limits of the other joint are ignored"
    assert fl.initial_state(whole, fl.lump(whole))[0].tolist() == list(q)
    path = tmp_path / "whole.toml"
    path.write_text(whole.to_toml(), encoding="utf-8")
    assert fl.load_scene(path) == whole
    moving = make_scene(flexible("a"), initial=fl.InitialState(rate_deg=(1.0,)))
    assert moving.initial.joint_deg == (0.0,), "rates do not need angles either"
