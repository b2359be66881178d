"""What the chapters of a report share: the scene, its chain, its run, each found once, whoever asks first."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from pathlib import Path

from flexlink.advice.model_runner import ModelRunner
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.at_rest import rest_of
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.tip_wrench import initial_wrench
from flexlink.motion.simulate import simulate
from flexlink.results.deflection import deflections
from flexlink.results.tip_motion import tip_travel
from flexlink.results.trajectory import Trajectory

MEASURED = ".csv"
"""Ending of measurements that a scene is laid beside."""


@dataclasses.dataclass(frozen=True)
class Study:
    """One scene, and what a report looks at; what cannot be computed raises the same error for all who ask.

    Attributes
    ----------
    scene
        The scene.
    against
        File of somebody else's, or of what was measured, if any.
    command
        What the report was asked for with.
    """

    scene: Scene
    against: Path | None = None
    command: str = ""

    @property
    def measurements(self) -> bool:
        """Whether `against` is what was measured, and not an arm."""
        return self.against is not None and self.against.suffix.lower() == MEASURED

    @cached_property
    def chain(self) -> Chain:
        """The scene's chain."""
        return lump(self.scene)

    @cached_property
    def start(self) -> tuple[Array, Array]:
        """Angles and rates at the start."""
        return initial_state(self.scene, self.chain)

    @cached_property
    def size(self) -> float:
        """How far the arm reaches, or another length of it [m]."""
        return self.chain.size

    @cached_property
    def bends(self) -> bool:
        """Whether any joint is a spring."""
        return bool(self.chain.stiffness.any())

    @cached_property
    def runner(self) -> ModelRunner:
        """Where other models of the scene are run, with a budget."""
        return ModelRunner(self.scene, 3.0)  # s of CPU time for one run

    @property
    def run(self) -> Trajectory:
        """The scene's own run.

        Raises
        ------
        FlexlinkError
            There is none; `attempt` is why.
        """
        if isinstance(self.attempt, FlexlinkError):
            raise FlexlinkError("no run: see “Motion”", id="no-run")
        return self.attempt

    @cached_property
    def travel(self) -> float:
        """Largest distance of the tip from its start [m]."""
        return tip_travel(self.run.tip)

    @cached_property
    def moves(self) -> bool:
        """Whether the tip travels more than a million times the rounding error of its position."""
        return self.travel > 1e6 * rounding.of_position(self.chain)

    @cached_property
    def bent_by(self) -> Array:
        """How far the springs bend the tip away, at every sample [m]."""
        return deflections(self.run)

    @cached_property
    def attempt(self) -> Trajectory | FlexlinkError:
        """The scene's own run, or why there is none."""
        try:
            return simulate(self.scene)
        except FlexlinkError as error:
            return error

    @cached_property
    def rest(self) -> Equilibrium:
        """How the arm sags with its driven joints held where they start.

        Raises
        ------
        FlexlinkError
            As of `solve_static`.
        """
        wrench, frame = initial_wrench(self.scene, self.chain)
        return rest_of(self.chain, self.start[0], tip_wrench=wrench, frame=frame)
