"""Of long chains: statics and the slowest modes in O(n), the same as by matrices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from beams import cantilever, thin_arm, thin_link
from conftest import ROOT

import flexlink as fl
from flexlink.dynamics.tangent import falls, stiffness_matrix, tangent
from flexlink.dynamics.vibration import lowest, modal
from flexlink.errors import ArgumentError, ConvergenceError, SingularMassError
from tests.words import refused

EPS = np.finfo(float).eps
COUNT = 8


def long_arm(hinges: int, flex: str = "z", **changes: object) -> fl.Scene:
    """The paper's two links with their two joints, and `count` hinges each at 1, 2 or 3 axes."""
    segments = {f"link.{link}.segments": hinges + 1 for link in ("upper", "fore")}
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    return scene.varied({"link.*.flex": flex, **segments, "link.*.lumping": "gauss", **changes})


def uneven(chain: fl.Chain) -> fl.Chain:
    """Dampers that are no multiple of the springs, so that no undamped mode is a mode."""
    hinges = chain.hinges.copy()
    hinges["damping"] = chain.stiffness * 1e-5 * np.linspace(0.2, 1.0, chain.n) + 0.3 * (chain.stiffness == 0)
    return dataclasses.replace(chain, hinges=hinges)


def hub(chain: fl.Chain, rate: float) -> dict[str, object]:
    rates = np.zeros(chain.n)
    rates[0] = rate
    return {"qd": rates, "locked": [0]}


def standing(chain: fl.Chain) -> dict[str, object]:
    posture = chain.rest.copy()
    posture[0] = np.pi / 2
    return {"q": posture}


WRENCH = [10.0, 20.0, -30.0, 1.0, 2.0, 3.0]
STATES = {
    "clamped": lambda chain: {"locked": chain.active},
    "hanging": lambda chain: {"q": -standing(chain)["q"]},
    "standing": standing,
    "dead load": lambda chain: {"locked": chain.active, "tip_wrench": WRENCH},
    "follower": lambda chain: {"locked": chain.active, "tip_wrench": WRENCH, "frame": "tip"},
    "turning": lambda chain: hub(chain, 3.0),
}


@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("flex, hinges", [("z", 18), ("yz", 8), ("xyz", 6)])
def test_the_slowest_modes_are_those_of_all(
    flex: str, hinges: int, state: str, damped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """λ as far as all modes have it, eps times the fastest of the chain (its square where loads have no potential)."""
    monkeypatch.setattr(modal, "DENSE", 30)  # all modes of longer chains take a second each
    chain = fl.lump(long_arm(hinges, flex))
    chain = uneven(chain) if damped else chain
    given = STATES[state](chain)
    every, few = fl.modes(chain, **given), fl.modes(chain, **given, count=COUNT)
    assert len(few.eigenvalues) == COUNT
    λ, fastest = every.eigenvalues[:COUNT], np.abs(every.eigenvalues).max()
    open_ = np.maximum(100 * EPS * fastest, 1e-9 * np.abs(λ)) + every.rounding[:COUNT]
    assert (np.abs(few.eigenvalues - λ) <= open_).all()
    assert (few.kinds, few.stable) == (every.kinds[:COUNT], every.stable)
    apart = np.abs(np.subtract.outer(every.eigenvalues, λ))
    apart[np.arange(COUNT), np.arange(COUNT)] = np.inf
    alone = apart.min(axis=0) > 1e-3 * np.abs(λ)  # two that swing as fast may mix
    one, other = every.shapes[:COUNT], few.shapes
    along = np.abs(np.einsum("mi,mi->m", one.conj(), other))
    assert (along / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1) > 1 - 1e-12)[alone].all()
    assert few.elastic_shares[alone] == pytest.approx(every.elastic_shares[:COUNT][alone], abs=1e-7)


@pytest.mark.slow
def test_the_slowest_modes_keep_their_relative_accuracy() -> None:
    """Rayleigh's quotient of each shape is its ω², though the fastest ω² of the chain is 1e8 times as large."""
    chain = fl.lump(long_arm(60))
    for state in ({"locked": chain.active}, standing(chain)):
        found = fl.modes(chain, **state, count=COUNT)
        q, φ = state.get("q", chain.rest), found.shapes.real.astype(np.longdouble)
        K = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6)).astype(np.longdouble)
        M = fl.mass_matrix(chain, q, algorithm="upper").astype(np.longdouble)
        square = np.einsum("mi,ij,mj->m", φ, K, φ) / np.einsum("mi,ij,mj->m", φ, M, φ)
        assert -(found.eigenvalues**2).real == pytest.approx(square.astype(float), rel=1e-11)


