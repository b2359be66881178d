"""Single numbers that were measured, frequencies and places at rest, and what a scene gives in their place."""

from __future__ import annotations

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.at_rest import rest_of
from flexlink.dynamics.vibration.modal import modes
from flexlink.identification.block import Block
from flexlink.identification.problem import FitModes, FitProblem, FitStatic
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.tip_wrench import initial_wrench


class Tapped:
    """Frequencies, and ratios of damping, at rest."""

    def __init__(self, problem: FitProblem, tapped: FitModes, number: int) -> None:
        self.name, self.use, self.tapped = f"modes {number}", tapped.use, tapped
        self.scene = problem.scene.varied(tapped.set) if tapped.set else problem.scene
        numbers = tapped.numbers or tuple(range(1, len(tapped.hertz) + 1))
        self.modes = np.array(numbers) - 1
        σ = np.broadcast_to(np.array(tapped.deviation), len(tapped.hertz)).astype(float)
        blocks = [Block("frequency [Hz]", np.array(tapped.hertz), σ, True)]
        if tapped.ratios:
            ratios = np.array(tapped.ratios)
            blocks.append(Block("damping ratio [1]", ratios, np.full(len(ratios), tapped.ratio_deviation), True))
        self.blocks = tuple(blocks)

    def of(self, scene: Scene) -> list[Array]:
        """What a scene has in place of its blocks."""
        chain = lump(scene)
        wrench, frame = initial_wrench(scene, chain)
        rest = rest_of(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame)
        held = chain.active.tolist() if self.tapped.locked is None else list(self.tapped.locked)
        found = modes(chain, rest.q, tip_wrench=wrench, frame=frame, locked=held)
        elastic = np.flatnonzero(np.array(found.kinds) == "elastic")
        if len(elastic) <= self.modes.max():
            raise ArgumentError(
                f"{self.name}: mode {self.modes.max() + 1} is asked for; the arm has {len(elastic)} elastic modes"
            )
        which = elastic[self.modes]
        return [found.hertz[which], found.damping_ratios[which]][: len(self.blocks)]


class Sagged:
    """One coordinate of the tip at rest, or by how much it differs from another state."""

    def __init__(self, problem: FitProblem, static: FitStatic, number: int) -> None:
        self.name, self.use, self.static = f"static {number}", static.use, static
        self.scene = problem.scene.varied(static.set) if static.set else problem.scene
        self.blocks = (Block(f"tip {static.axis} [m]", np.array([static.value]), np.array([static.deviation]), True),)

    def of(self, scene: Scene) -> list[Array]:
        """What a scene has in place of its blocks."""
        value = self._tip(scene)
        if self.static.before is not None:
            value -= self._tip(scene.varied(self.static.before))
        return [np.array([value])]

    def _tip(self, scene: Scene) -> float:
        chain = lump(scene)
        wrench, frame = initial_wrench(scene, chain)
        rest = rest_of(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame)
        return float(tip_position(chain, rest.q)["xyz".index(self.static.axis)])
