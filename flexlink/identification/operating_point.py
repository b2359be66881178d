"""The state about which an arm is linear: its static equilibrium with the driven joints held."""

from __future__ import annotations

from typing import Any

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.steady import rest_of
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.tip_wrench import initial_wrench


def at_rest(scene: Scene) -> tuple[Chain, Equilibrium, dict[str, Any]]:
    """Chain of a scene, its static equilibrium, and the arguments `tip_wrench` and `frame` of its load.

    Raises
    ------
    FlexlinkError
        As in `lump` and `solve_static`.
    """
    chain = lump(scene)
    wrench, frame = initial_wrench(scene, chain)
    load: dict[str, Any] = {"tip_wrench": wrench, "frame": frame}
    return chain, rest_of(chain, initial_state(scene, chain)[0], **load), load
