"""Functions of a state accept b states, with arguments (b, n) or (n,); every row is bit-equal to a single call.

Functions that compute eight states in SIMD lanes agree up to rounding, because cosines and fused multiply-adds differ.
"""

from collections.abc import Callable

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.dynamics.result import Result
from tests.conftest import nasty_scene, random_state
from tests.support.words import refused

WRENCH = [1.0, -2.0, 3.0, 0.5, -0.4, 0.3]
CALLS: dict[str, tuple[Callable, list[str], dict[str, object]]] = {
    "inverse_dynamics": (fl.inverse_dynamics, ["q", "qd", "qdd"], {"tip_wrench": WRENCH}),
    "bias_torque": (fl.bias_torque, ["q", "qd"], {"tip_wrench": WRENCH}),
    "gravity_torque": (fl.gravity_torque, ["q"], {}),
    "elastic_torque": (fl.elastic_torque, ["q"], {}),
    "friction_torque": (fl.friction_torque, ["qd"], {}),
    "mass_matrix": (fl.mass_matrix, ["q"], {"algorithm": "upper"}),
    "energy": (fl.energy, ["q", "qd"], {}),
    "frames": (fl.frames, ["q"], {}),
    "tip_position": (fl.tip_position, ["q"], {}),
    "internal_loads": (fl.strength.internal_loads, ["q", "qd", "qdd"], {"tip_wrench": WRENCH}),
    "point_motion": (fl.point_motion, ["q", "qd", "qdd"], {"body": 1, "point": (0.1, 0.2, 0.3)}),
    "forward_dynamics": (fl.forward_dynamics, ["q", "qd", "tau"], {"tip_wrench": WRENCH}),
}
SIDE_BY_SIDE = {"inverse_dynamics", "bias_torque", "gravity_torque"}
NASTY = fl.lump(nasty_scene())


def batch(chain: fl.Chain, rng: np.random.Generator, b: int) -> dict[str, np.ndarray]:
    q, qd = (np.array(x).reshape(b, chain.n) for x in zip(*(random_state(chain, rng) for _ in range(b)), strict=True))
    return {"q": q, "qd": qd, "qdd": rng.normal(size=q.shape), "tau": rng.normal(size=q.shape)}


def fields(found: object) -> tuple:
    if isinstance(found, Result):
        return tuple(vars(found).values())
    return found if isinstance(found, tuple) else (found,)


def equal(many: object, singles: list[object], *, rtol: float = 0.0) -> None:
    for field, values in zip(fields(many), zip(*map(fields, singles), strict=True), strict=True):
        np.testing.assert_allclose(field, np.array(values), rtol=0.0, atol=rtol * np.abs(values).max())


def of_name(name: str) -> float:
    """Allowed difference between a row of a batch and the single call, relative to the largest value."""
    return 1e-13 if name in SIDE_BY_SIDE else 0.0


@pytest.mark.parametrize("b", [1, 8, 19])
def test_batch_rows_in_simd_lanes_equal_single_calls_up_to_rounding(b: int, chain: fl.Chain, rng) -> None:
    """The allowed error of M q̈ + T_GC is the rounding bound of T_GC plus the rounding bound of M times Σ |q̈|."""
    states, wrenches = batch(chain, rng, b), rng.normal(size=(b, 6))
    q, qd, qdd = states["q"], states["qd"], states["qdd"]
    tau, M = fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrenches), fl.mass_matrix(chain, q)
    turned = fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrenches, frame="tip")
    for k in range(b):
        one = fl.inverse_dynamics(chain, q[k], qd[k], qdd[k], tip_wrench=wrenches[k])
        of_mass = rounding.of_mass_matrix(chain, q[k])
        explained = rounding.of_bias_torque(chain, q[k], qd[k], tip_wrench=wrenches[k]) + of_mass * abs(qdd[k]).sum()
        assert abs(tau[k] - one).max() <= explained
        assert abs(M[k] - fl.mass_matrix(chain, q[k])).max() <= of_mass
        one = fl.inverse_dynamics(chain, q[k], qd[k], qdd[k], tip_wrench=wrenches[k], frame="tip")
        assert abs(turned[k] - one).max() <= explained


def test_angles_of_many_turns_keep_full_accuracy_in_batches(rng) -> None:
    """For any number of turns, SIMD lanes reduce angles as accurately as the C library does."""
    q = rng.uniform(-1, 1, (9, NASTY.n)) * 10.0 ** rng.uniform(0, 12, (9, NASTY.n))
    for many, one in zip(fl.mass_matrix(NASTY, q), q, strict=True):
        assert abs(many - fl.mass_matrix(NASTY, one)).max() <= rounding.of_mass_matrix(NASTY, one)


