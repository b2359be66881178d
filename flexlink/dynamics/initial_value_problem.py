"""InitialValueProblem: the equation of motion of a scene with its initial state, to be integrated."""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings, steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.kernels.inputs.record import Inputs, MotionTable


@dataclasses.dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """The initial value problem M q̈ + T_GC + T_FL + T_FR = T_EX with given q(t₀) and q̇(t₀)."""

    scene: Scene  # its `run` specifies the integration
    chain: Chain  # the chain that moves
    inputs: Inputs  # drive, motions that are given, tip wrench
    q: Array  # (n,) initial angles [rad] and rates [rad/s]; read-only by convention
    qd: Array
    ties: tuple[NDArray[np.void], MotionTable] | None = None  # (r,) TIE, and lengths that move; None: an open chain
    base: FloatingBase | None = None  # reference attitude of a floating base; `chain` is then `base.chain`

    @property
    def original(self) -> Chain:
        """The chain with the initial reference attitude of its floating base, however far a run has progressed."""
        return self.chain if self.base is None else self.base.original

    @property
    def run(self) -> RunSettings:
        """Settings of the integration."""
        return self.scene.run

    @property
    def start(self) -> float:
        """Initial time t₀ [s]."""
        return self.scene.initial.time

    @functools.cached_property
    def explicit(self) -> bool:
        """Whether the run uses an explicit method with fixed steps, and no ties, in which a step may have to end."""
        return steps_explicitly(self.run) and self.ties is None

    def workspace(self) -> Any:
        """New workspace for the forward dynamics solver of the run."""
        return solver_for(self.chain, self.run.solver).workspace(self.chain.arrays)
