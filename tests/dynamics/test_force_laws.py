"""Quadratic dampers, lagging friction and hardening springs of joints: closed forms, integrators, and refusals."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.special
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import flexlink as fl
from flexlink.formats.features import unsupported
from flexlink.kernels.forces.elements import KINDS
from flexlink.kernels.layout import FORCES, Rare
from tests.conftest import random_state
from tests.matrix.case import case
from tests.support.words import refused

ROOT = Path(__file__).parents[2]
FIXED = 1e-9  # allowed error of runs with steps of 1 ms
WAYS = [("RK4", FIXED), ("Gauss4", FIXED), ("Radau5", 1e-6), ("DOP853", 1e-7), ("Radau9", 1e-8), ("auto", 1e-5)]
C, M, L, G = 4.0, 0.5, 0.8, 9.81
PERIOD = 4 * scipy.special.ellipk(0.5) / np.sqrt(C)
RATES = np.array([[0.0, -2.0], [1 / 0.3, -1 / 0.3]])  # matrix of q̈ = −d ζ / I and ζ̇ = (q̇ − ζ) / τ
HARD, NO_LAG = "link.wheel.joint.hardening", {"link.*.joint.viscous": 0.0, "link.*.joint.viscous_lag": 0.0}


class Wheel(NamedTuple):
    """A wheel of 1 kg m² with a force law at its joint, and what its angle or rate is in time."""

    joint: dict[str, float]
    initial: fl.InitialState
    run: fl.RunSettings
    exact: Callable[[np.ndarray], np.ndarray]
    of: str = "qd"

    def scene(self, **changes: object) -> fl.Scene:
        link = fl.Link(name="wheel", joint=fl.Joint(armature=1.0, **self.joint), hub=fl.RigidBody(mass=1.0))
        made = fl.Scene(name="wheel", arm=fl.Arm(links=(link,)), run=self.run, initial=self.initial)
        return made.varied(changes)


WHEELS = {
    "quadratic": Wheel(
        {"quadratic": 0.5}, fl.InitialState(q=(0.0,), qd=(3.0,)), fl.RunSettings(duration=4.0, sample=1.0, step=1e-3),
        lambda t: 3 / (1 + 1.5 * t),
    ),
    "lag": Wheel(
        {"viscous": 2.0, "viscous_lag": 0.3}, fl.InitialState(q=(0.0, 0.0), qd=(3.0, 0.0)),
        fl.RunSettings(duration=2.0, sample=0.5, step=1e-3),
        lambda t: np.array([(expm(RATES * s) @ [3, 0])[0] for s in t]),
    ),
    "hardening": Wheel(
        {"hardening": C}, fl.InitialState(q=(1.0,), qd=(0.0,)),
        fl.RunSettings(duration=PERIOD, sample=PERIOD / 8, step=PERIOD / 4096),
        lambda t: scipy.special.ellipj(np.sqrt(C) * t, 0.5)[1], "q",
    ),
}  # fmt: skip
"""Closed forms: 3 / (1 + 1.5 t); a matrix exponential; Duffing's elliptic cosine."""


def arm(law: str, **changes: object) -> fl.Scene:
    """A bending arm with this law at its joints."""
    own: dict[str, object] = {
        "quadratic": {"link.*.joint.quadratic": 20.0},
        "lag": {"link.*.joint.viscous": 20.0, "link.*.joint.viscous_lag": 0.02, "link.*.joint.coulomb": 0.0},
    }[law]
    scene = fl.load_scene("models/t2_spatial.toml")
    return scene.varied({**own, "run.duration": 0.3, "run.sample": 0.1, **changes})


@pytest.mark.parametrize(("method", "tolerance"), WAYS)
@pytest.mark.parametrize("law", WHEELS)
def test_a_wheel_moves_by_the_closed_form(law: str, method: str, tolerance: float) -> None:
    by_tolerance = {"run.relative_tolerance": tolerance} if tolerance > FIXED else {}
    wheel = WHEELS[law]
    run = fl.simulate(wheel.scene(**{"run.method": method, **by_tolerance}))
    np.testing.assert_allclose(getattr(run, wheel.of)[:, 0], wheel.exact(run.t), atol=20 * tolerance)
    assert np.abs(run.imbalance).max() <= 4.5 * 20 * tolerance
    if law == "hardening":
        np.testing.assert_allclose(run.energy.elastic, C / 4 * run.q[:, 0] ** 4, rtol=1e-12)


