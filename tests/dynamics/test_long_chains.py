"""Statics and lowest modes of long chains in O(n) agree with dense matrices."""

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.tangent import LoadedState, falls, stiffness_matrix, tangent
from flexlink.dynamics.vibration import eigenproblem, modal
from flexlink.errors import ArgumentError, ConvergenceError, SingularMassError
from tests.conftest import ROOT
from tests.support.beams import cantilever, thin_arm, thin_link
from tests.support.words import refused

EPS = np.finfo(float).eps
COUNT = 8


def long_arm(hinges: int, flex: str = "z", **changes: object) -> fl.Scene:
    """The paper's two links with their two joints, and `hinges` hinge points per link with 1, 2 or 3 axes each."""
    segments = {f"link.{link}.segments": hinges + 1 for link in ("upper", "fore")}
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    return scene.varied({"link.*.flex": flex, **segments, "link.*.lumping": "gauss", **changes})


def uneven(chain: fl.Chain) -> fl.Chain:
    """The chain with non-proportional dampers, so that damped modes differ from undamped ones."""
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
@pytest.mark.parametrize("flex, hinges, rule", [("z", 18, "gauss"), ("yz", 8, "lobatto4"), ("xyz", 6, "gauss")])
def test_the_slowest_modes_agree_with_the_full_eigensolution(flex, hinges, rule, state, damped, monkeypatch) -> None:
    """λ agrees to 100 eps times the fastest λ, or to 1e-9 of λ, plus the rounding error of the full solution."""
    monkeypatch.setattr(modal, "DENSE", 30)  # computing all modes of longer chains takes a second
    chain = fl.lump(long_arm(hinges, flex, **{"link.*.lumping": rule}))
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
    alone = apart.min(axis=0) > 1e-3 * np.abs(λ)  # two modes of equal frequency may mix
    one, other = every.shapes[:COUNT], few.shapes
    along = np.abs(np.einsum("mi,mi->m", one.conj(), other))
    assert (along / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1) > 1 - 1e-12)[alone].all()
    assert few.elastic_shares[alone] == pytest.approx(every.elastic_shares[:COUNT][alone], abs=1e-7)


@pytest.mark.slow
def test_the_slowest_modes_keep_their_relative_accuracy() -> None:
    """The Rayleigh quotient of each mode shape equals ω², although the highest ω² is 1e8 times as large."""
    chain = fl.lump(long_arm(60))
    for state in ({"locked": chain.active}, standing(chain)):
        found = fl.modes(chain, **state, count=COUNT)
        q, φ = state.get("q", chain.rest), found.shapes.real.astype(np.longdouble)
        K = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6)).astype(np.longdouble)
        M = fl.mass_matrix(chain, q, algorithm="upper").astype(np.longdouble)
        square = np.einsum("mi,ij,mj->m", φ, K, φ) / np.einsum("mi,ij,mj->m", φ, M, φ)
        assert -(found.eigenvalues**2).real == pytest.approx(square.astype(float), rel=1e-11)


@pytest.mark.slow
def test_a_mode_missing_from_the_start_vectors_is_detected_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A straight arm bends in two independent planes, but the first start vectors bend in only one of them."""
    chain, times = fl.lump(long_arm(30, "yz", gravity=[0.0, 0.0, 0.0])), []
    bent = eigenproblem.Subspace.bent

    def blind(self: eigenproblem.Subspace, dice: np.random.Generator, count: int) -> np.ndarray:
        times.append(count)
        return bent(self, dice, count) * ((chain.hinges["axis"] == 2) if len(times) == 1 else 1.0)

    wanted = fl.modes(chain, locked=chain.active, count=4).eigenvalues
    monkeypatch.setattr(eigenproblem.Subspace, "bent", blind)
    found = fl.modes(chain, locked=chain.active, count=4).eigenvalues
    assert len(times) == 2
    assert found == pytest.approx(wanted, rel=1e-12)


def test_unrestrained_joints_of_a_long_chain_give_rigid_modes() -> None:
    chain = fl.lump(long_arm(60, gravity=[0.0, 0.0, 0.0]))
    found = fl.modes(chain, count=5)
    assert (found.eigenvalues[:2] == 0).all()
    assert found.kinds == ("rigid", "rigid", "elastic", "elastic", "elastic")
    assert found.stable


@pytest.mark.slow
def test_fast_modes_are_found_in_chains_with_unrestrained_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rigid modes, and others with ω² up to 1e8, are found without computing all modes."""
    monkeypatch.setattr(modal, "_all", lambda _: pytest.fail("by matrices"))
    chain = fl.lump(long_arm(400))
    found = fl.modes(chain, count=10)
    assert (found.eigenvalues == 0).tolist() == [True] * 2 + [False] * 8
    assert found.frequencies[-1] > 5e3


def test_a_joint_without_inertia_in_a_long_chain_is_named() -> None:
    chain = fl.lump(long_arm(60))
    bodies = chain.bodies.copy()
    bodies["mass"][-3:] = 0.0
    bodies["inertia"][-3:] = 0.0
    idle = dataclasses.replace(chain, bodies=bodies)
    for count in (None, 3):
        with refused(SingularMassError, "joint-without-inertia"):
            fl.modes(idle, count=count)


@pytest.mark.slow
def test_if_the_iteration_fails_modes_come_from_the_full_eigensolution(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = fl.lump(long_arm(52))
    wanted = fl.modes(chain, locked=chain.active).eigenvalues[:3]
    monkeypatch.setattr(modal, "lowest", lambda *_: None)
    np.testing.assert_array_equal(fl.modes(chain, locked=chain.active, count=3).eigenvalues, wanted)


def test_the_slowest_modes_of_a_short_chain_equal_the_first_of_all_modes_exactly() -> None:
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


def test_a_long_column_is_stable_up_to_the_greenhill_weight() -> None:
    """The column is stable below q l³ / EI = 7.837 only; eigenvalues of the tangent matrix would cost O(n³)."""
    for weight, stands in ((7.83, True), (7.85, False)):
        column = cantilever("gauss", 300, gravity=(-weight, 0.0, 0.0))
        assert fl.solve_static(column).stable is stands


@pytest.mark.parametrize("flex, hinges", [("z", 500), ("xyz", 166)])
def test_the_static_tip_of_an_arm_converges_with_the_number_of_hinges(flex: str, hinges: int) -> None:
    """The static tip converges with the square of the number of hinges, and the residual torque vanishes."""

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
def test_instability_under_nonconservative_loads_is_found_in_long_chains(rng: np.random.Generator) -> None:
    """Near a column's critical load, π²/4, with moments and follower forces, `falls` agrees with all eigenvalues."""
    column = thin_arm(thin_link("midpoint", 36, flex="xyz"))
    zero, every, found = np.zeros(column.n), np.arange(column.n), []
    for force in np.linspace(2.0, 3.0, 8):
        wrench = np.array([-force, 0, 0, *rng.uniform(-0.5, 0.5, 3)])
        for follower in (False, True):
            q = rng.uniform(-1e-3, 1e-3, column.n)
            found.append(falls(column, LoadedState(q, zero, wrench, follower, every)))
            assert found[-1] == tangent(column, q, zero, wrench, follower, every).falls
    assert {True, False} == set(found)


@pytest.mark.slow
def test_a_long_arm_without_an_equilibrium_is_refused() -> None:
    chain = thin_arm(thin_link("gauss", 200, free=True))
    with refused(ConvergenceError, "no-equilibrium"):
        fl.solve_static(chain, tau=np.eye(chain.n)[0])
