"""States at which arms are compared include all kinds and are valid for the chain."""

import numpy as np
import pytest

from flexlink import Chain, Joint, Link, Mount, RigidBody, elastic_torque, gravity_torque, load_scene, lump, mass_matrix
from flexlink.diagnosis.quantities import IMBALANCE, State, mixed_states, random_states
from flexlink.errors import SingularMassError
from tests.conftest import MODELS, flexible, make_scene
from tests.support.words import refused

T3 = next(path for path in MODELS if path.stem == "t3_spatial")


@pytest.fixture(scope="module")
def chain() -> Chain:
    return lump(load_scene(T3))


def passive(chain: Chain) -> np.ndarray:
    return np.setdiff1d(np.arange(chain.n), chain.active)


def of_kind(states: list[State], *kind: int) -> list[State]:
    return [state for k, state in enumerate(states) if k % 8 in kind]


def test_random_states_cover_the_full_range_and_repeat_with_the_seed(chain: Chain) -> None:
    states = random_states(chain, 200, seed=3)
    q, qd, _, wrench, _ = (np.array(part) for part in zip(*states, strict=True))
    assert -np.pi < q.min() < -3.1 and 3.1 < q.max() < np.pi
    assert -10 < qd.min() < -9.9 and 9.9 < qd.max() < 10
    assert (wrench.min(axis=0) < -9).all() and (wrench.max(axis=0) > 9).all() and np.abs(wrench).max() < 10
    assert np.array_equal(q, [s.q for s in random_states(chain, 200, seed=3)])
    assert all(not s.tau[passive(chain)].any() and s.tau[chain.active].all() for s in states)


def test_a_quarter_of_the_states_is_balanced_to_a_millionth_but_not_exactly(chain: Chain) -> None:
    balanced = of_kind(mixed_states(chain, 40), 1, 5)
    assert len(balanced) == 10
    for q, qd, tau, wrench, _ in balanced:
        held = gravity_torque(chain, q) + elastic_torque(chain, q)
        off = np.abs(tau / held - 1)
        assert 0 < off.max() <= IMBALANCE
        assert not qd.any() and not wrench.any()


def test_balanced_states_load_all_springs_about_equally() -> None:
    """The beam is 50 times as wide as high, so springs of one plane are 2,500 times as stiff as those of the other."""
    chain = lump(make_scene(flexible("arm", "yz", 4)))
    hinges = chain.hinges.copy()
    hinges["stiffness"][1::2] *= 2500
    chain = Chain(chain.name, chain.bodies.copy(), hinges, chain.gravity.copy(), chain.coordinates, chain.link_names)
    largest = np.max([np.abs(elastic_torque(chain, s.q)) for s in of_kind(mixed_states(chain, 160), 1, 5)], axis=0)
    assert largest[1:].min() > 0.5 * largest.max()


def test_a_quarter_of_the_states_is_stretched_out_and_half_of_these_turn(chain: Chain) -> None:
    states = mixed_states(chain, 160)
    for q, _, tau, wrench, _ in of_kind(states, 3, 7):
        assert not q[passive(chain)].any() and not tau.any() and not wrench.any()
        assert set(np.degrees(q[chain.active]).round(9)) <= {-90.0, 0.0, 90.0, 180.0}
    assert not any(s.qd.any() for s in of_kind(states, 3))
    assert all(s.qd[chain.active].all() and not s.qd[passive(chain)].any() for s in of_kind(states, 7))


@pytest.mark.parametrize("segments", [3, 9, 21])
def test_hinges_with_negative_rotors_are_bent_only_as_far_as_m_stays_positive_definite(segments: int) -> None:
    links = [flexible(name, "xyz", segments, lumping="gauss_matched") for name in ("upper", "fore")]
    chain = lump(make_scene(*links))
    assert chain.hinges["armature"].min() < 0
    states = mixed_states(chain, 24)
    assert all(np.linalg.eigvalsh(mass_matrix(chain, s.q)).min() > 0 for s in states)
    assert np.abs([s.q[passive(chain)] for s in of_kind(states, 0, 2)]).max() > 0.3  # but the passive hinges are bent
    assert np.abs([s.q[chain.active] for s in states]).max() > 3


def test_an_arm_singular_when_stretched_out_is_compared_in_regular_states() -> None:
    """At every multiple of 180° two joint axes coincide without mass between them."""
    gimbals = [Link(name="one"), Link(name="two", mount=Mount(rpy_deg=(90.0, 0.0, 0.0)))]
    chain = lump(
        make_scene(
            *gimbals,
            Link(name="three", mount=Mount(rpy_deg=(-90.0, 0.0, 0.0))),
            tip=RigidBody(mass=1.0, inertia=(1, 2, 3)),
        )
    )
    for state in mixed_states(chain, 40):
        assert np.linalg.eigvalsh(mass_matrix(chain, state.q)).min() > 1e-9


def test_an_arm_that_is_singular_everywhere_raises_an_error_naming_the_joint() -> None:
    chain = lump(
        make_scene(Link(name="one", joint=Joint()), Link(name="two"), tip=RigidBody(mass=1, inertia=(1, 1, 1)))
    )
    with refused(SingularMassError, "joint-without-inertia"):
        mixed_states(chain, 8)
