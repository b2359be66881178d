"""The problem of a scene, put together in one place for whatever integrates it."""

from __future__ import annotations

import dataclasses

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.initial_state import state_under
from flexlink.inputs.references import check_start


def problem_of(scene: Scene, chain: Chain | None = None) -> InitialValueProblem:
    """The problem of a scene, on its own chain or on another one of the same links.

    Raises
    ------
    SceneError, ConvergenceError, DataFileError
        As in `lump`, `input_arrays` and `initial_state`.
    """
    chain = lump(scene) if chain is None else chain
    inputs = input_arrays(scene, chain)
    return InitialValueProblem(scene, chain, inputs, *state_under(inputs, scene, chain))


def started(problem: InitialValueProblem, scene: Scene) -> InitialValueProblem:
    """The problem with the start of another scene, which differs in nothing else; errors as above."""
    check_start(scene, problem.chain)
    q, qd = state_under(problem.inputs, scene, problem.chain)
    return dataclasses.replace(problem, scene=scene, q=q, qd=qd)
