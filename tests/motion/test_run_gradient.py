"""Gradients of runs agree with the tangents of an own Runge-Kutta loop over Pinocchio's derivatives of `aba`."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import fields
from numpy.typing import NDArray

import flexlink as fl
from flexlink.describe.schemes.methods import method
from flexlink.errors import ArgumentError, SceneError
from flexlink.kernels.forces.elements import KINDS
from flexlink.kernels.layout import BODY, HINGE
from flexlink.motion.run_gradient import SUPPORTED
from tests.conftest import flexible, make_scene
from tests.matrix.case import difference
from tests.support.words import refused
from validation.random_arms import random_arm, random_tree

Array = NDArray[np.float64]
TURN = fl.PrescribedMotion(link="upper", times=(0.0,), angle_deg=(-60.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
BENT = fl.InitialState(joint_deg=(-60.0, 25.0))
IMPLICIT = ["Gauss4", "Gauss6", "Radau5", "Radau9"]
LONG = {"run.step": 2e-3, "run.sample": 4e-3, "run.duration": 0.08}


def arm(**changes: Any) -> fl.Scene:
    """Two links that bend, with rotors and friction: 40 steps, two to a sample."""
    joint = fl.Joint(viscous=0.1, coulomb=0.3, coulomb_width=0.5, armature=0.01)
    links = flexible("upper", "z", 3, joint=joint), flexible("fore", "z", 3, joint=fl.Joint(armature=0.02))
    steps = fl.RunSettings(step=2.5e-5, sample=5e-5, duration=1e-3)
    return make_scene(*links, tip=fl.RigidBody(mass=0.5), gravity=(0.0, 9.81, 0.0), initial=BENT, run=steps).varied(
        changes
    )


def held(scene: fl.Scene, tau: Array, **changes: Any) -> fl.Scene:
    """The scene with torques (m, d) of its driven joints, each held for one sample."""
    chain, torques = fl.lump(scene), np.zeros((len(tau), len(scene.arm.links)))
    torques[:, [chain.coordinates[k].link - 1 for k in chain.active]] = tau
    times = scene.run.spacing * np.arange(len(tau))
    drive = fl.Drive(kind="table", times=tuple(times.tolist()), torques=tuple(map(tuple, torques)), hold=True)
    return scene.varied({"drive": drive if tau.size else None, **changes})


def pinocchio_slopes(chain: fl.Chain) -> Callable[[Array, Array, Array], tuple[Array, Array, Array, Array]]:
    """q̈, ∂q̈/∂q, ∂q̈/∂q̇ and M⁻¹ by Pinocchio, with the springs and the friction of single joints."""
    pin = pytest.importorskip("pinocchio")
    from flexlink.engines.pinocchio import PinocchioEngine  # noqa: PLC0415

    engine = PinocchioEngine(chain)
    at = np.ix_(engine.coordinates.order, engine.coordinates.order)

    def slopes(q: Array, qd: Array, tau: Array) -> tuple[Array, Array, Array, Array]:
        net, place = tau - engine.elastic_torque(q) - engine.friction_torque(qd), engine.coordinates.position(q)
        state = place, engine.coordinates.rates(q, qd), engine.coordinates.torques(q, net)
        dq, dqd, inverse = pin.computeABADerivatives(engine.model, engine.data, *state)
        inverse = np.triu(inverse) + np.triu(inverse, 1).T
        dry = engine.coulomb / engine.coulomb_width / np.cosh(qd / engine.coulomb_width) ** 2
        dq, dqd, inverse = dq[at], dqd[at], inverse[at]
        qdd = engine.coordinates.our_accelerations(q, qd, np.array(engine.data.ddq))
        return qdd, dq - inverse * engine.stiffness, dqd - inverse * (engine.damping + dry), inverse

    return slopes


def stages(slopes: Callable[..., tuple[Array, ...]], tableau: tuple[Array, ...], h: float, *acting: Array) -> Any:
    """V and K of a step (s, n), and what the slopes of all stages give, by Newton's iteration on dense matrices."""
    (A, _, c), (q, qd, tau) = tableau, acting
    s, n = len(c), len(q)
    K, δ = np.zeros((s, n)), np.ones(s * n)
    for _ in range(30):
        V = qd + h * A @ K
        Q = q + h * A @ V
        f, by_angle, by_rate, inverse = map(np.array, zip(*map(slopes, Q, V, [tau] * s), strict=True))
        part = np.einsum("ij,ikl->ikjl", h * h * A @ A, by_angle) + np.einsum("ij,ikl->ikjl", h * A, by_rate)
        left = np.eye(s * n) - part.reshape(s * n, s * n)
        if np.abs(δ).max() < 1e-10 * np.abs(K).max():
            break
        δ = np.linalg.solve(left, (f - K).ravel())
        K += δ.reshape(s, n)
    return V, K, by_angle, by_rate, inverse, left


