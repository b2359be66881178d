"""Quadratic joint dampers, c |q̇| q̇, agree with closed forms and other integrators; unsupported uses are refused."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.formats.features import unsupported
from tests.conftest import random_state
from tests.support.words import refused

HARD = "link.wheel.joint.quadratic"
FIXED = 1e-9  # allowed error of runs with steps of 1 ms
WAYS = [("RK4", FIXED), ("Gauss4", FIXED), ("Radau5", 1e-6), ("DOP853", 1e-6), ("Radau9", 1e-8), ("auto", 1e-5)]


def wheel(**changes: object) -> fl.Scene:
    """A wheel of 1 kg m² rotates at 3 rad/s with damping 0.5 N m s²/rad²: q̇ = 3 / (1 + 1.5 t)."""
    joint = fl.Joint(quadratic=0.5, armature=1.0)
    arm = fl.Arm(links=(fl.Link(name="wheel", joint=joint, hub=fl.RigidBody(mass=1.0)),))
    run = fl.RunSettings(duration=4.0, sample=1.0, step=1e-3)
    return fl.Scene(name="wheel", arm=arm, run=run, initial=fl.InitialState(q=(0.0,), qd=(3.0,))).varied(changes)


def damped(**changes: object) -> fl.Scene:
    scene = fl.load_scene("models/t2_spatial.toml")
    return scene.varied({"link.*.joint.quadratic": 20.0, "run.duration": 0.3, "run.sample": 0.1, **changes})


@pytest.mark.parametrize(("method", "tolerance"), WAYS)
def test_a_quadratically_damped_wheel_slows_down_by_the_closed_form(method: str, tolerance: float) -> None:
    by_tolerance = {"run.relative_tolerance": tolerance} if tolerance > FIXED else {}
    run = fl.simulate(wheel(**{"run.method": method, **by_tolerance}))
    np.testing.assert_allclose(run.qd[:, 0], 3 / (1 + 1.5 * run.t), rtol=20 * tolerance)
    assert np.abs(run.imbalance).max() <= 4.5 * 20 * tolerance


def test_a_bending_arm_agrees_with_an_independent_integrator() -> None:
    scene = damped(drive=fl.Drive(), wrench=fl.Wrench())
    chain, run = fl.lump(scene), fl.simulate(scene.varied({"run.method": "Radau9", "run.relative_tolerance": 1e-8}))
    c = np.isin(np.arange(chain.n), chain.active) * 20.0
    bare = fl.lump(scene.varied({"link.*.joint.quadratic": 0.0}))

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        q, qd = y.reshape(2, -1)
        return np.concatenate([qd, fl.forward_dynamics(bare, q, qd, -c * np.abs(qd) * qd)])

    end = solve_ivp(rates, (0.0, 0.3), np.concatenate([run.q[0], run.qd[0]]), "Radau", rtol=1e-6, atol=1e-8).y[:, -1]
    np.testing.assert_allclose(run.q[-1], end[: chain.n], atol=1e-5)


def test_quadratic_damper_torques_and_derivatives_are_exact(rng) -> None:
    chain = fl.lump(damped())
    q, qd = random_state(chain, rng)
    bare = fl.lump(damped(**{"link.*.joint.quadratic": 0.0}))
    more = np.zeros(chain.n)
    more[chain.active] = 20.0 * np.abs(qd[chain.active]) * qd[chain.active]
    np.testing.assert_allclose(fl.friction_torque(chain, qd), fl.friction_torque(bare, qd) + more, rtol=1e-14)
    zero = np.zeros(chain.n)
    slopes, without = (
        fl.forward_dynamics_derivatives(one, q, qd, zero - two) for one, two in ((chain, 0.0), (bare, more))
    )
    brakes = np.zeros(chain.n)
    brakes[chain.active] = 2 * 20.0 * np.abs(qd[chain.active])
    wanted = without.dqd - without.dtau * brakes
    np.testing.assert_allclose(slopes.dqd, wanted, atol=1e-10 * np.abs(wanted).max())


def test_a_strong_quadratic_damper_does_not_shorten_implicit_steps() -> None:
    runs = [fl.simulate(wheel(**{"run.method": "Radau5", "run.relative_tolerance": 1e-4, HARD: c})) for c in (0.5, 1e4)]
    assert runs[1].steps.evaluations <= 2.4 * runs[0].steps.evaluations  # 2.1; without the damper's slope 2.7
    np.testing.assert_allclose(runs[1].qd[:, 0], 3 / (1 + 3e4 * runs[1].t), atol=1e-5)


def test_exports_and_engines_without_quadratic_dampers_report_it() -> None:
    scene = damped()
    assert "quadratic dampers" in unsupported(scene, fl.lump(scene), format="mjcf")
    with refused(fl.FlexlinkError, "arguments-not-counted"):
        fl.compare_trajectories(scene, engines=["mujoco"])
