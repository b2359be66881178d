"""The problem of a scene, put together in one place for whatever integrates it."""

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
from flexlink.motion.inputs.actuation import input_arrays, of_kind
from flexlink.motion.inputs.initial_state import state_under
from flexlink.motion.inputs.references import check_start


def problem_of(scene: Scene, chain: Chain | None = None) -> InitialValueProblem:
    """The problem of a scene, on its own chain or on another one of the same links.

    Raises
    ------
    SceneError, ConvergenceError, DataFileError
        As in `lump`, `input_arrays` and `initial_state`.
    """
    chain = of_kind(scene, lump(scene) if chain is None else chain)
    base = FloatingBase(chain) if chain.has_free_base else None
    chain = chain if base is None else base.chain
    check_placements(scene)
    inputs = input_arrays(scene, chain)
    return InitialValueProblem(scene, chain, inputs, *state_under(inputs, scene, chain), base)


def problems_of(scenes: Sequence[Scene]) -> list[InitialValueProblem | FlexlinkError]:
    """The problem of every scene as `problem_of` makes it, or the error that it raises; free arms share inputs."""
    found: list[InitialValueProblem | FlexlinkError] = []
    before: InitialValueProblem | None = None
    for scene, lumped in zip(scenes, lump_many(scenes), strict=True):
        try:
            if isinstance(lumped, FlexlinkError):
                found.append(lumped)
                continue
            chain = of_kind(scene, lumped)
            if chain.has_free_base:
                found.append(problem_of(scene, chain))
                continue
            check_placements(scene)
            same = before is not None and _acts_alike(before.scene, scene)
            inputs = before.inputs if same and before is not None else input_arrays(scene, chain)
            before = InitialValueProblem(scene, chain, inputs, *state_under(inputs, scene, chain))
            found.append(before)
        except FlexlinkError as error:
            found.append(error)
    return found


def _acts_alike(one: Scene, scene: Scene) -> bool:
    """Whether the same acts on two arms, of which no part knows the arm and nothing is written in a run."""
    free = (
        not (one.motion or scene.motion or one.wrench.varies or one.wrench.on)
        and one.drive.kind == scene.drive.kind == "none"
    )
    return free and one.wrench == scene.wrench


def started(problem: InitialValueProblem, scene: Scene) -> InitialValueProblem:
    """The problem with the start of another scene, which differs in nothing else; errors as above."""
    check_start(scene, problem.chain)
    q, qd = state_under(problem.inputs, scene, problem.chain)
    return dataclasses.replace(problem, scene=scene, q=q, qd=qd)
