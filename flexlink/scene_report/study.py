"""Data shared by the chapters of a report, such as the chain and the run; each is computed once, on first use."""

import dataclasses
from functools import cached_property
from pathlib import Path
from typing import Any

from flexlink.advice.model_runner import ModelRunner
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import FlexlinkError, or_error
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.equilibrium import Equilibrium, solve_static
from flexlink.dynamics.placement import unbent
from flexlink.motion.inputs.actuation import initial_wrench, input_arrays
from flexlink.motion.inputs.initial_state import held_joints, initial_state
from flexlink.motion.simulate import simulate
from flexlink.results.tip_motion import tip_travel
from flexlink.results.trajectory import Trajectory, deflections


@dataclasses.dataclass(frozen=True)
class Study:
    """A scene and the data that a report needs; if a computation fails, each access raises the same error."""

    scene: Scene
    against: Path | None = None  # a third-party file of the same arm, or measurements
    command: str = ""  # that produced the report
    uncertain: bool = False  # whether to give intervals, also if the scene lists no uncertain input

    @property
    def measurements(self) -> bool:
        """Whether `against` is a file of measurements, not of an arm."""
        return self.against is not None and self.against.suffix.lower() == ".csv"

    @cached_property
    def chain(self) -> Chain:
        """The scene's chain, as if its ties were cut."""
        return lump(open_chain(self.scene))

    @cached_property
    def start(self) -> tuple[Array, Array]:
        """Initial angles and rates."""
        return initial_state(self.scene, self.chain)

    @cached_property
    def load(self) -> dict[str, Any]:
        """The initial tip wrench, as arguments of functions of a state."""
        return dict(zip(("tip_wrench", "frame"), initial_wrench(self.scene, self.chain), strict=True))

    @cached_property
    def bends(self) -> bool:
        """Whether any joint has a spring."""
        return bool(self.chain.stiffness.any())

    @cached_property
    def runner(self) -> ModelRunner:
        """Runner of other models of the scene, with a time budget."""
        return ModelRunner(self.scene, 3.0)  # CPU time limit of one run [s]

    @property
    def run(self) -> Trajectory:
        """The scene's run."""
        if isinstance(self.attempt, FlexlinkError):
            raise FlexlinkError("no run: see “Motion”", id="no-run")
        return self.attempt

    @cached_property
    def travel(self) -> float:
        """Largest distance of the tip from its initial position [m]."""
        return tip_travel(self.run.tip)

    @cached_property
    def moves(self) -> bool:
        """Whether the tip moves by more than a million times the rounding error of its position."""
        return self.travel > 1e6 * rounding.of_reach(self.chain.size)

    @cached_property
    def bent_by(self) -> Array:
        """Tip deflection by the springs at every sample [m]."""
        return deflections(self.run)

    @cached_property
    def attempt(self) -> Trajectory | FlexlinkError:
        """The scene's run, which follows the vibrations in loads and torques, or the error that prevented it."""
        followed = {"run.outputs": ("loads", "torques")}
        found: Trajectory | FlexlinkError = or_error(lambda: simulate(self.scene.varied(followed)))
        return found

    @cached_property
    def rest(self) -> Equilibrium:
        """Static equilibrium with the `held` joints at their initial positions."""
        q = self.start[0] if self.scene.ties else unbent(self.chain, self.start[0])
        return solve_static(self.chain, q, locked=self.held, ties=self.scene, **self.load)

    @cached_property
    def held(self) -> list[int]:
        """Joints that do not move in statics and modes: the driven ones; with ties, which move others, those held."""
        found = held_joints(input_arrays(self.scene, self.chain), self.scene) if self.scene.ties else self.chain.active
        return list(found.tolist())

    @property
    def holding(self) -> str:
        """What holds the joints in statics and modes."""
        tied = bool(self.scene.ties)
        return ", ".join(["driven joints locked"] * bool(self.held or not tied) + ["ties closed"] * tied)
