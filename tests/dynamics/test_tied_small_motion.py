"""Modes, linear models and equilibria of arms with ties, against Pinocchio, SciPy and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import scipy
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize

import flexlink as fl
from flexlink.cli.main import main
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.sensors.signals import signal_of
from flexlink.dynamics.tied_motion import tied_acceleration
from flexlink.dynamics.ties import gaps, tie_rows
from tests.campaigns.random_ties import Maker
from tests.motion.test_ties import BENDS, arm, bricard, fourbar, rod, touching
from tests.support.touching import Touching
from tests.support.words import refused, reviewed

SPRUNG = {"tie.t0.stiffness": 2e3}
SEEDS = [(2, SPRUNG), (3, {}), (6, {}), (11, {}), (24, SPRUNG), (35, {}), (42, {})]


def at_rest(scene: fl.Scene) -> tuple[fl.Chain, Equilibrium]:
    chain = fl.Problem(scene).chain
    return chain, fl.solve_static(chain, fl.initial_state(scene, chain)[0], ties=scene)


def random_arm(seed: int, **changes: object) -> fl.Scene:
    """An arm of the campaign without losses and drives."""
    losses = {"joint.viscous": 0.0, "joint.coulomb": 0.0, "joint.coulomb_width": None, "friction": None}
    none = {"drive": {}, "wrench": {}, "initial.rate_deg": None, "material.m.loss_time": 0.0}
    return Maker(seed).scene().varied({f"link.*.{key}": value for key, value in losses.items()} | none | changes)


class Energy(Touching):
    """Energy V of gravity and springs in Pinocchio, ∂V/∂q, M and exact rows, none redundant, in flexlink's order."""

    def __init__(self, scene: fl.Scene, chain: fl.Chain, q: np.ndarray) -> None:
        super().__init__(chain, tie_rows(scene, chain))
        exact = np.isinf(self.rows["stiffness"])
        self.k, self.held = np.where(exact, 0.0, self.rows["stiffness"]), np.flatnonzero(exact)
        if len(self.held):
            R, order = scipy.linalg.qr(self.gaps(q)[1][exact].T, mode="r", pivoting=True)
            pivots = np.abs(np.diag(R))
            self.held = self.held[order[: int((pivots > 1e-8 * pivots[0]).sum())]]
        self.λ = np.linalg.lstsq(self.gaps(q)[1][self.held].T, -self.slope(q))[0]

    def order_of(self, q: np.ndarray) -> np.ndarray:
        return q[np.argsort(self.order)]

    def gaps(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        g, J = self.springs(self.order_of(q), 0 * q)
        return g, J[:, self.order]

    def value(self, q: np.ndarray) -> float:
        gravity = pin.computePotentialEnergy(self.model, self.data, self.order_of(q))
        return gravity + self.chain.stiffness @ (q - self.chain.rest) ** 2 / 2 + self.k @ self.gaps(q)[0] ** 2 / 2

    def slope(self, q: np.ndarray) -> np.ndarray:
        g, J = self.gaps(q)
        return J.T @ (self.k * g) - self.open(self.order_of(q), 0 * q)[1][self.order]

    def balance(self, q: np.ndarray) -> np.ndarray:
        return self.slope(q) + self.gaps(q)[1][self.held].T @ self.λ

    def squares(self, q: np.ndarray) -> np.ndarray:
        """ω² of [K Jᵀ; J 0] x = ω² [M 0; 0 0] x, with sixth differences of the balance; ω² + 1 helps neutral modes."""
        weights, J, h = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}, self.gaps(q)[1][self.held], 1e-3
        M = self.open(self.order_of(q), 0 * q)[0][np.ix_(self.order, self.order)]
        K = np.array([
            sum(w * (self.balance(q + k * e) - self.balance(q - k * e)) for k, w in weights.items()) / h
            for e in h * np.eye(len(q))
        ])  # fmt: skip
        border, L = np.block([[(K + K.T) / 2 + M, J.T], [J, np.zeros((len(J),) * 2)]]), np.linalg.cholesky(M)
        found = np.linalg.eigvalsh(L.T @ np.linalg.inv(border)[: len(q), : len(q)] @ L)[len(J) :]  # the rest are 0
        return np.sort(1 / found - 1)


