"""Many states at once: one rule of shapes for all functions of a state, and the way through the rows of a batch."""

from __future__ import annotations

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
    except AttributeError:  # of a list
        return any(dimensions(part) > 1 for part in state)
    return False


def rows(n: int, state: dict[str, ArrayLike]) -> list[Array]:
    """The parts of b states, shape (b, n) each, of which one has this shape, and any may have the shape (n,).

    They are the arrays given, where kernels can read these: a copy of many states costs as much as their dynamics.

    Raises
    ------
    ArgumentError
        A part has another shape, is not real or not finite; the message names it and the shapes allowed.
    """
    parts = {name: part if _readable(part) else real_array(name, part, (n,)) for name, part in state.items()}
    b, leader = next((len(part), name) for name, part in parts.items() if part.ndim > 1)
    for name, part in parts.items():
        if part.shape not in {(n,), (b, n)}:
            many = f"(b, {n}) for b states" if name == leader else f"({b}, {n}), as many as {leader}"
            raise ArgumentError(f"{name} has shape {part.shape}; expected ({n},), or {many}", id="wrong-shape")
        if not is_finite(part.reshape(-1)):
            place = tuple(int(k) for k in np.argwhere(~np.isfinite(part))[0])
            raise ArgumentError(
                f"{name}{list(place)} = {part[place]} is not finite; expected finite numbers", id="not-finite"
            )
    return [part if part.ndim > 1 else np.array(np.broadcast_to(part, (b, n))) for part in parts.values()]


def _readable(part: ArrayLike) -> TypeGuard[Array]:
    """Whether kernels know the type of an array: writable, contiguous, of many states."""
    return type(part) is np.ndarray and part.dtype == np.float64 and part.ndim > 1 and part.flags.carray


def wrench_rows(tip_wrench: ArrayLike | None, b: int) -> Array:
    """The tip wrench of each of b states, shape (b, 6): the same in all, or one row per state.

    Raises
    ------
    ArgumentError
        It has another shape, is not real or not finite.
    """
    if tip_wrench is None or not is_batch(tip_wrench):
        return np.array(np.broadcast_to(wrench_vector(tip_wrench), (b, 6)))
    wrenches = real_array("tip_wrench", tip_wrench, (6,))
    if wrenches.shape != (b, 6):
        raise ArgumentError(
            f"tip_wrench has shape {wrenches.shape}; expected (6,), or ({b}, 6), one row per state", id="wrong-shape"
        )
    return np.array([vector(f"tip_wrench[{k}]", row, 6) for k, row in enumerate(wrenches)]).reshape(b, 6)


def about_state(k: int, error: FlexlinkError) -> FlexlinkError:
    """An error of one state of many, which says of which."""
    error.args = (f"state {k}: {error}", *error.args[1:])
    return error


def each(
    function: Callable[..., R],
    chain: Chain,
    state: dict[str, ArrayLike],
    *,
    tip_wrench: ArrayLike | None = None,
    **options: object,
) -> R:
    """What a `function` of a chain and one state finds of b states, along a new first axis; of a Result, per field.

    Row by row the results are those of single states, to the bit.

    Parameters
    ----------
    function
        Takes the chain, the parts of the state and the options.
    chain
        The chain.
    state
        Its parts by name, in order; see `rows`.
    tip_wrench
        Of a `function` that takes one; see `wrench_rows`.
    options
        The same for all states.

    Raises
    ------
    FlexlinkError
        As of single states; the message says which one.
    """
    found: list[R] = []
    many = rows(require_type("chain", chain, Chain).n, state)
    b = len(many[0])
    wrenches = wrench_rows(tip_wrench, b)
    for k in range(max(b, 1)):  # the first of none shows the shape
        if tip_wrench is not None and b:
            options["tip_wrench"] = wrenches[k]
        try:
            found.append(function(chain, *(part[k] if b else np.zeros(chain.n) for part in many), **options))
        except FlexlinkError as error:
            raise about_state(k, error) from None
    if isinstance(found[0], Result):
        return type(found[0])(*(np.array([vars(one)[name] for one in found])[:b] for name in vars(found[0])))
    return cast("R", np.array(found)[:b])
