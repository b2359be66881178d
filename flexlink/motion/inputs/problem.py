"""The initial value problem of a scene, built in one place for all modules that integrate it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.chain.variants import lump_many
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.sensors.placement import check_placements
from flexlink.kernels.inputs.record import Inputs
from flexlink.motion.inputs.actuation import input_arrays, of_kind
from flexlink.motion.inputs.initial_state import state_under
from flexlink.motion.inputs.references import check_start


def problem_of(scene: Scene, chain: Chain | None = None, inputs: Inputs | None = None) -> InitialValueProblem:
    """The problem of a scene, with its own chain or another chain of the same links; known `inputs` are reused.

    Raises
    ------
    SceneError, ConvergenceError, DataFileError
        As in `lump`, `input_arrays` and `initial_state`.
    """
    chain = of_kind(scene, lump(scene) if chain is None else chain)
    base = FloatingBase(chain) if chain.has_free_base else None
    chain = chain if base is None else base.chain
    check_placements(scene)
    inputs = input_arrays(scene, chain) if inputs is None else inputs
    return InitialValueProblem(scene, chain, inputs, *state_under(inputs, scene, chain), base)


def problems_of(scenes: Sequence[Scene]) -> list[InitialValueProblem | FlexlinkError]:
    """Return `problem_of` each scene, or its error; arms without drives and loads share their inputs."""
    found: list[InitialValueProblem | FlexlinkError] = []
    before: InitialValueProblem | None = None
    for scene, chain in zip(scenes, lump_many(scenes), strict=True):
        try:
            if isinstance(chain, FlexlinkError):
                raise chain
            shares = before is not None and not chain.has_free_base and _acts_alike(before.scene, scene)
            problem = problem_of(scene, chain, before.inputs if before is not None and shares else None)
            before = problem if problem.base is None else before
            found.append(problem)
        except FlexlinkError as error:
            found.append(error)
    return found


def _acts_alike(one: Scene, scene: Scene) -> bool:
    """Whether two scenes can share inputs: these must not depend on the arm, and runs must not write to them."""
    free = (
        not (one.motion or scene.motion or one.wrench.varies or one.wrench.on)
        and one.drive.kind == scene.drive.kind == "none"
    )
    return free and one.wrench == scene.wrench


def started(problem: InitialValueProblem, scene: Scene) -> InitialValueProblem:
    """The problem with the initial state of another scene that is otherwise equal; errors as in `problem_of`."""
    check_start(scene, problem.chain)
    q, qd = state_under(problem.inputs, scene, problem.chain)
    return dataclasses.replace(problem, scene=scene, q=q, qd=qd)