@pytest.mark.parametrize(("seed", "more"), SEEDS)
def test_frequencies_of_random_arms_are_those_of_another_engine(seed: int, more: dict) -> None:
    scene = random_arm(seed, **more)
    chain, rest = at_rest(scene)
    found, other = fl.modes(chain, rest.q, ties=scene), Energy(scene, chain, rest.q)
    np.testing.assert_allclose(np.sort(-(found.eigenvalues**2).real), other.squares(rest.q), rtol=2e-8)
    np.testing.assert_allclose(other.gaps(rest.q)[1][other.held] @ found.shapes.T, 0.0, atol=1e-11)


@pytest.mark.parametrize(("seed", "more"), [(6, {}), (11, {}), (2, SPRUNG), (35, {})])
def test_random_arms_rest_at_the_least_energy(seed: int, more: dict) -> None:
    scene = random_arm(seed, **more)
    chain, rest = at_rest(scene)
    other, q, S = Energy(scene, chain, rest.q), rest.q, 1 / np.sqrt(chain.stiffness + 1)
    held = {
        "type": "eq", "fun": lambda y: other.gaps(q + S * y)[0][other.held],
        "jac": lambda y: other.gaps(q + S * y)[1][other.held] * S,
    }  # fmt: skip
    least = minimize(
        lambda y: other.value(q + S * y) - other.value(q), 0.02 * np.random.default_rng(seed).normal(size=chain.n),
        jac=lambda y: S * other.slope(q + S * y), constraints=[held] if len(other.held) else [], method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 500},
    )  # fmt: skip
    np.testing.assert_allclose(S * least.x, 0.0, atol=1e-6)
    np.testing.assert_allclose(other.balance(q), 0.0, atol=1e-10)


def test_rows_near_a_singular_posture_are_closed_at_rest() -> None:
    """One of a hinge's five independent rows, which the springs' bending alone opens, has a slope of 2e-5."""
    scene = random_arm(31)
    chain, rest = at_rest(scene)
    g, J, _ = gaps(tie_rows(scene, chain), chain, rest.q)
    assert 1e-6 < np.linalg.svd(J, compute_uv=False)[4] < 1e-4
    np.testing.assert_allclose(g, 0.0, atol=1e-13)


def crane(flex: dict, k: float, foot: np.ndarray, length: float) -> fl.Scene:
    """A boom of 10 m at 20°, hinged at its root, on a cylinder at 3 m."""
    links = [{"length": 3.0, **flex}, {"length": 7.0, **flex, "joint": {"axis": [0, -1, 0], "locked": True}}]
    own = {"name": "c", "kind": "distance", "link": "l1", "stiffness": k, "length": length}
    return arm(*links, ties=[own | {"to": {"point": foot.tolist()}}], start=[20.0, 0.0])


IN_LINE = {"name": "rod", "kind": "distance", "link": "l1", "length": 0.6, "to": {"point": [1.0, 0.0, 0.0]}}
FLAT = {"name": "pin", "kind": "point", "link": "l3", "to": {"point": [1.0, 0.0, 0.0]}}


@pytest.mark.parametrize(
    "scene",
    [arm({"length": 0.4, **BENDS}, ties=[IN_LINE], start=[0.0]),
     arm({"length": 0.4}, {"length": 1.0}, {"length": 0.4}, ties=[FLAT], start=[0.0, 0.0, 180.0])],
    ids=["rod in line", "flat parallelogram"],
)  # fmt: skip
def test_small_motion_at_a_singular_posture_warns(scene: fl.Scene) -> None:
    chain = fl.Problem(scene).chain
    with pytest.warns(RuntimeWarning) as warned:
        fl.modes(chain, fl.initial_state(scene, chain)[0], ties=scene)
    reviewed("singular-ties", str(warned[0].message))


