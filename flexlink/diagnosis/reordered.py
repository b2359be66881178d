"""Reorder the joints of an engine."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene
from flexlink.engines.base import Engine, Samples
from flexlink.engines.read_back import ReadBack


def _reordered(method: Any) -> Any:
    """Convert a method of the engine, so that arguments and results are in our order."""

    @functools.wraps(method)
    def call(reordered: Reordered, *arguments: Array, **named: Any) -> Array:
        inverse = np.argsort(reordered.order)
        values = getattr(reordered.engine, method.__name__)(*(x[inverse] for x in arguments), **named)
        return np.asarray(values[np.ix_(*[reordered.order] * values.ndim)])

    return call


class Reordered:
    """An engine with reordered joints: joint k is joint `order[k]` of the original engine."""

    def __init__(self, engine: Engine, order: Indices) -> None:
        self.engine, self.order = engine, order
        self.name, self.version, self.n = engine.name, engine.version, engine.n

    mass_matrix = _reordered(Engine.mass_matrix)
    bias_torque = _reordered(Engine.bias_torque)
    gravity_torque = _reordered(Engine.gravity_torque)
    elastic_torque = _reordered(Engine.elastic_torque)
    friction_torque = _reordered(Engine.friction_torque)
    forward_dynamics = _reordered(Engine.forward_dynamics)

    def integrate(self, scene: Scene) -> Samples:
        """Raise an error, because foreign files are not simulated."""
        raise ArgumentError(
            f"{scene.name}: foreign files are compared at states, not in simulations", id="file-not-simulated"
        )

    def read_back(self) -> ReadBack:
        """Record of the arm in the engine's order."""
        return self.engine.read_back()