@pytest.mark.parametrize("law", ["quadratic", "lag"])
def test_a_bending_arm_agrees_with_an_independent_integrator(law: str) -> None:
    scene = arm(law, drive=fl.Drive(), wrench=fl.Wrench())
    run = fl.simulate(scene.varied({"run.method": "Radau9", "run.relative_tolerance": 1e-8}))
    bare = fl.lump(scene.varied({"link.*.joint.quadratic": 0.0} if law == "quadratic" else NO_LAG))
    joints, n = bare.active, bare.n

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        q, qd, ζ = y[:n], y[n : 2 * n], y[2 * n :]
        tau = np.zeros(n)
        tau[joints] = -20.0 * (ζ if law == "lag" else np.abs(qd[joints]) * qd[joints])
        return np.concatenate([qd, fl.forward_dynamics(bare, q, qd, tau), (qd[joints] - ζ) / 0.02])

    outside, lags = np.delete(np.arange(run.chain.n), run.chain.internal), run.chain.internal
    start = np.concatenate([run.q[0, outside], run.qd[0, outside], np.zeros(len(joints))])
    end = solve_ivp(rates, (0.0, 0.3), start, "Radau", rtol=1e-6, atol=1e-8).y[:, -1]
    np.testing.assert_allclose(run.q[-1, outside], end[:n], atol=1e-5)
    np.testing.assert_allclose(run.qd[-1, lags], end[2 * n :][: len(lags)], atol=1e-4)


def test_quadratic_damper_torques_and_derivatives_are_exact(rng) -> None:
    chain, bare = fl.lump(arm("quadratic")), fl.lump(arm("quadratic", **{"link.*.joint.quadratic": 0.0}))
    q, qd = random_state(chain, rng)
    c, zero = np.isin(np.arange(chain.n), chain.active) * 20.0, np.zeros(chain.n)
    more = c * np.abs(qd) * qd
    np.testing.assert_allclose(fl.friction_torque(chain, qd), fl.friction_torque(bare, qd) + more, rtol=1e-14)
    slopes, without = (
        fl.forward_dynamics_derivatives(one, q, qd, zero - two) for one, two in ((chain, 0.0), (bare, more))
    )
    wanted = without.dqd - without.dtau * 2 * c * np.abs(qd)
    np.testing.assert_allclose(slopes.dqd, wanted, atol=1e-10 * np.abs(wanted).max())


def test_strong_dampers_and_springs_do_not_shorten_implicit_steps() -> None:
    stiff = {"run.method": "Radau5", "run.relative_tolerance": 1e-4}
    runs = [fl.simulate(WHEELS["quadratic"].scene(**stiff, **{"link.wheel.joint.quadratic": c})) for c in (0.5, 1e4)]
    assert runs[1].steps.evaluations <= 2.4 * runs[0].steps.evaluations  # 2.1; without the damper's slope 2.7
    np.testing.assert_allclose(runs[1].qd[:, 0], 3 / (1 + 3e4 * runs[1].t), atol=1e-5)
    run = fl.simulate(WHEELS["hardening"].scene(**stiff, **{"link.wheel.joint.viscous": 1e6, HARD: 1e9}))
    assert run.steps.evaluations <= 750  # 666; without the spring's slope 858
    np.testing.assert_allclose(run.q[1:, 0], (1 + 2e3 * run.t[1:]) ** -0.5, atol=1e-5)  # inertia hardly matters


