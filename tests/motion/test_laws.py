"""Compiled control laws of a scene: torques, sampling, effort limits, and all engines."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.linalg import expm

import flexlink as fl
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.schemes.methods import method
from flexlink.engines import base, load
from flexlink.formats.features import unsupported
from flexlink.kernels.inputs.drive_torque import drive_torque
from flexlink.kernels.inputs.record import PiecewisePolynomial
from flexlink.kernels.inputs.references import reference
from flexlink.kernels.stepping.runge_kutta import integrate
from flexlink.motion.inputs import drives
from flexlink.motion.inputs.drives import drive_arrays, gains_of
from flexlink.motion.inputs.feedforward import holding_torque
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.references import constant, reference_arrays
from flexlink.motion.monitor import step_errors
from flexlink.results.record import Record
from flexlink_witnesses import refuse_sampled_inputs
from tests.conftest import compiled, flexible, make_scene
from tests.motion.test_ties import fourbar
from tests.support.words import refused, reviewed

UP = fl.Mount(rpy_deg=(90.0, 0.0, 0.0))
TARGET_DEG = (40.0, 35.0, -50.0)
PD = {"kind": "pd", "kp": (900.0, 900.0, 400.0), "kd": (60.0, 60.0, 25.0), "target_deg": TARGET_DEG}
LAWS: dict[str, dict[str, Any]] = {
    "pd": PD,
    "pd, rigid gravity": {**PD, "gravity": "rigid"},
    "pd, static gravity": {**PD, "gravity": "static"},
    "computed torque": {**PD, "kind": "computed_torque", "kp": (60.0, 60.0, 60.0), "kd": (12.0, 12.0, 12.0)},
}
EFFORT = (25.0, 120.0, 40.0)
SAMPLED = {"continuous": {}, "sampled": {"rate": 1000.0}}
every_law = pytest.mark.parametrize("name", LAWS)
every_rate = pytest.mark.parametrize("rate", SAMPLED)


def arm(drive: dict[str, Any] | None = None, **changes: object) -> fl.Scene:
    """A rotating base and two links: one bends in two planes, the other has an elastic gear and bends in one."""
    gear = fl.Joint(armature=0.5, viscous=0.5, gear_stiffness=2e4, gear_damping=5.0)
    scene = make_scene(
        fl.Link(name="base", length=0.2, material="aluminium", section="square", joint=fl.Joint(armature=0.5)),
        flexible("upper", "yz", 3, mount=UP, joint=fl.Joint(armature=0.5, coulomb=1.0, coulomb_width=0.1)),
        flexible("fore", "z", 3, joint=gear),
        tip=fl.RigidBody(mass=1.0, center=(0.1, 0.0, 0.05)),
        initial=fl.InitialState(joint_deg=(10.0, 60.0, -20.0), passive="static"),
    )
    run = {"run.step": 1e-4, "run.sample": 0.01, "run.duration": 0.1, "material.aluminium.loss_time": 1e-4}
    return scene.varied({**run, "drive": drive or {"kind": "none"}, **changes})


def torques(drive: Any, t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    tau = np.zeros(len(q))
    drive_torque(drive, t, t, q, qd, tau)
    return tau[drive.joints]


@pytest.mark.parametrize("t", [-0.1, 0.0, 0.15, 0.3, 0.7, 5.0])
def test_a_reference_gives_its_polynomial_and_two_derivatives(t: float, rng: np.random.Generator) -> None:
    """At the knot, 0.3 s, the midpoint of the step selects the piece; sums of six products differ by a few ulp."""
    ref = PiecewisePolynomial(np.array([0.0, 0.3]), rng.uniform(-1, 1, (2, 6, 3)))
    for d in range(3):
        for middle in (t - 0.01, t + 0.01):
            piece = int(middle >= 0.3)
            p, x = Polynomial(ref.coefficients[piece, :, d]), max(0.0, t - ref.knots[piece])
            wanted = p(x), p.deriv()(x), p.deriv(2)(x)
            np.testing.assert_allclose(reference(ref, t, middle, d), wanted, rtol=0, atol=1e-12 * (1 + x**5))


def test_a_constant_reference_has_zero_derivatives() -> None:
    ref = constant(np.array([1.0, -2.0]))
    assert [reference(ref, t, t, d) for t in (0.0, 9.0) for d in (0, 1)] == [(1.0, 0.0, 0.0), (-2.0, 0.0, 0.0)] * 2


def inverse_dynamics(by: str, scene: fl.Scene) -> Callable[..., np.ndarray]:
    """τ(q, q̇, q̈) of a scene's chain, by flexlink or by Pinocchio from the exported file."""
    if by == "flexlink":
        return lambda *motion: fl.inverse_dynamics(fl.lump(scene), *motion)
    pin = pytest.importorskip("pinocchio")
    engine = load("pinocchio", fl.lump(scene))
    return lambda *motion: np.array(pin.rnea(engine.model, engine.data, *motion))


