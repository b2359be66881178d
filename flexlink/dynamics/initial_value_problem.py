"""InitialValueProblem: the equation of motion of a scene with its initial state, which a run integrates."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings, steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.kernels.inputs.record import Inputs


@dataclasses.dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """The initial value problem M q̈ + T_GC + T_FL + T_FR = T_EX, q(t₀) and q̇(t₀) given.

    Attributes
    ----------
    scene
        The scene, whose `run` says how to integrate.
    chain
        What moves.
    inputs
        What acts on it: drive, prescribed motions, tip wrench.
    q, qd
        Where it starts, angles [rad] and rates [rad/s], shape (n,), read-only by agreement.
    base
        Of a chain whose base is free: what lets its steps go on in other coordinates; `chain` is its own then.
    """

    scene: Scene
    chain: Chain
    inputs: Inputs
    q: Array
    qd: Array
    base: FloatingBase | None = None

    @property
    def original(self) -> Chain:
        """The chain as it was given, whose free base is where it starts from, however far a run has got."""
        return self.chain if self.base is None else self.base.original

    @property
    def run(self) -> RunSettings:
        """How to integrate."""
        return self.scene.run

    @property
    def start(self) -> float:
        """The time t₀ at which it starts [s]."""
        return self.scene.initial.time

    @functools.cached_property
    def explicit(self) -> bool:
        """Whether it is integrated in fixed steps of an explicit method."""
        return steps_explicitly(self.run)

    def workspace(self) -> Any:
        """New scratch of the run's solver of forward dynamics."""
        return solver_for(self.chain, self.run.solver).workspace(self.chain.arrays)
