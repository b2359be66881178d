"""Pinocchio and MuJoCo, from the exported files, give what flexlink gives."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest
from conftest import MODELS, ROOT, flexible, make_scene, nasty_scene, random_state
from numpy.testing import assert_allclose, assert_array_equal

from flexlink import (
    ArgumentError,
    Chain,
    DivergenceError,
    Drive,
    Initial,
    Joint,
    Link,
    MissingDependencyError,
    Mount,
    Scene,
    Wrench,
    load_scene,
)
from flexlink.engines import ENGINES, Engine, load

EPS = np.finfo(float).eps
OTHERS = [name for name in ENGINES if name != "native"]
STATES = 20

# Bars of the project: sums of some hundred rounded products, relative to the largest component.
MASS, TORQUE = 1e-13, 1e-12

both = pytest.mark.parametrize("name", OTHERS)


def difference(got: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference relative to the largest component."""
    return float(np.abs(got - wanted).max() / (np.abs(wanted).max() or 1.0))


def shortened(scene: Scene, duration: float, **run: object) -> Scene:
    """The scene's first moments."""
    return msgspec.structs.replace(scene, run=msgspec.structs.replace(scene.run, duration=duration, **run))


def rounding_bound(scene: Scene) -> float:
    """Half t² times the error that one rounded linear solve, 10 eps cond(M), may make in the largest q̈ of the run."""
    native = load("native", scene.chain())
    t, q, qd = native.integrate(scene)
    qdd = np.abs(np.diff(qd, axis=0)).max() / scene.run.sample
    return t[-1] ** 2 / 2 * 10 * EPS * max(np.linalg.cond(native.mass_matrix(row)) for row in q[::10]) * qdd


@both
def test_mass_matrix_agrees(name: str, chain: Chain, rng: np.random.Generator) -> None:
    native, other = load("native", chain), load(name, chain)
    for _ in range(STATES):
        q, _ = random_state(chain, rng)
        M = other.mass_matrix(q)
        assert_array_equal(M, M.T)
        assert difference(M, native.mass_matrix(q)) <= MASS


TERMS: dict[str, Callable[[Engine, np.ndarray, np.ndarray, np.ndarray], np.ndarray]] = {
    "T_GC": lambda engine, q, qd, _: engine.bias_torque(q, qd),
    "T_GC with tip wrench": lambda engine, q, qd, wrench: engine.bias_torque(q, qd, wrench),
    "T_G": lambda engine, q, *_: engine.gravity_torque(q),
    "T_FL": lambda engine, q, *_: engine.elastic_torque(q),
    "T_FR": lambda engine, _, qd, __: engine.friction_torque(qd),
}


@both
@pytest.mark.parametrize("term", TERMS)
def test_torques_agree(name: str, term: str, chain: Chain, rng: np.random.Generator) -> None:
    native, other = load("native", chain), load(name, chain)
    for _ in range(STATES):
        q, qd = random_state(chain, rng)
        wrench = rng.uniform(-10, 10, 6)
        wanted = TERMS[term](native, q, qd, wrench)
        assert difference(TERMS[term](other, q, qd, wrench), wanted) <= TORQUE


@both
def test_accelerations_agree_as_far_as_the_condition_of_the_mass_matrix_lets_them(
    name: str, chain: Chain, rng: np.random.Generator
) -> None:
    native, other = load("native", chain), load(name, chain)
    for wrench in [None, *rng.uniform(-10, 10, (STATES, 6))]:
        q, qd = random_state(chain, rng)
        tau = rng.uniform(-10, 10, chain.n)
        wanted = native.forward_dynamics(q, qd, tau, wrench)
        bound = 10 * EPS * np.linalg.cond(native.mass_matrix(q))
        assert difference(other.forward_dynamics(q, qd, tau, wrench), wanted) <= bound


@both
def test_massless_bodies_with_offsets_and_turns_between_them_move_alike(name: str, rng: np.random.Generator) -> None:
    massless = [
        Link(name=f"gimbal {k}", length=0.1 * k, mount=Mount(xyz=(0.1, -0.2, 0.3), rpy_deg=(30.0 * k, 40.0, -50.0)))
        for k in range(3)
    ]
    chain = make_scene(*massless, flexible("arm", "xyz", mount=Mount(rpy_deg=(0.0, 60.0, 10.0)))).chain()
    native, other = load("native", chain), load(name, chain)
    for _ in range(STATES):
        q, qd = random_state(chain, rng)
        assert difference(other.mass_matrix(q), native.mass_matrix(q)) <= MASS
        assert difference(other.bias_torque(q, qd), native.bias_torque(q, qd)) <= TORQUE