def test_a_mechanism_with_more_bearings_than_it_needs_has_modes_without_a_warning() -> None:
    chain = fl.Problem(bricard()).chain
    q = fl.initial_state(bricard(), chain)[0]
    assert len(fl.modes(chain, q, ties=bricard()).eigenvalues) == 1  # of a pair


def test_a_rigid_boom_swings_on_its_cylinder_with_the_frequency_of_the_closed_form() -> None:
    """J ω² = −m g L/2 sin θ + k l'² + k (l − l₀) l''."""
    k, foot, m = 20.0, np.array([0.3, 0.0, -2.0]), 1200 * 0.012 * 0.03 * 10
    scene = crane({}, k, foot, 3.0)
    chain, rest = at_rest(scene)
    c, s = np.cos(rest.q[0]), np.sin(rest.q[0])
    p, turned = 3 * np.array([c, 0, s]), 3 * np.array([-s, 0, c])
    far = np.linalg.norm(p - foot)
    u = (p - foot) / far
    bent = (turned @ turned - (u @ turned) ** 2) / far - u @ p
    stiffness = -m * 9.81 * 5 * s + k * (u @ turned) ** 2 + k * (far - 3.0) * bent
    ω = fl.modes(chain, rest.q, ties=scene).frequencies[0]
    assert ω == pytest.approx(np.sqrt(stiffness / (m * (100 / 3 + 0.012**2 / 12))), rel=1e-12)
    assert rest.tie_forces["c"] == pytest.approx(k * (far - 3.0), rel=1e-12)


def test_a_bending_boom_swings_on_its_cylinder_like_a_beam_on_a_spring() -> None:
    """w'''' = β⁴ w of both parts, with w = w'' = 0 at the root, E I [w'''] = k w at the cylinder, w'' = w''' = 0."""
    E, h, k, (c, s) = 1e14, 0.003, 1e4, (np.cos(np.radians(20)), np.sin(np.radians(20)))  # thin: no rotary inertia
    more = {"material.steel.young": E, "section.thin.height": h, "gravity": [0, 0, 0], "material.steel.loss_time": 0}
    foot = np.array([3 * c + 2 * s, 0, 3 * s - 2 * c])
    scene = crane({"flex": "z", "segments": 17}, k, foot, 2.0).varied(more)
    EI, ρA = E * 0.03 * h**3 / 12, 1200 * 0.03 * h

    def determinant(ω: float) -> float:
        β = (ρA * ω**2 / EI) ** 0.25

        def row(x: float, d: int) -> np.ndarray:
            s, c, S, C = np.sin(β * x), np.cos(β * x), np.sinh(β * x), np.cosh(β * x)
            return np.array(([s, c, S, C], [c, -s, C, S], [-s, -c, S, C], [-c, s, C, S])[d])

        joined = [np.concatenate([row(3.0, d)[::2], -row(3.0, d)]) for d in range(4)]
        joined[3][:2] -= k / (EI * β**3) * row(3.0, 0)[::2]
        A = np.array([*joined, [0, 0, *row(10.0, 2)], [0, 0, *row(10.0, 3)]])
        return float(np.linalg.det(A / np.abs(A).max(axis=1)[:, None]))

    chain, rest = at_rest(scene)
    ω = fl.modes(chain, rest.q, ties=scene, count=1).frequencies[0]
    assert brentq(determinant, 0.99 * ω, 1.01 * ω, xtol=1e-13) == pytest.approx(ω, rel=1e-6)


