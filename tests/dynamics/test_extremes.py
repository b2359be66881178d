"""Matrix-free lowest and highest frequencies agree with the dense eigenproblem."""

import dataclasses

import numpy as np
import pytest
from scipy import linalg

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.dynamics.vibration.extremes import CLOSE, fastest_decay, fastest_frequency, slowest_frequency
from tests.conftest import flexible, make_scene
from tests.support.words import refused

ESTIMATE = 0.1
EPS = np.finfo(float).eps


def held_at(chain: fl.Chain, joints: np.ndarray) -> fl.Chain:
    """The same chain with the given joints prescribed."""
    hinges = chain.hinges.copy()
    hinges["prescribed"][joints] = 1
    return dataclasses.replace(chain, hinges=hinges)


def dense(chain: fl.Chain, q: np.ndarray) -> tuple[np.ndarray, float]:
    """Frequencies of K φ = ω² M φ over joints without prescribed motion, without zeros of free joints; largest D/M."""
    moving = chain.hinges["prescribed"] == 0
    block = np.ix_(moving, moving)
    K, D, M = chain.matrix("stiffness")[block], chain.matrix("damping")[block], fl.mass_matrix(chain, q)[block]
    squares = np.abs(linalg.eigh(K, M, eigvals_only=True))
    return np.sqrt(squares[np.count_nonzero(np.diag(K) == 0) :]), linalg.eigh(D, M, eigvals_only=True)[-1]


def test_lowest_and_highest_frequencies_and_decay_agree_with_the_dense_eigenproblem(any_chain, rng) -> None:
    """The lowest frequency converges fast; the highest is only estimated, as other frequencies are close to it.

    With coupled springs, this is also true if the driven joints and a joint within a cell have prescribed motions.
    """
    coupled, K = len(any_chain.couplings) > 0, any_chain.matrix("stiffness")
    if np.linalg.eigvalsh(K).min() < -1e-9 * K.max():
        return  # a coupled spring across two joints pushes
    hinges, q = any_chain.hinges.copy(), rng.uniform(-0.3, 0.3, any_chain.n) * (0.3 if coupled else 1.0)
    hinges["damping"] += 0.0 if coupled else 1e-3 * hinges["stiffness"]
    chain = dataclasses.replace(any_chain, hinges=hinges)
    for one in (chain, held_at(chain, np.append(chain.active, chain.n - 2))) if coupled else (chain,):
        ω, δ = dense(one, q)
        assert slowest_frequency(one, q) == pytest.approx(ω[0], rel=CLOSE)
        assert fastest_frequency(one, q) == pytest.approx(ω[-1], rel=ESTIMATE)
        assert fastest_decay(one, q) == pytest.approx(δ, rel=2 * ESTIMATE)  # ω² has twice the error of ω


def test_a_chain_without_springs_has_no_frequencies() -> None:
    chain = fl.lump(make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0)))
    assert slowest_frequency(chain, np.zeros(1)) == np.inf
    assert fastest_frequency(chain, np.zeros(1)) == 0.0


@pytest.mark.parametrize("q", [(0.0, 0.0), (0.5, -1.0)], ids=["stretched, so that M is singular", "bent"])
@pytest.mark.parametrize("steps", [{"tolerance": 1e-4}, {"method": "Radau5", "step": 1e-4}], ids=["tolerance", "step"])
@pytest.mark.parametrize("density", [1e-11, 1e-15], ids=["20 eps of the payload", "less than eps"])
def test_arms_with_nearly_massless_links_and_a_point_mass_can_be_simulated(q, steps, density) -> None:
    """The small mass of the links vibrates faster than anything else.

    Below eps times the point mass, rounding decides whether M contains any of the links' mass. Without fused
    multiply-adds, often none remains and q̈ at the start is undefined, but implicit steps do not need it.
    """
    arm = make_scene(flexible("a", segments=4), flexible("b", segments=4), tip=fl.RigidBody(mass=1.0))
    light = arm.varied({"material.aluminium.density": density, "initial.joint_deg": np.degrees(q)})
    chain = fl.lump(light)
    assert slowest_frequency(chain, fl.initial_state(light, chain)[0]) > 1e6
    run = fl.simulate(light.varied({"run": {"duration": 0.01, "sample": 0.005, **steps}}))
    assert np.isfinite(run.tip).all()