@both
def test_armature_is_in_mass_matrix_and_accelerations(name: str, rng: np.random.Generator) -> None:
    arms = (make_scene(flexible("arm", joint=Joint(armature=armature))) for armature in (0.0, 2.0))
    without, heavy = (load(name, scene.chain()) for scene in arms)
    q = rng.uniform(-np.pi, np.pi, heavy.n)
    assert_allclose(heavy.mass_matrix(q) - without.mass_matrix(q), np.diag([2.0, 0, 0, 0, 0]), atol=MASS)
    tau, rest = np.ones(5), np.zeros(5)
    load_torque = tau - heavy.bias_torque(q, rest) - heavy.elastic_torque(q)
    qdd = heavy.forward_dynamics(q, rest, tau)
    M = heavy.mass_matrix(q)
    assert difference(qdd, np.linalg.solve(M, load_torque)) <= 10 * EPS * np.linalg.cond(M)


SHORT = {
    **{path.stem: shortened(load_scene(path), 0.1) for path in MODELS},
    "nasty": shortened(nasty_scene(), 0.02, step=2e-5, sample=1e-3),
    "wrench": shortened(make_scene(flexible("arm", "xyz"), wrench=Wrench((5, -3, 2), (1, 2, -3))), 0.02, step=2e-5),
    "table": shortened(
        make_scene(flexible("arm"), drive=Drive(kind="table", times=(0.0, 0.05, 0.1), torques=((0,), (9,), (-9,)))), 0.1
    ),
    "pd": shortened(
        make_scene(flexible("arm"), drive=Drive(kind="pd", kp=(50,), kd=(5,), target_deg=(30,))), 0.1
    ),
    "coulomb": shortened(
        make_scene(
            flexible("arm", joint=Joint(coulomb=3.0, viscous=0.1)), initial=Initial(joint_deg=(0.0,), rate_deg=(9.0,))
        ),
        0.1,
    ),
}  # fmt: skip


@both
@pytest.mark.parametrize("case", SHORT)
def test_short_trajectories_differ_by_rounding_only(name: str, case: str) -> None:
    scene = SHORT[case]
    chain = scene.chain()
    t, q, _ = load("native", chain).integrate(scene)
    t2, q2, _ = load(name, chain).integrate(scene)
    bound = rounding_bound(scene)
    assert bound < 1e-6 < np.abs(q - q[0]).max()  # the arm moves, by much more than the bound
    assert_array_equal(t2, t)
    assert_allclose(q2, q, rtol=0, atol=bound)


@pytest.mark.parametrize("method", ["RK2", "RK10"])
def test_pinocchio_runs_every_method(method: str) -> None:
    scene = shortened(load_scene(ROOT / "models" / "paper_fig5.toml"), 0.02, method=method)
    (_, q, _), (_, other, _) = (load(name, scene.chain()).integrate(scene) for name in ("native", "pinocchio"))
    assert_allclose(other, q, rtol=0, atol=rounding_bound(scene))


def test_mujoco_says_that_it_has_rk4_only() -> None:
    scene = shortened(make_scene(flexible("arm")), 0.01, method="RK10")
    with pytest.raises(ArgumentError, match=r"method = 'RK10'.*only 'RK4'"):
        load("mujoco", scene.chain()).integrate(scene)


@both
def test_an_unstable_run_is_an_error_that_keeps_its_samples_and_writes_no_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = shortened(load_scene(ROOT / "models" / "paper_fig5.toml"), 0.5, step=1e-3, sample=1e-3)
    with pytest.raises(DivergenceError, match=f"{name} is no longer finite at t = ") as caught:
        load(name, scene.chain()).integrate(scene)
    kept = caught.value.trajectory
    assert 1 <= len(kept.t) < 20 and np.isfinite(kept.q).all()
    assert list(tmp_path.iterdir()) == []


def test_mujoco_gives_the_process_its_callbacks_back() -> None:
    def mine(model: object, data: object) -> None:
        """Somebody else's callback."""

    scene = SHORT["coulomb"]
    unstable = shortened(scene, 0.5, step=1e-3, sample=1e-3)
    engine = load("mujoco", scene.chain())
    mujoco.set_mjcb_passive(mine)
    try:
        engine.integrate(scene)
        assert mujoco.get_mjcb_passive() is mine
        with pytest.raises(DivergenceError):
            engine.integrate(unstable)
        assert mujoco.get_mjcb_passive() is mine
        assert mujoco.get_mjcb_control() is None
    finally:
        mujoco.set_mjcb_passive(None)


@both
def test_an_engine_can_run_twice_and_answer_in_between(name: str) -> None:
    scene = SHORT["wrench"]
    engine = load(name, scene.chain())
    zero = np.zeros(engine.n)
    before, first = engine.forward_dynamics(zero, zero, zero), engine.integrate(scene)
    assert_array_equal(engine.forward_dynamics(zero, zero, zero), before)
    for one, two in zip(first, engine.integrate(scene), strict=True):
        assert_array_equal(one, two)


def test_an_unknown_engine_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ArgumentError, match=r"engine = 'bullet': unknown; allowed are native, pinocchio, mujoco"):
        load("bullet", make_scene(flexible("arm")).chain())


@both
def test_a_missing_engine_names_what_to_install(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, f"flexlink.engines.{name}", raising=False)
    with pytest.raises(MissingDependencyError, match=r"flexlink\[engines\]"):
        load(name, make_scene(flexible("arm")).chain())