def tangents(scene: fl.Scene, tau: Array, pull: Array) -> tuple[Array, Array, Array]:
    """∂J/∂tau, ∂J/∂q and ∂J/∂q̇ of J = Σ pull · (q, q̇), by tangents of all parameters, forward in time."""
    chain, run, (A, b, c) = fl.lump(scene), scene.run, method(scene.run.method).arrays
    slopes, (q, qd), n, h = pinocchio_slopes(chain), fl.initial_state(scene, chain), chain.n, scene.run.fixed_step
    S = np.zeros((2, n, 2 * n + tau.size))
    S[0, :, :n] = S[1, :, n : 2 * n] = np.eye(n)
    gradient = np.einsum("ij,ijk", pull[:, 0], S)
    for row, torque in enumerate(tau):
        acting, by_torque = np.zeros(n), np.zeros((n, S.shape[2]))
        acting[chain.active] = torque
        by_torque[chain.active, 2 * n + row * len(torque) + np.arange(len(torque))] = 1.0
        for _ in range(run.steps_per_sample):
            V, K, by_angle, by_rate, inverse, left = stages(slopes, (A, b, c), h, q, qd, acting)
            right = by_angle @ (S[0] + h * c[:, None, None] * S[1]) + by_rate @ S[1] + inverse @ by_torque
            dK = np.linalg.solve(left, right.reshape(len(c) * n, -1)).reshape(right.shape)
            dV = S[1] + h * np.tensordot(A, dK, 1)
            q, qd, S = q + h * b @ V, qd + h * b @ K, S + h * np.array([np.tensordot(b, x, 1) for x in (dV, dK)])
        gradient += np.einsum("ij,ijk", pull[:, row + 1], S)
    return gradient[2 * n :].reshape(tau.shape), gradient[:n], gradient[n : 2 * n]


def check(scene: fl.Scene, seed: int = 0, tolerance: float = 1e-7) -> None:
    """Check the gradient of a random linear function of the samples."""
    dice, chain = np.random.default_rng(seed), fl.lump(scene)
    m = scene.run.samples - 1
    tau, pull = dice.normal(size=(m, len(chain.active))), dice.normal(size=(2, m + 1, chain.n))
    driven = held(scene, tau)
    found = fl.run_gradient(fl.simulate(driven), *pull)
    for slope, wanted in zip((found.dtau, found.dq, found.dqd), tangents(driven, tau, pull), strict=True):
        np.testing.assert_allclose(slope, wanted, rtol=0, atol=tolerance * np.abs(wanted).max(initial=0.0))


@pytest.mark.parametrize("name", ["RK2", "RK3", "RK4", "DOPRI5", "DOP853", "RK10"])
def test_gradients_of_all_explicit_methods_agree_with_tangents(name: str) -> None:
    check(arm(**{"run.method": name}))


@pytest.mark.parametrize("name", IMPLICIT)
def test_gradients_of_all_implicit_methods_agree_with_tangents(name: str) -> None:
    check(arm(**{"run.method": name, **LONG}))


@pytest.mark.slow
def test_a_stiff_arm_has_a_gradient_at_steps_that_explicit_methods_cannot_take() -> None:
    stiff = arm(**{"run.method": "Radau5", **LONG, "material.aluminium.young": 7e13})
    assert fl.stable_step(fl.lump(stiff), method="RK4") < LONG["run.step"] / 20
    check(stiff)


def push_and_differences(scene: fl.Scene, h: float) -> tuple[float, float]:
    """Derivative of Σ q at the end along all initial angles, by the gradient and by differences of step h."""
    run, last = fl.simulate(scene), np.zeros((scene.run.samples, 6))
    last[-1] = 1.0

    def end(x: float) -> float:
        return float(fl.simulate(scene, q0=run.q[0] + x).q[-1].sum())

    return fl.run_gradient(run, last).dq.sum(), difference(end, h)


