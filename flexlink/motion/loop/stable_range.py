"""The largest stable value of a number on which a loop depends: the first boundary of stability from its own value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.wording import truncated
from flexlink.describe.scene import Scene

STABLE = 1.0 + 1e-6
"""Growth factor up to which a loop counts as stable; rigid motion, with poles at 1, is computed to about 1e-8."""


def boundary(growth: Callable[[float], float], start: float, *, up: bool, factor: float = 1.3, most: int = 60) -> float:
    """The value at which growth(value) crosses `STABLE` on the way from `start`, which `factor` changes step by step.

    From a stable start it is the last stable value, upwards or downwards; from an unstable one the first stable one.
    Without a crossing within `most` steps, it is inf or 0 from a stable start, and nan from an unstable one.
    """
    stable, value = growth(start) <= STABLE, start
    for _ in range(most):
        value, before = value * factor if up else value / factor, value
        if (growth(value) <= STABLE) is not stable:
            return _between(growth, before, value) if stable else _between(growth, value, before)
    return float("nan") if not stable else float("inf") if up else 0.0


def _between(growth: Callable[[float], float], stable: float, unstable: float) -> float:
    """A stable value within 1e-6 of the boundary between a stable and an unstable value."""
    while abs(unstable - stable) > 1e-6 * abs(stable):
        middle = (stable + unstable) / 2
        stable, unstable = (middle, unstable) if growth(middle) <= STABLE else (stable, middle)
    return stable


def number_at(scene: Scene, path: str) -> tuple[Callable[[float], dict[str, Any]], float]:
    """Changes of a scene that set the number at a path, and its value; a list is scaled, so that its value is 1."""
    values = scene.values_at(path)
    now = np.asarray(values[0], dtype=object)
    kinds = {type(each) for each in now.ravel().tolist()}
    if any(each != values[0] for each in values) or not kinds <= {int, float} or not now.any():
        given = truncated(values[0] if len(values) == 1 else values)
        raise ArgumentError(
            f"path = {path!r}: is {given} in the scene; expected a number other than 0", id="wrong-value"
        )
    if now.ndim:
        return lambda factor: {path: tuple((factor * now).tolist())}, 1.0
    return lambda value: {path: value}, float(now[()])