@pytest.mark.parametrize("law", WHEELS)
def test_exports_and_engines_without_a_law_report_it(law: str) -> None:
    scene = case(law).scene if law == "hardening" else arm(law)
    name = {"quadratic": "quadratic dampers", "lag": "lagging friction", "hardening": "hardening springs"}[law]
    chain = fl.lump(scene)
    for format in ("urdf", "mjcf", "sdf"):
        assert name in unsupported(scene, chain, format=format)
    with refused(fl.FlexlinkError, "not-supported-here" if law == "lag" else "arguments-not-counted"):
        fl.compare_trajectories(scene, engines=["mujoco"])


# Lagging friction.


def test_without_an_initial_state_lagging_friction_starts_at_zero() -> None:
    wheel = WHEELS["lag"].scene
    given = wheel(initial=fl.InitialState(rate_deg=(np.degrees(3.0),)))
    np.testing.assert_array_equal(fl.simulate(given).qd, fl.simulate(wheel()).qd)


def test_lagging_friction_only_dissipates_energy(rng) -> None:
    chain = fl.lump(arm("lag"))
    _, qd = random_state(chain, rng)
    torque = fl.friction_torque(chain, qd)
    np.testing.assert_allclose(torque[chain.active[0]], 20.0 * qd[chain.internal[0]], rtol=1e-14)
    hinges = np.delete(chain.damping * qd**2, chain.internal).sum()
    np.testing.assert_allclose(qd @ torque, hinges + 20.0 * (qd[chain.internal] ** 2).sum(), rtol=1e-12)


def test_a_linear_model_includes_the_friction_state() -> None:
    model = fl.linearize(fl.lump(WHEELS["lag"].scene()), np.zeros(2), outputs=("joints",))
    states = "q wheel [rad]", "qd wheel [rad/s]", "qd wheel.lag [rad/s]"
    assert model.states == states
    np.testing.assert_allclose(model.A[1:, 1:], RATES, rtol=1e-12)
    wanted = np.append(0.0, np.linalg.eigvals(RATES))
    np.testing.assert_allclose(np.poly(model.eigenvalues), np.poly(wanted), atol=1e-12)


@pytest.mark.parametrize("method", ["Radau5", "Radau9"])
def test_a_long_lag_in_a_stiff_damper_is_solved_by_every_implicit_method(method: str) -> None:
    stiff = {"run.method": method, "run.relative_tolerance": 1e-4, "link.wheel.joint.viscous": 1e3}
    run, rates = fl.simulate(WHEELS["lag"].scene(**stiff)), np.array([[0.0, -1e3], [1 / 0.3, -1 / 0.3]])
    np.testing.assert_allclose(run.qd, [expm(rates * t) @ [3.0, 0.0] for t in run.t], atol=1e-2)


def test_locked_joints_and_statics_have_no_friction_state() -> None:
    locked = arm("lag", **{"link.fore.joint.locked": True}, initial=fl.InitialState(), drive=fl.Drive())
    assert len(fl.lump(locked).internal) == 2
    chain, bare = fl.lump(arm("lag")), fl.lump(arm("lag", **{"link.*.joint.viscous_lag": 0.0}))
    rest, wanted = (fl.solve_static(each, locked=each.active).q for each in (chain, bare))
    np.testing.assert_allclose(np.delete(rest, chain.internal), wanted, atol=1e-12)
    found, frozen = (fl.modes(each, locked=each.active).frequencies for each in (chain, bare))
    np.testing.assert_allclose(found, frozen, rtol=1e-9)


def test_functions_that_do_not_support_lagging_friction_refuse_it() -> None:
    for function in (fl.to_mjcf, fl.to_urdf, fl.to_sdf, fl.modes):
        with refused(fl.FlexlinkError, "not-supported-here"):
            function(fl.lump(arm("lag")))
    with refused(fl.FlexlinkError, "needs-another-key"):
        fl.Joint(viscous_lag=0.1)


# Hardening springs.


def pendulum(pull: float) -> fl.Chain:
    """A point mass M on a weightless rod L; its weight pulls along the rod at angle zero (`pull` 1) or pushes (−1)."""
    link = fl.Link(name="rod", length=L, joint=fl.Joint(hardening=C), end=fl.RigidBody(mass=M))
    return fl.lump(fl.Scene(name="rod", arm=fl.Arm(links=(link,)), gravity=(pull * G, 0.0, 0.0)))


