"""Functions of a state are bound to their chain: a call that skips the checks gives what the checked call gives."""

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.floating_base import FloatingBase

SCENE = fl.load_scene(Path(__file__).parents[2] / "models" / "t3_spatial.toml")
CHAIN = fl.lump(SCENE)
STATES = np.random.default_rng(5).normal(size=(40, 3, CHAIN.n)) * 0.1
OF_A_STATE: dict[str, Callable[[fl.Chain, Any], Any]] = {
    "forward_dynamics": lambda chain, state: fl.forward_dynamics(chain, *state),
    "inverse_dynamics": lambda chain, state: fl.inverse_dynamics(chain, *state),
    "mass_matrix": lambda chain, state: fl.mass_matrix(chain, state[0]),
    "tip_position": lambda chain, state: fl.tip_position(chain, state[0]),
    "jacobian": lambda chain, state: fl.jacobian(chain, state[0]).linear,
    "forward derivatives": lambda chain, state: fl.forward_dynamics_derivatives(chain, *state).dq,
    "inverse derivatives": lambda chain, state: fl.inverse_dynamics_derivatives(chain, *state).dqd,
}


@pytest.mark.parametrize("name", OF_A_STATE)
def test_lists_and_strided_arrays_give_the_same_numbers(name: str) -> None:
    found, state = OF_A_STATE[name], STATES[0]
    wanted = found(CHAIN, state)
    read_only = state.copy()
    read_only.setflags(write=False)
    for other in (state.tolist(), np.repeat(state, 2, axis=1)[:, ::2], read_only, state.astype(">f8")):
        np.testing.assert_array_equal(found(CHAIN, other), wanted)


@pytest.mark.parametrize("name", OF_A_STATE)
@pytest.mark.parametrize("wrong", [STATES[0] * np.nan, STATES[0, :, 1:], STATES[0] * 1j])
def test_wrong_states_are_named_as_ever(name: str, wrong: Any) -> None:
    OF_A_STATE[name](CHAIN, STATES[0])
    with pytest.raises(fl.errors.ArgumentError, match=r"^q"):
        OF_A_STATE[name](CHAIN, wrong)


@pytest.mark.parametrize("name", OF_A_STATE)
@pytest.mark.parametrize("empty", [[[], [], []], np.zeros((3, 0))])
def test_empty_states_are_named(name: str, empty: Any) -> None:
    with pytest.raises(fl.errors.ArgumentError, match=r"^q has shape"):
        OF_A_STATE[name](CHAIN, empty)


def test_a_chain_whose_base_turns_forgets_what_was_bound() -> None:
    satellite = fl.lump(fl.load_scene(Path(__file__).parents[2] / "models" / "satellite.toml"))
    base, q = FloatingBase(satellite), np.zeros(satellite.n)
    before = fl.tip_position(base.chain, q)
    turned = np.array([np.cos(0.5), 0.0, 0.0, np.sin(0.5)])
    base.take(turned)
    assert abs(fl.tip_position(base.chain, q) - before).max() > 1e-3
    rates = np.ones(satellite.n)
    slow = fl.forward_dynamics(base.chain, q, rates, rates, tip_wrench=np.zeros(6))
    np.testing.assert_array_equal(fl.forward_dynamics(base.chain, q, rates, rates), slow)


@pytest.mark.parametrize("name", OF_A_STATE)
def test_threads_may_share_a_chain(name: str) -> None:
    found = OF_A_STATE[name]
    wanted = [found(CHAIN, state) for state in STATES]
    with ThreadPoolExecutor(8) as pool:
        for got, want in zip(pool.map(lambda k: found(CHAIN, STATES[k % 40]), range(2000)), wanted * 50, strict=True):
            np.testing.assert_array_equal(got, want)


def test_results_do_not_share_memory_with_later_calls() -> None:
    for found in OF_A_STATE.values():
        first = found(CHAIN, STATES[0])
        kept = first.copy()
        found(CHAIN, STATES[1])
        np.testing.assert_array_equal(first, kept)


def test_variants_copies_and_pickles_have_separate_constants() -> None:
    q, qd, tau = STATES[0]
    before = fl.forward_dynamics(CHAIN, q, qd, tau)
    heavier = fl.lump(SCENE.varied({"tip.mass": 50.0}))
    assert abs(fl.forward_dynamics(heavier, q, qd, tau) - before).max() > 1.0
    doubled = CHAIN.with_numbers(gravity=2 * CHAIN.gravity)
    np.testing.assert_allclose(
        fl.gravity_torque(doubled, q), 2 * fl.gravity_torque(CHAIN, q), rtol=1e-12, atol=1e-12 * CHAIN.weight
    )
    for other in (copy.copy(CHAIN), copy.deepcopy(CHAIN), pickle.loads(pickle.dumps(CHAIN))):
        np.testing.assert_array_equal(fl.forward_dynamics(other, q, qd, tau), before)
    np.testing.assert_allclose(fl.forward_dynamics(CHAIN.as_full(), q, qd, tau), before, rtol=1e-9, atol=1e-9)
