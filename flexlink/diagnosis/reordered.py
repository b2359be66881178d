"""An engine whose joints are counted in another order."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.engines.base import Array, Engine, Samples
from flexlink.engines.read_back import Indices


class Reordered:
    """`engine` with our joint k as its joint `order[k]`."""

    def __init__(self, engine: Engine, order: Indices) -> None:
        self.engine, self.order = engine, order
        self.name, self.version, self.n = engine.name, engine.version, engine.n

    def _there(self, values: Array) -> Array:
        theirs = np.empty(self.n)
        theirs[self.order] = values
        return theirs

    def mass_matrix(self, q: Array) -> Array:
        """M(q)."""
        return self.engine.mass_matrix(self._there(q))[np.ix_(self.order, self.order)]

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC."""
        return self.engine.bias_torque(self._there(q), self._there(qd), tip_wrench=tip_wrench)[self.order]

    def gravity_torque(self, q: Array) -> Array:
        """T_G."""
        return self.engine.gravity_torque(self._there(q))[self.order]

    def elastic_torque(self, q: Array) -> Array:
        """T_FL."""
        return self.engine.elastic_torque(self._there(q))[self.order]

    def friction_torque(self, qd: Array) -> Array:
        """T_FR."""
        return self.engine.friction_torque(self._there(qd))[self.order]

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈."""
        there = (self._there(part) for part in (q, qd, tau))
        return self.engine.forward_dynamics(*there, tip_wrench=tip_wrench)[self.order]

    def integrate(self, scene: Scene) -> Samples:
        """Not of a file: its runs are the engine's own."""
        raise ArgumentError(f"{scene.name}: files of others are compared at states, not run")
