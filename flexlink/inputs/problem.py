"""The problem of a scene, put together in one place for whatever integrates it."""

from __future__ import annotations

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.problem import Problem
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.initial_state import state_under


def problem_of(scene: Scene, chain: Chain | None = None) -> Problem:
    """The problem of a scene, on its own chain or on another one of the same links.

    Raises
    ------
    SceneError, ConvergenceError, DataFileError
        As in `lump`, `input_arrays` and `initial_state`.
    """
    chain = lump(scene) if chain is None else chain
    inputs = input_arrays(scene, chain)
    return Problem(scene, chain, inputs, *state_under(inputs, scene, chain))
