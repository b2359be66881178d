"""Lagging viscous friction, a force law with a state, agrees with closed forms and an independent integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import flexlink as fl
from flexlink.formats.features import unsupported
from tests.conftest import random_state
from tests.support.words import refused

FIXED = 1e-9  # allowed error of runs with steps of 1 ms
WAYS = [("RK4", FIXED), ("Gauss4", FIXED), ("Radau5", 1e-6), ("DOP853", 1e-7), ("Radau9", 1e-8), ("auto", 1e-5)]
NONE = {"link.*.joint.viscous": 0.0, "link.*.joint.viscous_lag": 0.0}
RATES = np.array([[0.0, -2.0], [1 / 0.3, -1 / 0.3]])  # matrix of q̈ = −d ζ / I and ζ̇ = (q̇ − ζ) / τ


def wheel(**changes: object) -> fl.Scene:
    """A wheel of 1 kg m² at 3 rad/s vibrates and comes to rest: its friction of 2 N m s/rad lags by 0.3 s."""
    joint = fl.Joint(viscous=2.0, viscous_lag=0.3, armature=1.0)
    arm = fl.Arm(links=(fl.Link(name="wheel", joint=joint, hub=fl.RigidBody(mass=1.0)),))
    run = fl.RunSettings(duration=2.0, sample=0.5, step=1e-3)
    start = fl.InitialState(q=(0.0, 0.0), qd=(3.0, 0.0))
    return fl.Scene(name="wheel", arm=arm, run=run, initial=start).varied(changes)


def lagging(**changes: object) -> fl.Scene:
    scene = fl.load_scene("models/t2_spatial.toml")
    late = {"link.*.joint.viscous": 20.0, "link.*.joint.viscous_lag": 0.02, "link.*.joint.coulomb": 0.0}
    return scene.varied({**late, "run.duration": 0.3, "run.sample": 0.1, **changes})


@pytest.mark.parametrize(("method", "tolerance"), WAYS)
def test_a_wheel_with_lagging_friction_follows_the_matrix_exponential(method: str, tolerance: float) -> None:
    by_tolerance = {"run.relative_tolerance": tolerance} if tolerance > FIXED else {}
    run = fl.simulate(wheel(**{"run.method": method, **by_tolerance}))
    np.testing.assert_allclose(run.qd, [expm(RATES * t) @ [3.0, 0.0] for t in run.t], atol=20 * tolerance)
    assert np.abs(run.imbalance).max() <= 4.5 * 20 * tolerance


def test_without_an_initial_state_lagging_friction_starts_at_zero() -> None:
    given = wheel(initial=fl.InitialState(rate_deg=(np.degrees(3.0),)))
    np.testing.assert_array_equal(fl.simulate(given).qd, fl.simulate(wheel()).qd)


def test_a_bending_arm_agrees_with_an_independent_integrator() -> None:
    scene = lagging(drive=fl.Drive(), wrench=fl.Wrench())
    chain, bare = fl.lump(scene), fl.lump(scene.varied(NONE))
    run = fl.simulate(scene.varied({"run.method": "Radau9", "run.relative_tolerance": 1e-8}))
    joints, n = bare.active, bare.n

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        q, qd, ζ = y[:n], y[n : 2 * n], y[2 * n :]
        tau = np.zeros(n)
        tau[joints] = -20.0 * ζ
        return np.concatenate([qd, fl.forward_dynamics(bare, q, qd, tau), (qd[joints] - ζ) / 0.02])

    outside = np.delete(np.arange(chain.n), chain.internal)
    start = np.concatenate([run.q[0, outside], run.qd[0, outside], np.zeros(len(joints))])
    end = solve_ivp(rates, (0.0, 0.3), start, "Radau", rtol=1e-6, atol=1e-8).y[:, -1]
    np.testing.assert_allclose(run.q[-1, outside], end[:n], atol=1e-5)
    np.testing.assert_allclose(run.qd[-1, chain.internal], end[2 * n :], atol=1e-4)


def test_lagging_friction_only_dissipates_energy(rng) -> None:
    chain = fl.lump(lagging())
    _, qd = random_state(chain, rng)
    torque = fl.friction_torque(chain, qd)
    np.testing.assert_allclose(torque[chain.active[0]], 20.0 * qd[chain.internal[0]], rtol=1e-14)
    hinges = np.delete(chain.damping * qd**2, chain.internal).sum()
    np.testing.assert_allclose(qd @ torque, hinges + 20.0 * (qd[chain.internal] ** 2).sum(), rtol=1e-12)


def test_a_linear_model_includes_the_friction_state() -> None:
    chain = fl.lump(wheel())
    model = fl.linearize(chain, np.zeros(2), outputs=("joints",))
    states = "q wheel [rad]", "qd wheel [rad/s]", "qd wheel.lag [rad/s]"
    assert model.states == states
    np.testing.assert_allclose(model.A[1:, 1:], RATES, rtol=1e-12)
    wanted = np.append(0.0, np.linalg.eigvals(RATES))
    np.testing.assert_allclose(np.poly(model.eigenvalues), np.poly(wanted), atol=1e-12)


def test_a_long_lag_in_a_stiff_damper_is_solved_by_every_implicit_method() -> None:
    for method in ("Radau5", "Radau9"):
        scene = wheel(**{"run.method": method, "run.relative_tolerance": 1e-4, "link.wheel.joint.viscous": 1e3})
        run, rates = fl.simulate(scene), np.array([[0.0, -1e3], [1 / 0.3, -1 / 0.3]])
        np.testing.assert_allclose(run.qd, [expm(rates * t) @ [3.0, 0.0] for t in run.t], atol=1e-2)


def test_locked_joints_and_statics_have_no_friction_state() -> None:
    locked = lagging(**{"link.fore.joint.locked": True}, initial=fl.InitialState(), drive=fl.Drive())
    assert len(fl.lump(locked).internal) == 2
    chain = fl.lump(lagging())
    bare = fl.lump(lagging(**{"link.*.joint.viscous_lag": 0.0}))
    rest, wanted = (fl.solve_static(each, locked=each.active).q for each in (chain, bare))
    np.testing.assert_allclose(np.delete(rest, chain.internal), wanted, atol=1e-12)
    found, frozen = (fl.modes(each, locked=each.active).frequencies for each in (chain, bare))
    np.testing.assert_allclose(found, frozen, rtol=1e-9)


def test_functions_that_do_not_support_lagging_friction_refuse_it() -> None:
    scene = lagging()
    chain = fl.lump(scene)
    assert "lagging friction" in unsupported(scene, chain, format="mjcf")
    for function in (fl.to_mjcf, fl.to_urdf, fl.to_sdf, fl.modes):
        with refused(fl.FlexlinkError, "not-supported-here"):
            function(chain)
    with refused(fl.FlexlinkError, "not-supported-here"):
        fl.compare_trajectories(scene, engines=["mujoco"])
    with refused(fl.FlexlinkError, "needs-another-key"):
        fl.Joint(viscous_lag=0.1)