@pytest.mark.slow
def test_a_mode_that_the_start_does_not_contain_is_missed_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A straight arm bends in two independent planes; the first test is for one of them."""
    chain, times = fl.lump(long_arm(30, "yz", gravity=[0.0, 0.0, 0.0])), []
    bent = lowest.Subspace.bent

    def blind(self: lowest.Subspace, dice: np.random.Generator, count: int) -> np.ndarray:
        times.append(count)
        return bent(self, dice, count) * ((chain.hinges["axis"] == 2) if len(times) == 1 else 1.0)

    wanted = fl.modes(chain, locked=chain.active, count=4).eigenvalues
    monkeypatch.setattr(lowest.Subspace, "bent", blind)
    found = fl.modes(chain, locked=chain.active, count=4).eigenvalues
    assert len(times) == 2
    assert found == pytest.approx(wanted, rel=1e-12)


def test_joints_that_nothing_holds_rest_also_in_a_long_chain() -> None:
    chain = fl.lump(long_arm(60, gravity=[0.0, 0.0, 0.0]))
    found = fl.modes(chain, count=5)
    assert (found.eigenvalues[:2] == 0).all()
    assert found.kinds == ("rigid", "rigid", "elastic", "elastic", "elastic")
    assert found.stable


@pytest.mark.slow
def test_fast_modes_beside_joints_that_nothing_holds_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two joints rest, the others' ω² goes up to 1e8: not by all modes."""
    monkeypatch.setattr(modal, "_all", lambda _: pytest.fail("by matrices"))
    chain = fl.lump(long_arm(400))
    found = fl.modes(chain, count=10)
    assert (found.eigenvalues == 0).tolist() == [True] * 2 + [False] * 8
    assert found.frequencies[-1] > 5e3


def test_a_joint_without_inertia_is_named_also_in_a_long_chain() -> None:
    chain = fl.lump(long_arm(60))
    bodies = chain.bodies.copy()
    bodies["mass"][-3:] = 0.0
    bodies["inertia"][-3:] = 0.0
    idle = dataclasses.replace(chain, bodies=bodies)
    for count in (None, 3):
        with refused(SingularMassError, "joint-without-inertia"):
            fl.modes(idle, count=count)


@pytest.mark.slow
def test_where_the_iteration_ends_without_them_modes_come_from_all(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = fl.lump(long_arm(52))
    wanted = fl.modes(chain, locked=chain.active).eigenvalues[:3]
    monkeypatch.setattr(modal, "lowest", lambda *_: None)
    np.testing.assert_array_equal(fl.modes(chain, locked=chain.active, count=3).eigenvalues, wanted)


def test_of_a_short_chain_the_slowest_modes_are_the_first_of_all_to_the_bit() -> None:
    chain = fl.lump(fl.load_scene(ROOT / "models" / "t3_spatial.toml"))
    every = fl.modes(chain)
    for count in (1, 5, 1000):
        few = fl.modes(chain, count=count)
        np.testing.assert_array_equal(few.shapes, every.shapes[:count])
        np.testing.assert_array_equal(few.paths, every.paths[:count])
        assert few.kinds == every.kinds[:count]
    for wrong in (0, 2.5, "all"):
        with pytest.raises(ArgumentError, match="count"):
            fl.modes(chain, count=wrong)


def test_a_long_column_is_stable_up_to_greenhill_s_weight() -> None:
    """(q l³ / EI) = 7.837: stable below, not above; the tangent's own eigenvalues need n³ for that."""
    for weight, stands in ((7.83, True), (7.85, False)):
        column = cantilever("gauss", 300, gravity=(-weight, 0.0, 0.0))
        assert fl.solve_static(column).stable is stands


@pytest.mark.parametrize("flex, hinges", [("z", 500), ("xyz", 166)])
def test_a_long_arm_bends_as_one_of_fewer_hinges(flex: str, hinges: int) -> None:
    """The static tip converges with the square of the number of hinges, and no torque is left over."""

    def rest(hinges: int) -> tuple[np.ndarray, fl.dynamics.equilibrium.Equilibrium]:
        scene = long_arm(hinges, flex, gravity=[0.0, 0.0, 200.0])
        chain = fl.lump(scene)
        found = fl.solve_static(chain, locked=chain.active, tip_wrench=[0, 0, 40.0, 0, 0, 0], frame="tip")
        return fl.tip_position(chain, found.q), found

    (coarse, _), (middle, _), (fine, found) = (rest(n) for n in (20, 40, hinges))
    assert found.stable
    assert found.residual <= 1e-8
    assert np.abs(middle - fine).max() <= 0.3 * np.abs(coarse - fine).max()


@pytest.mark.slow
def test_what_falls_under_a_load_without_potential_falls_also_in_a_long_chain(rng: np.random.Generator) -> None:
    """Moments in space and follower forces about a column's critical load, π²/4: by all eigenvalues, and by one."""
    column = thin_arm(thin_link("midpoint", 36, flex="xyz"))
    zero, every, found = np.zeros(column.n), np.arange(column.n), []
    for force in np.linspace(2.0, 3.0, 8):
        wrench = np.array([-force, 0, 0, *rng.uniform(-0.5, 0.5, 3)])
        for follower in (False, True):
            q = rng.uniform(-1e-3, 1e-3, column.n)
            found.append(falls(column, q, zero, wrench, every, follower))
            assert found[-1] == tangent(column, q, zero, wrench, every, follower).falls
    assert {True, False} == set(found)


@pytest.mark.slow
def test_a_long_arm_that_nothing_can_hold_is_refused() -> None:
    chain = thin_arm(thin_link("gauss", 200, free=True))
    with refused(ConvergenceError, "no-equilibrium"):
        fl.solve_static(chain, tau=np.eye(chain.n)[0])
