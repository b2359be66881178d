"""Batches of states: one rule on array shapes for all functions of a state, and a loop over the states."""

from collections.abc import Callable
from typing import TypeGuard, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import dimensions, real_array, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.types import Array
from flexlink.dynamics.result import Result
from flexlink.kernels.tools.finite import is_finite

R = TypeVar("R")


def is_batch(*state: ArrayLike) -> bool:
    """Whether any part of a state has more than one dimension."""
    try:
        for part in state:
            if part.ndim > 1:  # type: ignore[union-attr]
                return True
    except AttributeError:  # a list
        return any(dimensions(part) > 1 for part in state)
    return False


def rows(n: int, state: dict[str, ArrayLike]) -> list[Array]:
    """Return the parts of b states, (b, n) each, or refuse them; one is given in this shape, others may be (n,).

    Arrays that kernels can read are returned without a copy: copying many states costs as much as their dynamics.
    """
    parts = {name: part if _readable(part) else real_array(name, part, (n,)) for name, part in state.items()}
    b, leader = next((len(part), name) for name, part in parts.items() if part.ndim > 1)
    for name, part in parts.items():
        if part.shape not in {(n,), (b, n)}:
            many = f"(b, {n}) for b states" if name == leader else f"({b}, {n}), to match {leader}"
            raise ArgumentError(f"{name} has shape {part.shape}; expected ({n},), or {many}", id="wrong-shape")
        if not is_finite(part.reshape(-1)):
            index = tuple(int(k) for k in np.argwhere(~np.isfinite(part))[0])
            why = f"{name}{list(index)} = {part[index]} is not finite; expected finite numbers"
            raise ArgumentError(why, id="not-finite")
    return [part if part.ndim > 1 else np.array(np.broadcast_to(part, (b, n))) for part in parts.values()]


def _readable(part: ArrayLike) -> TypeGuard[Array]:
    """Whether kernels accept this array of several states unchanged: float64, writable and contiguous."""
    return type(part) is np.ndarray and part.dtype == np.float64 and part.ndim > 1 and part.flags.carray


def wrench_rows(tip_wrench: ArrayLike | None, b: int) -> Array:
    """Return the tip wrench of each of b states, (b, 6), from one wrench (6,) or one row per state, or refuse it."""
    if tip_wrench is None or not is_batch(tip_wrench):
        return np.tile(wrench_vector(tip_wrench), (b, 1))
    wrenches = real_array("tip_wrench", tip_wrench, (6,))
    if wrenches.shape != (b, 6):
        why = f"tip_wrench has shape {wrenches.shape}; expected (6,), or ({b}, 6), one row per state"
        raise ArgumentError(why, id="wrong-shape")
    return np.array([vector(f"tip_wrench[{k}]", row, 6) for k, row in enumerate(wrenches)]).reshape(b, 6)


def about_state(k: int, error: FlexlinkError) -> FlexlinkError:
    """Add the number of the state to an error's message."""
    error.args = (f"state {k}: {error}", *error.args[1:])
    return error


def each(
    function: Callable[..., R], chain: Chain, state: dict[str, ArrayLike], *, tip_wrench: ArrayLike | None = None,
    **options: object,
) -> R:  # fmt: skip
    """Call a function of one state for each of b states; stack its results, or the fields of its `Result`.

    `state` contains the parts of the state by name, in order, `options` what is the same for all states. Each result is
    bitwise equal to that of a single call; the message of an error names the state.
    """
    found: list[R] = []
    many = rows(require_type("chain", chain, Chain).n, state)
    b = len(many[0])
    wrenches = wrench_rows(tip_wrench, b)
    for k in range(max(b, 1)):  # for an empty batch, one call gives the shape of the result
        if tip_wrench is not None and b:
            options["tip_wrench"] = wrenches[k]
        try:
            found.append(function(chain, *(part[k] if b else np.zeros(chain.n) for part in many), **options))
        except FlexlinkError as error:
            raise about_state(k, error) from None
    if isinstance(found[0], Result):
        return type(found[0])(*(np.array([vars(one)[name] for one in found])[:b] for name in vars(found[0])))
    return cast("R", np.array(found)[:b])