@pytest.mark.parametrize("by", ["flexlink", "pinocchio"])
@every_law
def test_a_compiled_law_agrees_with_its_formula(name: str, by: str, monkeypatch, rng) -> None:
    """Torques agree to 1e-12 of the largest term, that is, to a few thousand roundings."""
    law, scene = LAWS[name], arm(LAWS[name])
    order = 1 if law.get("gravity") == "static" else 4
    ref = PiecewisePolynomial(np.zeros(1), rng.uniform(-1, 1, (1, order, 3)))
    monkeypatch.setattr(drives, "reference_arrays", lambda scene, chain: ref)
    chain, model, whole = fl.lump(scene), *(inverse_dynamics(by, s) for s in (scene.rigidified(), scene))
    drive, a, kp, kd = drive_arrays(scene, chain), chain.active, np.array(law["kp"]), np.array(law["kd"])
    for _ in range(20):
        t, (q, qd) = rng.uniform(0, 1), rng.uniform(-2, 2, (2, chain.n))
        r, rd, rdd = moved(ref, t)
        held = np.zeros(chain.n)
        held[a] = r
        tau = kp * (r - q[a]) + kd * (rd - qd[a])
        size = np.abs(tau).max()
        if law["kind"] == "computed_torque":
            tau = model(q[a], qd[a], rdd + tau)
        elif law.get("gravity") == "rigid":
            tau += model(r, 0 * r, 0 * r)
        elif law.get("gravity") == "static":
            tau += whole(fl.solve_static(chain, held, locked=a).q, 0 * q, 0 * q)[a]
        size += np.abs(tau).max()
        np.testing.assert_allclose(torques(drive, t, q, qd), tau, rtol=0, atol=1e-12 * size)


def moved(ref: PiecewisePolynomial, t: float) -> list[np.ndarray]:
    """Angles, rates and accelerations of a reference with one polynomial piece."""
    columns = [Polynomial(column) for column in ref.coefficients[0].T]
    return [np.array([p.deriv(order)(t) for p in columns]) for order in range(3)]


@every_rate
@every_law
def test_no_stage_torque_exceeds_the_effort_limit(name: str, rate: str) -> None:
    """Repeating every step, stage by stage with the limited torques, gives the next state of the run."""
    scene = arm({**LAWS[name], "effort": EFFORT, **SAMPLED[rate]}, **{"run.sample": 1e-4, "run.duration": 0.02})
    run, chain = fl.simulate(scene), fl.lump(scene)
    A, b, c = method("RK4").arrays
    drive, h, seen, n = base.drive_function(problem_of(scene)), scene.run.step, [], chain.n
    for number in range(len(run.t) - 1):
        y, F = np.concatenate([run.q[number], run.qd[number]]), np.zeros((4, 2 * chain.n))
        drive.begin(number, h, y[:n], y[n:])
        for i in range(4):
            x = y + h * A[i, :i] @ F[:i]
            tau = drive((number + c[i]) * h, x[:n], x[n:]).copy()
            seen.append(tau[chain.active])
            F[i] = *x[n:], *fl.forward_dynamics(chain, x[:n], x[n:], tau)
        np.testing.assert_allclose(y[:n] + h * b @ F[:, :n], run.q[number + 1], rtol=0, atol=1e-13)
    most = np.abs(seen).max(axis=0)
    assert (most <= EFFORT).all()
    assert (most == EFFORT).all()  # every drive reaches its limit
    assert (np.abs(run.tau[:, chain.active]) <= EFFORT).all()