@pytest.mark.parametrize("derivatives", [fl.forward_dynamics_derivatives, fl.inverse_dynamics_derivatives])
@pytest.mark.parametrize("frame", ["world", "tip"])
def test_derivatives_of_a_batch_equal_those_of_single_states(derivatives, frame, chain: fl.Chain, rng) -> None:
    """Loop and single call are compiled separately, so fused multiply-adds differ and results agree up to rounding."""
    states, wrenches = batch(chain, rng, 3), rng.normal(size=(3, 6))
    parts = [states[name] for name in ("q", "qd", "tau")]
    many = derivatives(chain, *parts, tip_wrench=wrenches, frame=frame)
    singles = [derivatives(chain, *(part[k] for part in parts), tip_wrench=wrenches[k], frame=frame) for k in range(3)]
    equal(many, singles, rtol=1e-12)  # a few roundings, times cond(M)
    none = derivatives(chain, *(part[:0] for part in parts), frame=frame)
    assert {field.shape for field in fields(none)} == {(0, chain.n, chain.n)}


@pytest.mark.parametrize("name", CALLS)
def test_every_row_of_a_batch_is_bit_equal_to_the_single_call(name: str, chain: fl.Chain, rng) -> None:
    function, names, options = CALLS[name]
    parts = [batch(chain, rng, 9)[part] for part in names]
    many = function(chain, *parts, **options)
    assert type(many) is type(function(chain, *(part[0] for part in parts), **options))
    equal(many, [function(chain, *row, **options) for row in zip(*parts, strict=True)], rtol=of_name(name))


@pytest.mark.parametrize("name", [name for name, (_, names, _) in CALLS.items() if len(names) > 1])
@pytest.mark.parametrize("batched", range(3))
def test_an_argument_given_once_applies_to_all_states_of_a_batch(name: str, batched: int, rng) -> None:
    function, names, options = CALLS[name]
    several = batch(NASTY, rng, 3)
    lead = names[batched % len(names)]
    parts = {part: several[part] if part == lead else several[part][0].tolist() for part in names}
    many = function(NASTY, **parts, **options)
    equal(many, [function(NASTY, **(parts | {lead: row}), **options) for row in several[lead]], rtol=of_name(name))


@pytest.mark.parametrize("name", CALLS)
def test_lists_views_and_integers_are_accepted_and_empty_batches_give_empty_results(name: str, rng) -> None:
    function, names, options = CALLS[name]
    n = NASTY.n
    whole = rng.integers(0, 2, (4, n))
    expected = function(NASTY, *[whole.astype(float)] * len(names), **options)
    backwards = np.asfortranarray(whole.astype(float))
    backwards.flags.writeable = False
    for same in (whole, whole.tolist(), backwards):
        equal(function(NASTY, *[same] * len(names), **options), [*zip(*fields(expected), strict=True)])
    for none, one in zip(
        fields(function(NASTY, *[np.zeros((0, n))] * len(names), **options)), fields(expected), strict=True
    ):
        assert none.shape == (0, *one.shape[1:])


@pytest.mark.parametrize("name", CALLS)
def test_states_of_wrong_shape_are_refused_and_allowed_shapes_are_named(name: str) -> None:
    function, names, options = CALLS[name]
    n, good = NASTY.n, np.zeros((2, NASTY.n))
    last = names[-1]
    wrong: dict[str, object] = {
        rf"{last} has shape \(3,\); expected \({n},\), or \(b, {n}\) for b states": np.zeros(3),
        rf"{last} has shape \(2, 3\); expected \({n},\), or \(b, {n}\) for b states": np.zeros((2, 3)),
        rf"{last} has shape \(2, 1, {n}\); expected \({n},\), or \(b, {n}\) for b states": np.zeros((2, 1, n)),
        rf"{last}\[1, 2\] = nan is not finite": np.where(np.arange(2 * n).reshape(2, n) == n + 2, np.nan, 0.0),
        rf"{last} has dtype <U1; expected real numbers": [["a"] * n] * 2,
    }
    for wanted, value in wrong.items():
        others = [good[0]] * (len(names) - 1)
        with pytest.raises(fl.errors.ArgumentError, match=f"^{wanted}"):
            function(NASTY, *others, value, **options)
    if len(names) > 1:
        with refused(fl.errors.ArgumentError, "wrong-shape"):
            function(NASTY, *[good] * (len(names) - 1), np.zeros((3, n)), **options)


def test_an_error_in_a_batch_names_the_state() -> None:
    rates = np.zeros((3, NASTY.n))
    rates[1] = 1e160
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.bias_torque(NASTY, np.zeros(NASTY.n), rates)
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.inverse_dynamics_derivatives(NASTY, np.zeros(NASTY.n), rates, np.zeros(NASTY.n))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.forward_dynamics_derivatives(NASTY, np.zeros(NASTY.n), rates, np.zeros(NASTY.n))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.energy(NASTY, np.zeros(NASTY.n), rates)