def test_a_joint_whose_inertia_is_below_rounding_is_named() -> None:
    """For twist of a stretched massless arm on a tilted base, the diagonal of M is only rounding, often negative."""
    links = (flexible("a", "xyz", 9, lumping="legendre"), flexible("b", "xyz", 9, lumping="legendre"))
    light = make_scene(*links, tip=fl.RigidBody(mass=1.0)).varied({"material.aluminium.density": 1e-300})
    for tilt in np.random.default_rng(1).uniform(-90, 90, (20, 3)).tolist():
        chain = fl.lump(light.varied({"link.a.mount": fl.Mount(rpy_deg=tuple(tilt))}))
        q, zero = np.zeros((2, chain.n))
        assert fl.mass_matrix(chain, q).diagonal().min() < rounding.of_mass_matrix(chain, q), "below rounding"
        with refused(fl.errors.SingularMassError, "joint-without-inertia"):
            fl.forward_dynamics(chain, q, zero, zero, solver="cholesky")


def test_joints_without_inertia_have_an_infinite_frequency() -> None:
    """The choice of a method uses this frequency, and implicit methods need no inertia, so ∞ is allowed."""
    chain = fl.lump(make_scene(flexible("a")))
    bodies = chain.bodies.copy()
    for inertia in ("mass", "inertia"):
        bodies[inertia] = 0.0
    chain = dataclasses.replace(chain, bodies=bodies)
    with pytest.raises(fl.errors.SingularMassError):
        fl.forward_dynamics(chain, *np.zeros((3, chain.n)))
    assert fastest_frequency(chain, np.zeros(chain.n)) == np.inf
    hinges = chain.hinges.copy()
    hinges["armature"] = -1e-20  # rounding may leave a negative inertia
    assert slowest_frequency(dataclasses.replace(chain, hinges=hinges), np.zeros(chain.n)) == np.inf


def test_the_damper_of_a_prescribed_joint_causes_no_decay() -> None:
    """The joint moves as prescribed regardless of its damper; if this is the only damper, nothing decays."""
    chain = fl.lump(make_scene(flexible("a", segments=4)))
    hinges, q = chain.hinges.copy(), np.zeros(chain.n)
    hinges["prescribed"][chain.active], hinges["damping"][chain.active] = 1, 1e9
    with np.errstate(all="raise"):  # 0/0 would be an error
        assert fastest_decay(dataclasses.replace(chain, hinges=hinges.copy()), q) == 0.0
    hinges["damping"] += 1e-3 * hinges["stiffness"]
    held, rest = dataclasses.replace(chain, hinges=hinges), chain.hinges["stiffness"] > 0
    M = fl.mass_matrix(chain, q)[np.ix_(rest, rest)]
    wanted = linalg.eigh(np.diag(held.damping[rest]), M, eigvals_only=True)[-1]
    assert fastest_decay(held, q) == pytest.approx(wanted, rel=2 * ESTIMATE)


@pytest.mark.parametrize("straight", [True, False], ids=["straight", "bent"])
def test_condensing_free_joints_agrees_with_the_pseudo_inverse(straight: bool, rng: np.random.Generator) -> None:
    """K φ = ω² S φ with S = M_pp − M_pa M_aa⁺ M_ap is solved for four free joints, two of them about the same axis."""
    links = [flexible(name, segments=3) for name in "abcd"]
    links[2] = fl.Link(name="c", length=0.0, joint=fl.Joint(armature=1e3))  # on the axis of the next joint
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=2.0)))
    q = np.zeros(chain.n) if straight else rng.uniform(-0.5, 0.5, chain.n)
    M, a = fl.mass_matrix(chain, q), chain.stiffness == 0
    S = M[np.ix_(~a, ~a)] - M[np.ix_(~a, a)] @ np.linalg.pinv(M[np.ix_(a, a)], rcond=1e-12) @ M[np.ix_(a, ~a)]
    squares = 1.0 / linalg.eigh(S, np.diag(chain.stiffness[~a]), eigvals_only=True)
    assert slowest_frequency(chain, q) == pytest.approx(np.sqrt(squares[-1]), rel=CLOSE)


def test_rotors_reduce_the_highest_frequency_and_the_fastest_decay(rng: np.random.Generator) -> None:
    chain = fl.lump(make_scene(flexible("a", segments=4)))
    hinges, q = chain.hinges.copy(), rng.uniform(-0.3, 0.3, chain.n)
    hinges["armature"], hinges["damping"] = 0.1, 1e-3 * hinges["stiffness"]
    heavy = dataclasses.replace(chain, hinges=hinges)
    assert fastest_frequency(heavy, q) == pytest.approx(dense(heavy, q)[0][-1], rel=ESTIMATE)
    assert fastest_decay(heavy, q) == pytest.approx(1e-3 * dense(heavy, q)[0][-1] ** 2, rel=2 * ESTIMATE)