@compiled
def test_stepping_loops_are_compiled_once_for_all_drives() -> None:
    fl.simulate(arm())
    loops = len(integrate.signatures)
    table = {"kind": "table", "times": (0.0, 0.1), "torques": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}
    for law in [table, *LAWS.values()]:
        for rate in SAMPLED.values():
            fl.simulate(arm({**law, **(rate if law in LAWS.values() else {})}))
    fl.simulate(arm(), control=lambda t, q, qd: np.zeros(3), rate=100.0)
    assert len(integrate.signatures) == loops


def test_a_trial_step_for_the_error_does_not_evaluate_a_sampled_law() -> None:
    """The trial step ends at a time that the run itself has not reached."""
    problem = problem_of(arm({**PD, "rate": 1e4}))
    record = Record(problem, np.zeros(1), problem.q[None], problem.qd[None])
    before = [array.copy() for array in drives.remembered(record.inputs.drive)]
    step_errors(record, np.array([0]))
    for array, kept in zip(drives.remembered(record.inputs.drive), before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_effort_limits_apply_to_laws_and_external_torques() -> None:
    scene = arm({"kind": "none", "effort": EFFORT})
    limited = [sign * e for sign, e in zip((1, -1, 1), EFFORT, strict=True)]
    run = fl.simulate(scene, control=lambda t, q, qd: [1e4, -1e4, 1e4], rate=100.0)
    np.testing.assert_array_equal(run.tau[:, run.chain.active], np.tile(limited, (11, 1)))
    assert fl.Simulator(scene).step([1e4, -1e4, 1e4]).q.tolist() == fl.Simulator(scene).step(limited).q.tolist()


def test_a_drive_that_is_nearly_always_at_its_limit_gets_a_warning() -> None:
    id = "drive-at-limit"
    weak, strong = (fl.simulate(arm({**PD, "effort": 3 * (effort,)})).warnings for effort in (1e-3, 1e6))
    (text,) = (each for each in weak if each.id == id)
    reviewed(id, text)
    assert all(each.id != id for each in strong)


@every_law
def test_the_gains_of_a_law_are_its_derivatives(name: str, rng: np.random.Generator) -> None:
    """The gains agree with central differences of the torques in random directions, accurate to about 1e-10."""
    chain = fl.lump(scene := arm(LAWS[name]))
    drive = drive_arrays(scene, chain)
    q, qd, δ, δd = rng.uniform(-1, 1, (4, chain.n))
    kp, kd = gains_of(chain, drive, 0.0, q, qd).matrices()
    ahead, behind = (torques(drive, 0.0, q + s * 1e-5 * δ, qd + s * 1e-5 * δd) for s in (1, -1))
    wanted = (ahead - behind) / 2e-5
    np.testing.assert_allclose(-(kp @ δ + kd @ δd)[chain.active], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_the_gains_of_a_law_ignore_its_torque_limit() -> None:
    chain = fl.lump(scene := arm(PD))
    at_limit = fl.lump(limited := arm({**PD, "effort": (1e-3, 1e-3, 1e-3)}))
    zero = np.zeros(chain.n)
    free, held = (gains_of(c, drive_arrays(s, c), 0.0, zero, zero) for c, s in ((chain, scene), (at_limit, limited)))
    np.testing.assert_array_equal(held, free)
    assert np.linalg.norm(free.kp) > 0


def test_the_rigid_model_of_an_arm_keeps_mass_gravity_torque_and_driven_joints() -> None:
    scene = arm(**{"initial.q": tuple(np.linspace(-0.1, 0.1, 10)), "initial.passive": None})
    twin = scene.rigidified()
    chain, model = fl.lump(scene), fl.lump(twin)
    assert (model.n, len(chain.active)) == (3, 3)
    assert model.bodies["mass"].sum() == pytest.approx(chain.bodies["mass"].sum(), rel=1e-14)
    q = np.zeros(chain.n)
    q[chain.active] = angles = np.array([0.3, -1.0, 2.0])
    np.testing.assert_allclose(fl.tip_position(model, angles), fl.tip_position(chain, q), rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        fl.gravity_torque(model, angles), fl.gravity_torque(chain, q)[chain.active], rtol=0, atol=1e-12
    )
    for name in ("armature", "coulomb", "damping"):
        np.testing.assert_array_equal(model.hinges[name], chain.hinges[name][chain.active])


def test_a_drive_of_an_arm_without_driven_joints_is_empty() -> None:
    scene = make_scene(
        flexible("a", joint=fl.Joint(locked=True)), drive={**PD, "kp": (0,), "kd": (0,), "target_deg": (0,)}
    )
    assert len(drive_arrays(scene, fl.lump(scene)).joints) == 0


def test_exports_note_that_no_format_stores_a_control_law() -> None:
    scene = arm({**PD, "effort": EFFORT})
    for format in ("urdf", "mjcf", "sdf"):
        listed = unsupported(scene, fl.lump(scene), format=format)
        assert {"drive torques", "control law", "torque limits"} <= listed.keys()
    assert "control law" not in unsupported(arm(), fl.lump(arm()), format="urdf")


AT_ONCE = {"link": "base", "times": [0.0], "angle_deg": [10.0], "rate_deg": [0.0], "acceleration_deg": [0.0]}
INVALID: dict[str, list[dict[str, Any]]] = {
    "not-finite": [{"drive.kp": (np.nan, 0, 0)}, {"drive.effort": (1.0, np.inf, 1.0)}],
    "wrong-value": [{"drive.kp": (-1.0, 0, 0)}, {"drive.kd": (0.0, 0, -2.0)}, {"drive.effort": (1.0, 0.0, 1.0)},
                    {"drive.gravity": "some"}, {"drive.kind": "computed"}, {"drive.rate": 0.0}],
    "one-per-link": [{"drive.effort": (1.0, 1.0)}, {"drive.kp": (1.0, 1.0)}],
    "needs-pd": [{"drive.gravity": "rigid", "drive.kind": "computed_torque"}],
    "not-a-multiple": [{"drive.rate": 3000.0}, {"drive.rate": 1000.0 / 7},
                       {"drive.rate": 100.0, "initial.time": 0.005}],
    "key-of-another-kind": [{"drive.torque": (1.0, 1.0, 1.0)}, {"drive": {"kind": "none", "rate": 100.0}}],
    "locked-and-moving": [{"link.fore.joint.locked": True}],
    "joint-prescribed": [{"motion": [AT_ONCE]}],
}  # fmt: skip


@pytest.mark.parametrize(("id", "changes"), [(id, each) for id, several in INVALID.items() for each in several])
def test_invalid_control_laws_are_refused(id: str, changes: dict[str, Any]) -> None:
    with refused(fl.errors.SceneError, id):
        arm(PD).varied(changes)


@pytest.mark.parametrize("engine", ["drake", "exudyn"])
def test_engines_without_access_to_their_steps_refuse_a_sampled_law_by_name(engine: str) -> None:
    with refused(fl.errors.ArgumentError, "engine-does-not-support"):
        refuse_sampled_inputs(engine, arm({**PD, "rate": 1000.0}))


def test_a_failed_simulator_step_restores_the_torques_of_the_sampled_law() -> None:
    """The failing call evaluates the law many times; the next call continues as if it had never happened."""
    scene = arm({**PD, "rate": 500.0}, **{"run.unstable": "allow"})
    simulator, other = fl.Simulator(scene), fl.Simulator(scene)
    for each in (simulator, other):
        each.step(duration=0.003)
    drive = simulator._driven.drive
    before = [array.copy() for array in drives.remembered(drive)]
    with pytest.raises(fl.errors.DivergenceError):
        simulator.step([np.finfo(float).max] * 3, duration=0.02)
    simulator._steps.go(simulator._driven, simulator.time, simulator.time)
    for array, kept in zip(drives.remembered(drive), before, strict=True):
        np.testing.assert_array_equal(array, kept)
    np.testing.assert_array_equal(simulator.step(duration=0.01).q, other.step(duration=0.01).q)


def test_arms_that_share_a_torque_table_drive_their_own_joints() -> None:
    """One arm has a free base joint and one a locked base joint, so the joint numbers differ."""
    drive = fl.Drive(kind="constant", torque=(0.0, 2.0, 3.0))
    free = arm().varied({"drive": drive})
    locked = free.varied({"link.base.joint": {"locked": True}})
    assert free.drive is locked.drive
    for scene, torques in ((free, (0.0, 2.0, 3.0)), (locked, (2.0, 3.0))):
        chain = fl.lump(scene)
        found = drive_arrays(scene, chain)
        np.testing.assert_array_equal(found.joints, chain.active)
        np.testing.assert_array_equal(found.feedforward.coefficients[0, 0], torques)


INERTIA, KP, KD = 4.0, 40.0, 6.0
ZVD = fl.InputShaper(kind="ZVD", frequency_hz=(2.0,), damping=(0.05,))
REFERENCES = {
    "quintic": fl.Reference(profile="quintic", to_deg=(50.0,), start=0.1, duration=0.6),
    "trapezoidal": fl.Reference(profile="trapezoidal", to_deg=(50.0,), duration=0.6),
    "s_curve": fl.Reference(profile="s_curve", to_deg=(50.0,), duration=0.9),
    "linear": fl.Reference(profile="linear", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "smooth": fl.Reference(profile="smooth", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "hold": fl.Reference(profile="hold", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "shaped": fl.Reference(profile="quintic", to_deg=(50.0,), duration=0.3, shaper=ZVD),
}


def wheel(reference: fl.Reference, **run: object) -> fl.Scene:
    """A wheel that follows a reference: I q̈ = kp (r − q) + kd (ṙ − q̇)."""
    drive = fl.Drive(kind="pd", kp=(KP,), kd=(KD,), reference=reference)
    tip = fl.RigidBody(mass=1.0, inertia=(2.0, 2.0, INERTIA - 1.0))
    return make_scene(fl.Link(name="a", length=1.0), tip=tip, gravity=(0, 0, 0), drive=drive, run=fl.RunSettings(**run))


def exact(course: ReferenceTrajectory, times: np.ndarray) -> np.ndarray:
    """Angles at these times by matrix exponentials of (q, q̇, x⁰, x¹, …), piece by piece."""
    order = course.coefficients.shape[1]
    ends, states, y = np.union1d(course.knots, times), {}, np.zeros(2)
    ends = ends[ends >= 0.0]
    c = course.restated(ends)[:, :, 0]
    for t, later, piece in zip(ends, [*ends[1:], ends[-1]], c, strict=True):
        states[t] = y[0]
        A = np.zeros((2 + order, 2 + order))
        A[0, 1], A[1, :2] = 1.0, (-KP / INERTIA, -KD / INERTIA)
        A[range(3, 2 + order), range(2, 1 + order)] = np.arange(1, order)
        A[1, 2:] = (KP * piece + KD * np.append(piece[1:] * np.arange(1, order), 0.0)) / INERTIA
        y = (expm(A * (later - t)) @ np.concatenate([y, np.eye(order)[0]]))[:2]
    return np.array([states[t] for t in times])


@pytest.mark.slow
@pytest.mark.parametrize("profile", REFERENCES)
def test_a_pd_driven_wheel_follows_the_exact_solution(profile: str) -> None:
    """Knots at ends of steps cost no accuracy: the error is due to RK4, about (ωh)⁴/120 = 1e-12 per step.

    If a knot is inside a step, the polynomial at the midpoint is used, which is wrong for h/2 at most: a jump j of the
    jerk causes an impulse of kd j h³/48, which turns the wheel by at most this impulse over I ω. The jumps of a shaped
    move add up to the jumps of the unshaped move at its start and its end.
    """
    scene = wheel(REFERENCES[profile], method="RK4", step=1e-3, sample=0.05, duration=1.5)
    run = fl.simulate(scene)
    off = np.abs(run.q[:, 0] - exact(scene.course, run.t)).max()
    jumps = 2 * 60.0 * np.radians(50.0) / 0.3**3 if profile == "shaped" else 0.0
    assert off < 1e-10 + KD * jumps * 1e-3**3 / 48 / np.sqrt(KP * INERTIA)
    assert not run.warnings


def following(reference: fl.Reference, **drive: object) -> fl.Scene:
    """Two joints with PD drives and a flexible link between them, under gravity."""
    law = {"kind": "pd", "kp": (3e3, 1e3), "kd": (60.0, 20.0), "reference": reference, **drive}
    return make_scene(
        flexible("upper", "z", 3), fl.Link(name="fore", length=0.5, material="aluminium", section="square"),
        tip=fl.RigidBody(mass=1.0), drive=fl.Drive(**law), initial=fl.InitialState(joint_deg=(30.0, -20.0)),
        gravity=(0.0, -9.81, 0.0), run=fl.RunSettings(step=1e-4, sample=0.01, duration=0.2),
    )  # fmt: skip


@pytest.mark.slow
def test_gravity_compensation_of_the_bent_arm_follows_the_reference() -> None:
    """Interpolation between equilibria is accurate to 1e-6 of the largest torque, as documented."""
    reference = fl.Reference(profile="quintic", to_deg=(-120.0, 90.0), duration=1.0, shaper=ZVD)
    scene = following(reference, gravity="static")
    chain = fl.lump(scene)
    own = chain.active
    held = holding_torque(chain, reference_arrays(scene, chain))
    times = np.linspace(-0.1, scene.course.knots[-1] + 0.1, 60)
    pieces = np.maximum(np.searchsorted(held.knots, times, side="right") - 1, 0)
    x = np.maximum(times - held.knots[pieces], 0.0)
    found = (held.coefficients[pieces] * x[:, None, None] ** np.arange(6)[:, None]).sum(axis=1)
    for torque, angles in zip(found, scene.course(times)[0], strict=True):
        q = np.zeros(chain.n)
        q[own] = angles
        wanted = fl.gravity_torque(chain, fl.solve_static(chain, q, locked=own.tolist()).q)[own]
        assert np.abs(torque - wanted).max() < 1e-6 * np.abs(found).max()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_a_continuous_rigid_model_of_an_arm_that_bends_keeps_its_tolerance(tolerance: float) -> None:
    """Many iterations fail, as Newton's matrix has no coupled slopes of the law; errors reached 6 tolerances unseen."""
    reference = {"profile": "quintic", "to_deg": [80.0, -33.0, -116.0], "duration": 0.3}
    law = {"kind": "computed_torque", "kp": [100.0] * 3, "kd": [20.0] * 3, "reference": reference}
    bends = {"flex": "z", "segments": 3}
    scene = fourbar(**bends).varied({"tie": [], "drive": law, "run": {"duration": 0.4, "sample": 0.05}})
    truth = fl.simulate(scene.varied({"run.method": "DOP853", "run.tolerance": 1e-8}))
    run = fl.simulate(scene.varied({"run.tolerance": tolerance}))
    assert run.kept
    assert np.linalg.norm(run.tip - truth.tip, axis=1).max() < tolerance * run.chain.size
