"""An engine with its joints in another order."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.engines.base import Engine, Samples
from flexlink.engines.read_back import Array, Indices, ReadBack


class Reordered:
    """`engine` with joint k as its joint `order[k]`."""

    def __init__(self, engine: Engine, order: Indices) -> None:
        self.engine, self.order = engine, order
        self.name, self.version, self.n = engine.name, engine.version, engine.n

    def _in_its_order(self, values: Array) -> Array:
        reordered = np.empty(self.n)
        reordered[self.order] = values
        return reordered

    def mass_matrix(self, q: Array) -> Array:
        """M(q)."""
        return self.engine.mass_matrix(self._in_its_order(q))[np.ix_(self.order, self.order)]

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC."""
        return self.engine.bias_torque(self._in_its_order(q), self._in_its_order(qd), tip_wrench=tip_wrench)[self.order]

    def gravity_torque(self, q: Array) -> Array:
        """T_G."""
        return self.engine.gravity_torque(self._in_its_order(q))[self.order]

    def elastic_torque(self, q: Array) -> Array:
        """T_FL."""
        return self.engine.elastic_torque(self._in_its_order(q))[self.order]

    def friction_torque(self, qd: Array) -> Array:
        """T_FR."""
        return self.engine.friction_torque(self._in_its_order(qd))[self.order]

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈."""
        arguments = (self._in_its_order(part) for part in (q, qd, tau))
        return self.engine.forward_dynamics(*arguments, tip_wrench=tip_wrench)[self.order]

    def integrate(self, scene: Scene) -> Samples:
        """Refused: foreign files are not simulated."""
        raise ArgumentError(f"{scene.name}: foreign files are compared at states, not in simulations")

    def read_back(self) -> ReadBack:
        """The arm in the engine's own order."""
        return self.engine.read_back()