def motion_of(model: fl.LinearModel, scene: fl.Scene, chain: fl.Chain, q: np.ndarray, tau: np.ndarray) -> Callable:
    """q, q̇ and q̈ (n,) that the ties allow, as a function of the states of a linear model about q."""
    ties, m = tie_rows(scene, chain), len(model.x) // 2
    exact = np.isinf(ties[0]["stiffness"])
    kept = np.array([chain.joint_names.index(name.split()[1]) for name in model.states[:m]])
    other = np.setdiff1d(np.arange(chain.n), kept)

    def motion(x: np.ndarray, more: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at, v = q.copy(), np.zeros(chain.n)
        at[kept], v[kept] = x[:m], x[m:]
        for _ in range(20):
            g, J = (each[exact] for each in gaps(ties, chain, at)[:2])
            at[other] -= np.linalg.lstsq(J[:, other], g, rcond=1e-10)[0]
        v[other] = -np.linalg.lstsq(J[:, other], J[:, kept] @ x[m:], rcond=1e-10)[0]
        return at, v, tied_acceleration(ties, chain, 0.0, at, v, fl.forward_dynamics(chain, at, v, tau + more))[0]

    motion.kept = kept
    return motion


@pytest.mark.parametrize("scene", [fourbar(**BENDS), touching(), random_arm(11)], ids=["loop", "touching", "redundant"])
def test_a_linear_model_has_the_eigenvalues_of_modes_and_the_slopes_of_accelerations(scene: fl.Scene) -> None:
    """The states are coordinates, from which ties give the others; also at a posture and torques out of balance."""
    chain, rest = at_rest(scene)
    own = fl.linearize(chain, rest.q, tau=rest.tau, ties=scene)
    λ = fl.modes(chain, rest.q, ties=scene).eigenvalues
    np.testing.assert_allclose(np.sort(np.abs(own.eigenvalues))[::2], np.sort(np.abs(λ)), rtol=1e-8)
    tau, q = np.eye(chain.n)[0], fl.initial_state(scene, chain)[0]
    model = fl.linearize(chain, q, tau=tau, ties=scene, outputs=("state",))
    motion, m = motion_of(model, scene, chain, q, tau), len(model.x) // 2

    def rate(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[m:], motion(x)[2][motion.kept]])

    A = np.array([(rate(model.x + e) - rate(model.x - e)) / 2e-5 for e in 1e-5 * np.eye(2 * m)]).T
    np.testing.assert_allclose(model.A, A, atol=1e-6 * np.abs(A).max())
    np.testing.assert_allclose(model.rate, rate(model.x), atol=1e-9 * np.abs(model.rate).max())
    np.testing.assert_allclose(model.y, np.concatenate([q, 0 * q]), atol=1e-14)


def test_sensors_of_a_loop_are_outputs_of_its_linear_model() -> None:
    """C and D are differences of the signals along motions that the ties allow; a filter adds a state."""
    sensors = [
        {"name": "a", "kind": "accelerometer", "link": "l2", "x": 0.5},
        {"name": "g", "kind": "gyroscope", "link": "l3"},
        {"name": "e", "kind": "strain", "link": "l2", "x": 0.3, "fibre": [0.006, 0.0]},
    ]  # fmt: skip
    scene = fourbar(**BENDS).varied({"sensor": sensors})
    chain = fl.Problem(scene).chain
    q, tau = fl.initial_state(scene, chain)[0], np.eye(chain.n)[0]
    model = fl.linearize(chain, q, tau=tau, ties=scene, outputs=(fl.small_motion.SensorOutputs(scene),))
    motion, m = motion_of(model, scene, chain, q, tau), len(model.x)

    def seen(x: np.ndarray, more: np.ndarray | float = 0.0) -> np.ndarray:
        at, v, qdd = (part[None] for part in motion(x, more))
        run = SimpleNamespace(chain=chain, q=at, qd=v, qdd=qdd, tau=tau[None])
        return np.concatenate([signal_of(sensor, scene, run)[:, 0] for sensor in scene.sensor])

    C = np.array([(seen(model.x + e) - seen(model.x - e)) / 2e-5 for e in 1e-5 * np.eye(m)]).T
    D = np.array([seen(model.x, e) - seen(model.x, -e) for e in np.eye(chain.n)[chain.active] / 2]).T
    np.testing.assert_allclose(model.C, C, atol=1e-6 * np.abs(C).max())
    np.testing.assert_allclose(model.D, D, atol=1e-9 * np.abs(D).max())
    np.testing.assert_allclose(model.y, seen(model.x), atol=1e-9 * np.abs(model.y).max())
    late = scene.varied({"sensor.g.low_pass": 20.0})
    slow = fl.linearize(chain, q, tau=tau, ties=late, outputs=(fl.small_motion.SensorOutputs(late),))
    rest = [each.frequency_response([0.0]) for each in (slow, model)]
    np.testing.assert_allclose(*rest, atol=1e-9 * np.abs(rest).max())


