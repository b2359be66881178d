"""A problem that is prepared once: its runs are bit-equal to those of `simulate`, regardless of earlier runs."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.data_files import names
from flexlink.describe.schemes.methods import method as load_method
from flexlink.motion.inputs.problem import started_from
from tests.conftest import flexible, make_scene
from tests.matrix.runs import same
from tests.support.words import refused

FIXED = {"run.step": 1e-4}


def alone(scene: fl.Scene, **arguments: Any) -> fl.Trajectory:
    """A run that uses no cached preparation."""
    return fl.simulate(scene.varied({"name": scene.name}), **arguments)


@pytest.mark.parametrize("steps", [FIXED, {"run.tolerance": 1e-4}], ids=["fixed", "tolerance"])
def test_a_python_control_law_drives_a_problem_like_a_run(steps: dict[str, float]) -> None:
    scene = arm("none").varied(steps)
    problem = fl.Problem(scene)
    for options in ({}, {"control": law, "rate": 500.0}, {}, {"control": law, "rate": 250.0}):
        same(problem.simulate(**options), alone(scene, **options))


def test_a_failed_run_does_not_affect_later_runs() -> None:
    scene = arm("pd").varied({"run.tolerance": 1e-5, "run.method": "Radau5"})
    wild = fl.Problem(scene.varied({"run.max_evaluations": 3000.0}))
    first = alone(wild.scene)
    with pytest.raises(fl.errors.DivergenceError):
        wild.simulate(qd0=np.full(wild.chain.n, 200.0))
    same(wild.simulate(), first)


def test_a_problem_refuses_invalid_input_with_the_messages_of_simulate() -> None:
    scene = arm("none").varied(FIXED)
    problem, n = fl.Problem(scene), fl.lump(scene).n
    for wrong in ({"q0": np.zeros(n + 1)}, {"q0": np.full(n, np.nan)}, {"qd0": ["a"] * n}, {"t0": -1.0}, {"t0": 1.5e-4},
                  {"duration": 0.0123}, {"rate": 100.0}, {"progress": 3}, {"control": 3}):  # fmt: skip
        with pytest.raises(fl.FlexlinkError) as of_simulate:
            fl.simulate(scene, **wrong)
        with pytest.raises(type(of_simulate.value)) as of_problem:
            problem.simulate(**wrong)
        assert str(of_problem.value) == str(of_simulate.value)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        fl.Problem(3)


def test_a_problem_refuses_a_reference_that_starts_elsewhere() -> None:
    reference = fl.Reference(profile="quintic", to_deg=(-60.0, 0.0), duration=0.05)
    scene = arm("none").varied({"drive": fl.Drive(kind="pd", kp=(40.0, 20.0), kd=(1.0, 0.5), reference=reference)})
    problem = fl.Problem(scene)
    with refused(fl.errors.SceneError, "missing-key"):
        problem.simulate(q0=np.zeros(problem.chain.n))


def test_stability_of_the_step_is_checked_at_every_start() -> None:
    """A string of point masses is stiffer, and its largest stable step shorter, the faster it turns."""
    scene = make_scene(flexible("a", segments=3), run=fl.RunSettings(step=1e-4, duration=0.01))
    step = 0.98 * fl.stable_step(fl.lump(scene))
    problem = fl.Problem(scene.varied({"run.step": step, "run.sample": step, "run.duration": 2 * step}))
    problem.simulate()
    with pytest.raises(fl.errors.UnstableStepError):
        problem.simulate(qd0=np.array([3e4, 0.0, 0.0]))
    problem.simulate()


def test_threads_may_share_a_problem() -> None:
    scene = arm("computed, sampled").varied({"run.tolerance": 1e-4})
    problem, rates = fl.Problem(scene), [np.full(fl.lump(scene).n, 0.1 * k) for k in range(6)]
    with ThreadPoolExecutor(3) as pool:
        runs = list(pool.map(lambda qd: problem.simulate(qd0=qd), rates))
    for qd, run in zip(rates, runs, strict=True):
        same(run, alone(scene, qd0=qd))


def test_copies_and_pickles_of_a_problem_give_equal_runs() -> None:
    problem = fl.Problem(arm("pd").varied({"run.tolerance": 1e-4}))
    first = problem.simulate()
    for other in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        same(other.simulate(), first)


def test_an_initial_state_from_arrays_equals_one_from_lists() -> None:
    scene = arm("none", **{"initial.passive": "static"})
    q, qd, t = np.linspace(0.1, 0.3, 6), np.linspace(-1.0, 1.0, 6), 0.01
    for start in ((q, None, None), (None, qd, None), (q, qd, t), (None, None, t)):
        lists = tuple(part if part is None or isinstance(part, float) else part.tolist() for part in start)
        assert started_from(scene, *start) == started_from(scene, *lists)
        assert started_from(scene, *start) != scene


def test_a_state_from_finite_arrays_is_not_validated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, validated, rows = arm("none"), arm("pd"), np.zeros(6)
    monkeypatch.setattr(fl.Scene, "varied", lambda *_: validated)
    for q, qd, t in ((rows, None, None), (None, rows, None), (rows, rows, 0.01)):
        assert started_from(scene, q, qd, t) is not validated
    for q, qd, t in ((rows + np.inf, None, None), (None, rows + np.nan, None), (rows, rows, -0.01), (rows, rows, 1)):
        assert started_from(scene, q, qd, t) is validated


def test_a_scene_is_prepared_once_unless_it_names_a_file(tmp_path, monkeypatch) -> None:
    """Cached data of a scene must not be used after the file of its method has changed."""
    file, scene = tmp_path / "mine.toml", arm("none")
    tableau = 'about = "Euler"\nsource = "-"\norder = 1\nc = ["0"]\nb = ["1"]\nA = [[]]\n'
    midpoint = 'about = "m"\nsource = "-"\norder = 2\nc = ["0", "1/2"]\nb = ["0", "1"]\nA = [[], ["1/2"]]\n'
    options = {"method": str(file), "step": 1e-5, "sample": 1e-3, "duration": 2e-3, "unstable": "allow"}
    file.write_text(tableau)
    one = fl.simulate(scene, **options)
    file.write_text(midpoint)
    assert np.abs(fl.simulate(scene, **options).q - one.q).max() > 0.0
    same(fl.simulate(scene, tolerance=1e-4), fl.simulate(scene, tolerance=1e-4))
    assert fl.simulate(scene, tolerance=1e-4).chain is fl.simulate(scene, tolerance=1e-4).chain


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