def test_steps_between_knots_off_the_grid_are_repeated() -> None:
    """A sample is a sum of shorter steps where a knot of a table of torques is within a step."""
    table = fl.Drive(kind="table", times=(0.0, 0.0073, 0.031), torques=((0.0, 0.0), (9.0, 1.0), (0.0, 4.0)))
    driven = arm(**{"run.method": "Radau5", **LONG, "drive": table})
    assert fl.simulate(driven).steps.taken > 40
    np.testing.assert_allclose(*push_and_differences(driven, 3e-5), rtol=1e-8)


def test_steps_that_are_taken_in_parts_are_repeated_in_the_same_parts() -> None:
    """Newton's iteration fails where dry friction stops a joint within a step, which is then divided."""
    dry = arm(**{"run.method": "Radau5", **LONG, "link.upper.joint.coulomb_width": 1e-3, "run.duration": 0.02})
    assert fl.simulate(dry).steps.failed > 0
    np.testing.assert_allclose(*push_and_differences(dry, 3e-7), rtol=1e-6)


@pytest.mark.parametrize("method", ["RK4", "Radau5"])
def test_slopes_of_any_size_have_a_gradient_unless_it_overflows(method: str) -> None:
    run = fl.simulate(arm(**{"run.method": method}))
    unit = fl.run_gradient(run, np.ones_like(run.q))
    for power in (-900, -510, 510, 900):
        found = fl.run_gradient(run, np.full_like(run.q, 2.0**power))
        np.testing.assert_array_equal(np.ldexp(found.dtau, -power), unit.dtau)
    with refused(ArgumentError, "overflow"):
        fl.run_gradient(run, np.full_like(run.q, 1e308))
    assert not fl.run_gradient(run, 0 * run.q).dtau.any()


def test_steps_that_friction_divides_again_and_again_have_room() -> None:
    """405 steps between two samples become 2,358; the gradient is that of the same run with five samples."""
    h, number = 0.009753958241071736, 405
    friction = {f"link.{link}.joint.{key}": value for link in ("upper", "fore")
                for key, value in (("coulomb_width", 1.06e-5), ("coulomb", 10.486))}  # fmt: skip
    run, often = (
        fl.simulate(arm(**{"run.method": "Gauss4", "run.step": h, "run.sample": h * every, "run.duration": h * number,
                           "material.aluminium.young": 540611688.8561654, **friction}))
        for every in (number, number // 5)
    )  # fmt: skip
    assert run.steps.taken > 2 * number + 1000
    last = np.zeros_like(often.q)
    last[-1] = 1.0
    expected = fl.run_gradient(often, last).dtau.sum(axis=0)
    np.testing.assert_allclose(fl.run_gradient(run, np.ones_like(run.q)).dtau[0], expected, rtol=1e-6)


def test_an_adjoint_that_does_not_converge_names_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    run = fl.simulate(arm(**{"run.method": "Radau5"}))
    monkeypatch.setattr("flexlink.motion.run_gradient.go_back_implicitly", lambda *_: -5)
    with refused(SceneError, "gradient-not-found"):
        fl.run_gradient(run, np.ones_like(run.q))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("random_scene", [random_arm, random_tree])
@pytest.mark.parametrize("explicit", [True, False])
def test_gradients_of_random_arms_agree_with_tangents(
    random_scene: Callable[[int], fl.Scene], seed: int, explicit: bool
) -> None:
    bare = {"base": None, "wrench": None, "initial.base": None, "drive": None}
    scene = random_scene(seed).varied(bare)
    chain = fl.lump(scene)
    h = 0.3 * min(fl.stable_step(chain, *fl.initial_state(scene, chain)), 1e-2)
    h, name, steps = (h, "RK4", 20) if explicit else (2 * h, IMPLICIT[seed % len(IMPLICIT)], 8)
    scene = scene.varied({"run": fl.RunSettings(method=name, step=h, sample=2 * h, duration=steps * h)})
    if chain.arrays.rare is not None and any(len(rows) for rows in chain.arrays.rare):
        pytest.skip("Pinocchio has no springs between joints")
    check(scene, seed)


def test_a_final_cost_has_the_gradient_of_its_closed_form() -> None:
    """A free wheel with rotor A: q(T) = q₀ + T q̇₀ + Σ τ_k s (T − (k + ½) s) / A, with samples s apart."""
    wheel = fl.Link(name="wheel", joint=fl.Joint(armature=2.0), hub=fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0)))
    scene = make_scene(wheel, run=fl.RunSettings(method="RK4", step=0.01, sample=0.02, duration=0.2))
    run = fl.simulate(scene)
    dq = np.zeros_like(run.q)
    dq[-1] = 1.0
    found = fl.run_gradient(run, dq)
    left = 0.2 - 0.02 * (np.arange(10) + 0.5)
    np.testing.assert_allclose(found.dtau[:, 0], 0.02 * left / 3.0, rtol=1e-12)
    np.testing.assert_allclose([found.dq[0], found.dqd[0]], [1.0, 0.2], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["RK4", *IMPLICIT])