def test_a_small_swing_has_the_frequency_of_its_mode() -> None:
    scene = fourbar(**BENDS).varied({"material.steel.loss_time": 0.0})
    chain, rest = at_rest(scene)
    found = fl.modes(chain, rest.q, ties=scene)
    φ, ω = found.shapes[1], found.frequencies[1]
    run = fl.simulate(scene, q0=rest.q, qd0=1e-4 * ω * φ, duration=300 * 0.1 / ω, sample=0.1 / ω, tolerance=1e-8)
    zeros = CubicSpline(run.t, (run.q - rest.q) @ fl.mass_matrix(chain, rest.q) @ φ).roots(extrapolate=False)
    assert np.pi / np.diff(zeros[zeros > 0.5 / ω]).mean() == pytest.approx(ω, rel=1e-4)


def test_a_locked_crank_leaves_elastic_modes_and_an_exact_rod_carries_its_load(tmp_path: Path) -> None:
    scene = fourbar(**BENDS)
    chain, rest = at_rest(scene)
    held = fl.solve_static(chain, rest.q, locked=["l1"], ties=scene)
    assert held.tau[0] == pytest.approx(0.0, abs=1e-9)
    assert set(fl.modes(chain, rest.q, locked=["l1"], ties=scene).kinds) == {"elastic"}
    rigid = arm({"length": 1.0}, ties=[rod(link="l1", length=0.5, to={"point": [1.0, 0.0, 0.5]})], start=[0.0])
    chain, rest = at_rest(rigid)
    assert rest.tie_forces["pin"] == pytest.approx(1200 * 0.012 * 0.03 * 9.81 / 2, rel=1e-12)  # a pull
    assert Equilibrium.load(rest.save(tmp_path / "rest.npz")).tie_forces == rest.tie_forces
    with refused(fl.errors.ArgumentError, "nothing-to-move"):
        fl.modes(chain, rest.q, ties=rigid)


def test_the_command_prints_modes_of_an_arm_with_ties(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(fourbar(**BENDS).varied({"initial.passive": "static"}).save(tmp_path / "fourbar.toml"))
    assert main(["modes", path]) == 0
    assert "1.1158" in capsys.readouterr().out
    assert main(["modes", path, "--rate", "l1=1rad/s"]) == 2


def test_rates_with_ties_and_sensors_on_ties_are_refused() -> None:
    scene = fourbar().varied({"sensor": [{"name": "pin", "kind": "force", "tie": "pin"}]})
    chain, rest = at_rest(fourbar())
    with refused(fl.errors.ArgumentError, "sensor-of-tie"):
        fl.linearize(chain, rest.q, ties=scene, outputs=(fl.small_motion.SensorOutputs(scene),))
    for call in (fl.modes, fl.solve_static, fl.linearize):
        with refused(fl.errors.ArgumentError, "both-given"):
            call(chain, rest.q, [1.0, 0.0, 0.0], ties=scene)
