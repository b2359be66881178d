"""`fl.Dynamics` gives the numbers, and for wrong arguments the errors, of the public functions."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.accelerations import PITCH

MODELS = Path(__file__).parents[2] / "models"
CHAIN = fl.lump(fl.load_scene(MODELS / "t3_spatial.toml"))
STATES = np.random.default_rng(7).normal(size=(20, 3, CHAIN.n)) * 0.1
PARTS = {
    "forward_dynamics": 3, "inverse_dynamics": 3, "mass_matrix": 1, "jacobian": 1, "forward_dynamics_derivatives": 3,
    "inverse_dynamics_derivatives": 3,
}  # fmt: skip
"""Functions, and how many parts of a state they take."""


def called(name: str, chain: fl.Chain, *state: Any) -> Any:
    """The public function's numbers, in one array."""
    found = getattr(fl, name)(chain, *state)
    return found if isinstance(found, np.ndarray) else np.stack(list(vars(found).values()), axis=-3)


@pytest.mark.parametrize("model", ["t3_spatial", "paper_fig5", "gantry", "satellite", "dual_arm"])
@pytest.mark.parametrize("name", PARTS)
def test_numbers_equal_those_of_public_functions(name: str, model: str) -> None:
    chain = fl.lump(fl.load_scene(MODELS / f"{model}.toml"))
    state = np.random.default_rng(1).normal(size=(PARTS[name], chain.n)) * 0.1
    found = getattr(fl.Dynamics(chain), name)(*state)
    np.testing.assert_array_equal(found, called(name, chain, *state))
    assert found.flags.writeable


@pytest.mark.parametrize("name", PARTS)
def test_lists_and_many_states_are_taken(name: str) -> None:
    function, states = getattr(fl.Dynamics(CHAIN), name), STATES[:, : PARTS[name]]
    np.testing.assert_array_equal(function(*states[0].tolist()), function(*states[0]))
    np.testing.assert_array_equal(function(*np.moveaxis(states, 1, 0)), called(name, CHAIN, *np.moveaxis(states, 1, 0)))


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("wrong", [[], [1.0], "q", np.full(CHAIN.n, np.nan), np.ones(CHAIN.n) * 1j])
def test_wrong_states_are_named_as_by_public_functions(name: str, wrong: Any) -> None:
    with pytest.raises(fl.errors.ArgumentError) as expected:
        getattr(fl, name)(CHAIN, *[wrong] * PARTS[name])
    with pytest.raises(fl.errors.ArgumentError) as found:
        getattr(fl.Dynamics(CHAIN), name)(*[wrong] * PARTS[name])
    assert str(found.value) == str(expected.value)


def test_a_free_base_in_gimbal_lock_is_refused() -> None:
    chain = fl.lump(fl.load_scene(MODELS / "satellite.toml"))
    q = np.zeros(chain.n)
    q[PITCH] = np.pi / 2
    with pytest.raises(fl.errors.SingularMassError, match="gimbal lock"):
        fl.Dynamics(chain).forward_dynamics(q, 0 * q, 0 * q)


def test_objects_are_shared_by_threads_and_processes() -> None:
    dynamics = pickle.loads(pickle.dumps(fl.Dynamics(CHAIN)))
    wanted = [dynamics.forward_dynamics(*state) for state in STATES]
    with ThreadPoolExecutor(4) as pool:
        found = pool.map(lambda k: dynamics.forward_dynamics(*STATES[k % 20]), range(1000))
        for got, want in zip(found, wanted * 50, strict=True):
            np.testing.assert_array_equal(got, want)


def test_only_chains_are_taken() -> None:
    with pytest.raises(fl.errors.ArgumentError, match=r"^chain"):
        fl.Dynamics("arm")  # type: ignore[arg-type]