def test_a_gradient_costs_less_than_six_runs(name: str) -> None:
    driven = held(arm(**{"run.method": name, "run.sample": 2.5e-5, "run.duration": 0.0125}), np.ones((500, 2)))
    problem, run = fl.Problem(driven), fl.simulate(driven)
    costs = np.full(2, np.inf)
    for _ in range(20):
        for k, call in enumerate((problem.simulate, lambda: fl.run_gradient(run, run.q))):
            begun = time.process_time()
            call()
            costs[k] = min(costs[k], time.process_time() - begun)
    assert costs.sum() < 6 * costs[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"wrench": fl.Wrench(force=(1.0, 0.0, 0.0), frame="tip")},
        {"drive": fl.Drive(kind="pd", kp=(4.0, 2.0), kd=(0.1, 0.1), target_deg=(-60.0, 25.0))},
        {"drive": fl.Drive(kind="constant", torque=(2.0, 0.0), effort=(1.0, 1.0))},
        {"motion": (TURN,)},
        {"link.fore.modes": 1},
    ],
)  # fmt: skip
def test_features_without_gradient_are_refused_by_name(changes: dict[str, Any]) -> None:
    run = fl.simulate(arm(**changes))
    with refused(SceneError, "gradient-not-supported"):
        fl.run_gradient(run)


def test_other_steps_are_refused() -> None:
    for name in ("Radau5", None):
        run = fl.simulate(arm(**{"run.step": None, "run.tolerance": 1e-4, "run.method": name}))
        with refused(SceneError, "gradient-needs-steps"):
            fl.run_gradient(run)


@pytest.mark.parametrize("name", ["RK4", "Radau5"])
def test_a_run_that_its_scene_does_not_repeat_is_refused(name: str) -> None:
    run = fl.simulate(arm(**{"run.method": name}), control=lambda t, q, qd: (1.0, 0.0), rate=20_000.0)
    with refused(ArgumentError, "run-not-repeatable"):
        fl.run_gradient(run)


@pytest.mark.parametrize("name", ["RK4", "Radau5"])
def test_a_stored_run_has_the_same_gradient(name: str, tmp_path: Path) -> None:
    pushed = fl.Wrench(times=(0.0, 1e-3), forces=((0.0, 1.0, 0.0), (0.0, 9.0, 0.0)))
    run = fl.simulate(held(arm(**{"wrench": pushed, "run.method": name}), np.ones((20, 2))))
    again = fl.Trajectory.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(fl.run_gradient(again, run.q).dtau, fl.run_gradient(run, run.q).dtau)


def test_derivatives_of_the_wrong_shape_are_refused() -> None:
    run = fl.simulate(arm())
    for wrong, id in ((run.q[1:], "wrong-shape"), (run.q * np.nan, "not-finite")):
        with refused(ArgumentError, id):
            fl.run_gradient(run, wrong)


def test_a_new_feature_is_refused_until_it_has_a_gradient() -> None:
    """The adjoint knows all of these; whoever adds one adds its derivative there, or refuses it."""
    assert {f.name for f in fields(fl.Scene)} - SUPPORTED == {"motion", "tie", "limits"}
    assert set(KINDS) == {"couplings", "rotation", "drag", "dampers", "gyrators", "hardening"}
    assert set(HINGE.names or ()) == {
        "axis", "stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature", "lower", "upper", "prescribed",
    }  # fmt: skip
    assert len(BODY.names or ()) == 14
    assert len(dataclasses.fields(fl.Chain)) == 12