def test_small_motion_about_a_deflected_rest_has_the_stiffness_of_weight_and_spring() -> None:
    chain, tau = pendulum(1.0), 3.0
    rest = fl.solve_static(chain, tau=[tau])
    (q,) = rest.q
    assert C * q**3 + M * G * L * np.sin(q) == pytest.approx(tau, rel=1e-12)
    k = M * G * L * np.cos(q) + 3 * C * q**2
    assert rest.stable
    assert fl.natural_frequencies(chain, rest.q)[0] ** 2 == pytest.approx(k / (M * L**2), rel=1e-9)
    assert fl.modes(chain, rest.q).eigenvalues[0].imag ** 2 == pytest.approx(k / (M * L**2), rel=1e-9)
    A = fl.linearize(chain, rest.q, tau=rest.tau).A
    np.testing.assert_allclose(A, [[0.0, 1.0], [-k / (M * L**2), 0.0]], atol=1e-12)


def test_a_standing_arm_leans_until_its_spring_is_stiff_enough_and_buckles_by_the_closed_form() -> None:
    chain = pendulum(-1.0)
    (q,) = fl.solve_static(chain, [0.5]).q
    assert abs(q) > 0.5
    assert C * q**3 == pytest.approx(M * G * L * np.sin(q), rel=1e-9)
    factor = 3 * C * q**2 / (M * G * L * np.cos(q))  # K_elastic / −K_load
    np.testing.assert_allclose(fl.strength.buckling_loads(chain, [q]), [factor], rtol=1e-12)
    assert not fl.solve_static(chain, [0.0]).stable


def test_a_spring_with_no_slope_at_the_start_is_found_in_equilibrium() -> None:
    chain = fl.lump(WHEELS["hardening"].scene())
    for start in (0.0, 0.3, 2.0):
        found = fl.solve_static(chain, [start], tau=[C])
        np.testing.assert_allclose(found.q, [1.0], rtol=1e-9)
        assert found.stable


def test_the_recipe_of_a_force_law_names_files_that_exist_and_tables_that_agree() -> None:
    text = (ROOT / "docs" / "development" / "recipes.md").read_text(encoding="utf-8")
    text = text.split("## A force law\n")[1].split("\n## ")[0]
    files = re.findall(r"`((?:flexlink|tests|docs)/[\w/.]+\.\w+)`", text)
    assert len(re.findall(r"^\d\. ", text, re.MULTILINE)) == 8
    assert [path for path in files if not (ROOT / path).is_file()] == []
    assert tuple(FORCES) == Rare._fields
    assert KINDS.keys() == {*FORCES, "rotation"}
    assert len(set(FORCES.values())) == len(FORCES), "elements differ by the dtypes of their rows"


def test_archives_continued_runs_sweeps_and_fits_include_hardening_springs(tmp_path) -> None:
    scene = WHEELS["hardening"].scene()
    whole = fl.simulate(scene)
    whole.save(tmp_path / "run.npz")
    assert fl.Trajectory.load(tmp_path / "run.npz").chain.forces["hardening"]["cubic"].tolist() == [C]
    start = fl.InitialState(q=tuple(whole.q[4]), qd=tuple(whole.qd[4]), time=float(whole.t[4]))
    again = fl.simulate(replace(scene.varied({"run.duration": float(whole.t[4])}), initial=start))
    np.testing.assert_allclose(again.q[-1], whole.q[-1], atol=1e-9)
    many = fl.simulate_many([scene.varied({HARD: c}) for c in (1.0, C)])
    np.testing.assert_array_equal(many[1].q, whole.q)
    head, σ = "q wheel [rad]", 1e-6
    seen = fl.fits.FitRun(name="swing", columns={"t [s]": whole.t, head: whole.columns[head]}, noise={head: σ})
    start_value = scene.varied({HARD: 1.1 * C})
    found = fl.fit(fl.fits.FitProblem(scene=start_value, parameter=(fl.fits.FitParameter(path=HARD),), run=(seen,)))
    assert found[HARD].value == pytest.approx(C, rel=1e-6)
