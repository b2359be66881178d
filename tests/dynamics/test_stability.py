"""Stable steps against published stability limits, and coefficients of the stability polynomial."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from scipy import linalg

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.describe.schemes import methods
from flexlink.dynamics.forces import Gains
from flexlink.dynamics.vibration import stability
from flexlink.dynamics.vibration.stability import eigenvalues, fastest_eigenvalues, stable_step_of
from flexlink.dynamics.vibration.stability_function import stability_function, stability_polynomials
from flexlink.motion.inputs.drives import drive_arrays, gains_of
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.conftest import flexible, make_scene
from tests.support.words import refused

IMAGINARY_LIMIT = {  # largest y with |R(iy')| ≤ 1 + 1e-6 for all y' ≤ y
    "RK2": 0.05318296562,
    "RK3": 1.732053117,
    "RK4": 2.828427522,
    "RK10": 1.188515114,
    "DOPRI5": 0.9992227884,
    "DOP853": 5.960360364,
}
REAL_LIMIT = {
    "RK2": 2.0, "RK3": 2.512745327, "RK4": 2.785293563, "RK10": 2.704679068, "DOPRI5": 3.306567893,
    "DOP853": 6.393652095,
}  # fmt: skip


@pytest.mark.parametrize(("method", "limit"), IMAGINARY_LIMIT.items())
def test_the_stable_step_of_an_undamped_chain_equals_the_published_limit(models, method: str, limit: float) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    fastest = np.abs(eigenvalues(chain, np.zeros(10))).max()
    assert fl.stable_step(chain, method=method) * fastest == pytest.approx(limit, rel=1e-7)


@pytest.mark.parametrize(("method", "limit"), REAL_LIMIT.items())
def test_a_purely_damped_joint_meets_the_limit_on_the_real_axis(method: str, limit: float) -> None:
    joint = fl.Joint(viscous=8.0)
    scene = make_scene(fl.Link(name="a", joint=joint), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 2)), gravity=(0, 0, 0))
    assert fl.stable_step(fl.lump(scene), method=method) == pytest.approx(limit / 4.0, rel=1e-5)


@pytest.fixture
def chebyshev(tmp_path) -> str:
    """R(z) = T_5(1 + z/25), by k_i = f(y + h a_i k_i−1) and y + h k_5."""
    x = np.polynomial.Polynomial([1, 1 / 25])
    r = (16 * x**5 - 20 * x**3 + 5 * x).coef
    a = ["0", *(f"{r[k] / r[k - 1]:.17f}" for k in range(5, 1, -1))]
    A = [["0"] * (i - 1) + [a[i]] if i else [] for i in range(5)]
    method = {"about": "Chebyshev", "source": "-", "order": 1, "A": A, "b": ["0", "0", "0", "0", "1"], "c": a}
    (tmp_path / "chebyshev.toml").write_bytes(msgspec.toml.encode(method))
    return str(tmp_path / "chebyshev.toml")


def test_a_chebyshev_method_is_stable_up_to_twice_the_square_of_its_stages(chebyshev: str) -> None:
    """No method of 5 stages is stable over a longer interval (Markov)."""
    joint = fl.Joint(viscous=8.0)
    scene = make_scene(fl.Link(name="a", joint=joint), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 2)), gravity=(0, 0, 0))
    assert fl.stable_step(fl.lump(scene), method=chebyshev) == pytest.approx(50 / 4.0, rel=1e-5)


@pytest.mark.parametrize("slant", [0.01, 0.03, 0.1])
def test_no_step_below_the_stable_step_is_unstable(slant: float, chebyshev: str) -> None:
    """Near the real axis |R| slightly exceeds 1 at each extremum of T_5, and is below 1 between extrema."""
    λ = np.array([-1.0 + slant * 1j, -1.0 - slant * 1j])
    h = stable_step_of(λ, chebyshev)
    inside = np.linspace(0, h, 10_001)[:, None] * λ
    assert np.abs(stability_function(methods.method(chebyshev), inside)).max() <= 1 + 1.01e-6
    assert 4 < h < 5  # the first extremum: 25 (1 − cos 36°) = 4.8


@pytest.mark.parametrize("method", REAL_LIMIT)
def test_the_stability_polynomial_equals_the_exponential_up_to_the_order(method: str) -> None:
    table = methods.method(method)
    r, _ = stability_polynomials(table)
    np.testing.assert_allclose(
        np.array(r[: table.order + 1], dtype=float), [1 / math.factorial(k) for k in range(table.order + 1)], atol=1e-15
    )


def test_every_step_is_stable_with_radau_and_gauss(models) -> None:
    chain = fl.lump(fl.load_scene(models / "t3_spatial.toml"))
    for method in ("Radau5", "Radau9", "Gauss4", "Gauss6"):
        assert fl.stable_step(chain, method=method) == np.inf


def test_a_chain_without_springs_and_friction_has_no_stability_limit() -> None:
    scene = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0))
    assert fl.stable_step(fl.lump(scene), method="RK4") == np.inf


@pytest.mark.parametrize("damping", [None, fl.Damping(ratio=0.02, at_hz=5.0)])
@pytest.mark.parametrize("flex", ["z", "xyz"])
def test_the_order_n_algorithm_for_long_chains_gives_the_same_step(flex, damping, monkeypatch) -> None:
    chain = fl.lump(make_scene(*[flexible(name, flex, 12, damping=damping) for name in "ab"]))
    q = np.linspace(0.1, 0.2, chain.n)
    dense = fl.stable_step(chain, q, method="RK4")
    monkeypatch.setattr(stability, "DENSE", 0)
    # the step may be shorter by ω²/δ² = 1/(4ζ²) of an overdamped mode; the Lanczos method has an error of 1e-4
    assert dense * (1 - 1e-3) < fl.stable_step(chain, q, method="RK4") < dense * (1 + 1e-4)


def dense(chain: fl.Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """λ of all modes, ω² of K φ = ω² M φ and δ of D φ = δ M φ, by LAPACK; gravity is off."""
    n, M = chain.n, fl.mass_matrix(chain, q)
    K, D = chain.matrix("stiffness"), chain.matrix("damping")
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return linalg.eigvals(A), *(linalg.eigh(part, M, eigvals_only=True) for part in (K, D))  # type: ignore[return-value]


def weightless_pair(flex: str, damping: fl.Damping | None) -> tuple[fl.Chain, np.ndarray]:
    """Two links that bend about these axes; "cells" are in a plane and have coupled springs."""
    rule = {"lumping": "lobatto4", "segments": 5} if flex == "cells" else {"segments": 6}
    links = [flexible(name, flex.replace("cells", "z"), damping=damping, **rule) for name in "ab"]
    chain = fl.lump(make_scene(*links, gravity=(0.0, 0.0, 0.0)))
    return chain, np.linspace(0.1, 0.2, chain.n)


STRENGTHS = [None, fl.Damping(ratio=1e-4, at_hz=5.0), fl.Damping(ratio=0.05, at_hz=5.0)]  # the last mode is overdamped


@pytest.mark.parametrize("damping", STRENGTHS, ids=["undamped", "swinging", "creeping"])
@pytest.mark.parametrize("flex", ["z", "xyz", "cells"])
def test_the_largest_frequency_equals_the_largest_of_all_eigenvalues(flex, damping) -> None:
    chain, q = weightless_pair(flex, damping)
    λ, _, _ = dense(chain, q)
    assert np.abs(stability.fastest_eigenvalues(chain, q)).max() == pytest.approx(np.abs(λ).max(), rel=1e-9)


@pytest.mark.parametrize("damping", STRENGTHS, ids=["undamped", "swinging", "creeping"])
@pytest.mark.parametrize("flex", ["z", "xyz", "cells"])
def test_estimates_for_long_chains_include_the_largest_stiffness_and_damping(flex, damping, monkeypatch) -> None:
    """Each of the two is checked separately, within 1e-4 by Lanczos, because only one of them limits the step."""
    chain, q = weightless_pair(flex, damping)
    _, squares, brakes = dense(chain, q)
    monkeypatch.setattr(stability, "DENSE", 0)
    λ = stability.fastest_eigenvalues(chain, q)
    assert -λ.real.min() == pytest.approx(brakes.max(), rel=1e-3, abs=1e-12)
    assert λ.imag.max() == pytest.approx(np.sqrt(squares.max()), rel=1e-3)


UNLOADED = {"tip_wrench": np.zeros(6), "frame": "world"}


@pytest.mark.parametrize("turning", [0.0, 30.0])
@pytest.mark.parametrize("damping", STRENGTHS, ids=["undamped", "swinging", "creeping"])
@pytest.mark.parametrize("flex", ["z", "xyz", "cells"])
def test_no_eigenvalue_exceeds_the_bound_and_the_bound_is_not_too_wide(flex, damping, turning: float) -> None:
    """The Frobenius norm is at most √n times the largest eigenvalue; for an undamped chain, ω = √ω² gives √√n."""
    chain, q = weightless_pair(flex, damping)
    qd = np.where(np.arange(chain.n) == 0, turning, 0.0)
    kp, kd = np.zeros((2, chain.n))
    kp[chain.active], kd[chain.active] = 1e4, 1e2 if turning else 0.0
    for gains in (Gains(0 * kp, 0 * kd), Gains(kp, kd)):
        largest = np.abs(eigenvalues(chain, q, qd, gains=gains)).max()
        (bound,) = stability.eigenvalue_bounds([(chain, q, qd)], [{**UNLOADED, "gains": gains}])
        assert largest <= bound <= (2 * chain.n**0.5 if damping or turning else 1.01 * chain.n**0.25) * largest


def test_long_chains_have_no_finite_eigenvalue_bound(monkeypatch) -> None:
    chain, q = weightless_pair("z", None)
    monkeypatch.setattr(stability, "DENSE", chain.n - 1)
    still = np.zeros(chain.n)
    unloaded = {**UNLOADED, "gains": Gains(still, still)}
    assert stability.eigenvalue_bounds([(chain, q, still)], [unloaded]) == [np.inf]


LONG = {  # chains by the loads that act on them
    "gravity": {"gravity": (0.0, 1e6, 0.0)},
    "gravity that stiffens nothing": {"gravity": (0.0, 1e7, 0.0), "bend": 0.0},
    "a pull": {"tip_wrench": np.array([1e6, 0, 0, 0, 0, 0])},
    "stiff servos": {"gains": 1e8},
    "a prescribed joint": {"prescribed": 1},
}


@pytest.mark.parametrize("what", LONG)
def test_estimates_for_long_and_short_chains_agree_under_all_loads(what: str, monkeypatch) -> None:
    acts = dict(LONG[what])
    gravity, prescribed = acts.pop("gravity", (0.0, 0.0, 0.0)), acts.pop("prescribed", 0)
    bend = acts.pop("bend", 0.1)
    links = flexible("a", "yz", 5), flexible("b", "z", 3, joint=fl.Joint(armature=1e-6))
    chain = fl.lump(make_scene(*links, gravity=gravity))
    hinges = chain.hinges.copy()
    hinges["prescribed"][chain.active[1]] = prescribed
    if prescribed:
        hinges["stiffness"][chain.active[1]] = 1e9  # has no effect, since the joint is prescribed
    chain, q = dataclasses.replace(chain, hinges=hinges), np.linspace(bend, 2 * bend, chain.n)
    if "gains" in acts:
        kp, kd = np.zeros((2, chain.n))
        kp[chain.active] = acts["gains"]
        acts["gains"] = Gains(kp, kd)
    every = np.abs(eigenvalues(chain, q, **acts)).max()
    monkeypatch.setattr(stability, "DENSE", 0)
    assert np.abs(fastest_eigenvalues(chain, q, **acts)).max() == pytest.approx(every, rel=1e-3)


def test_a_slow_oscillation_limits_the_step_of_rk2_despite_fast_damping() -> None:
    """λ = −100 alone would allow a step of 2/100, but λ = ±10i allow only 0.0532/10."""
    λ = np.array([-100.0, 10j, -10j])
    assert stable_step_of(λ, "RK2") == pytest.approx(IMAGINARY_LIMIT["RK2"] / 10, rel=1e-7)


def test_a_step_too_large_for_a_long_damped_chain_is_refused_at_once() -> None:
    links = [flexible(name, "z", 500, damping=fl.Damping(ratio=0.02, at_hz=5.0)) for name in "ab"]
    scene = make_scene(*links, gravity=(0.0, 9.81, 0.0))
    with refused(fl.errors.UnstableStepError, "unstable-step"):
        fl.simulate(scene, step=1e-4, sample=1e-3, duration=0.1)


LOCKED = fl.Joint(locked=True)
SITUATIONS = {
    "pulled by 1e5 N": lambda: make_scene(
        flexible("a", "z", 5, joint=LOCKED), gravity=(0, 0, 0), wrench=fl.Wrench(force=(1e5, 0, 0))
    ),
    "pushed, 0.95 of buckling": lambda: pushed(0.95),
    "a heavy payload": lambda: make_scene(
        flexible("a", "yz", 5, joint=LOCKED), gravity=(9.81, 0, 0), tip=fl.RigidBody(mass=1000.0)
    ),
    "hangs free": lambda: make_scene(flexible("a", "xyz", 4), flexible("b", "z", 3), gravity=(9.81, 0, 0)),
    "dry friction": lambda: make_scene(
        flexible("a", "z", 3, joint=fl.Joint(coulomb=200.0, armature=0.01)), gravity=(9.81, 0, 0)
    ),
    "stiff servo": lambda: make_scene(
        flexible("a", "z", 3, joint=fl.Joint(armature=1e-4)), gravity=(9.81, 0, 0),
        drive=fl.Drive(kind="pd", kp=(3e4,), kd=(2.0,), target_deg=(0.0,)),
    ),
    "strong servo damping": lambda: make_scene(
        flexible("a", "yz", 3, joint=fl.Joint(armature=1e-4)), gravity=(9.81, 0, 0),
        drive=fl.Drive(kind="pd", kp=(10.0,), kd=(300.0,), target_deg=(0.0,)),
    ),
}  # fmt: skip


def pushed(part: float) -> fl.Scene:
    scene = make_scene(flexible("a", "z", 5, joint=LOCKED), gravity=(0, 0, 0), wrench=fl.Wrench(force=(-1.0, 0, 0)))
    critical = fl.strength.buckling_loads(fl.lump(scene), tip_wrench=scene.tip_wrench)[0]
    return scene.varied({"wrench": fl.Wrench(force=(-part * float(critical), 0, 0))})


@pytest.mark.parametrize("situation", SITUATIONS)
def test_a_small_disturbance_grows_only_above_the_predicted_step(situation: str, rng) -> None:
    """About an equilibrium, nothing grows at 0.95 of the step, but a disturbance grows a hundredfold at 1.05."""
    scene = SITUATIONS[situation]()
    chain = fl.lump(scene)
    rest = np.zeros(chain.n)
    gains = gains_of(chain, drive_arrays(scene, chain), 0.0, rest, rest)
    h = fl.stable_step(chain, np.zeros(chain.n), method="RK4", tip_wrench=scene.tip_wrench, gains=gains)
    disturbance = 1e-9 * rng.standard_normal(chain.n)
    growth = []
    for step in (0.95 * h, 1.05 * h):
        run = fl.RunSettings(step=step, sample=200 * step, duration=200 * step, unstable="allow")
        problem = problem_of(scene.varied({"run": run}), chain)
        disturbed = dataclasses.replace(problem, q=problem.q + disturbance)
        try:
            growth.append(np.abs(SingleRun(disturbed).finish(Stop()).q[-1]).max() / np.abs(disturbance).max())
        except fl.errors.DivergenceError:
            growth.append(np.inf)
    assert growth[0] < 10
    assert growth[1] > 100
