"""The initial value problem of a scene, built in one place for all modules that integrate it."""

import dataclasses
import math

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.describe.scene import Scene
from flexlink.describe.spec import build_unchecked, build_validated
from flexlink.describe.tie import refuse_ties
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.ties import tie_rows
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.tools.finite import is_finite
from flexlink.motion.inputs.actuation import input_arrays, of_kind
from flexlink.motion.inputs.initial_state import state_under
from flexlink.motion.inputs.references import check_start


def problem_of(
    scene: Scene, chain: Chain | None = None, inputs: Inputs | None = None, *, tied: bool = False
) -> InitialValueProblem:
    """The problem of a scene, with its own chain or another chain of the same links; known `inputs` are reused.

    Scenes with ties are refused unless the caller supports them, `tied`; other errors are as in `lump`, `input_arrays`
    and `initial_state`.
    """
    if not tied:
        refuse_ties(scene.ties)
    chain = of_kind(scene, lump(open_chain(scene)) if chain is None else chain)
    ties = tie_rows(scene, chain)
    base = FloatingBase(chain) if chain.has_free_base else None
    chain = chain if base is None else base.chain
    if scene.sensor:
        from flexlink.dynamics.sensors.signals import check_placements  # noqa: PLC0415

        check_placements(scene)
    inputs = input_arrays(scene, chain) if inputs is None else inputs
    return InitialValueProblem(scene, chain, inputs, *state_under(inputs, scene, chain, ties), ties, base)


def started(problem: InitialValueProblem, scene: Scene) -> InitialValueProblem:
    """The problem with the initial state of another scene that is otherwise equal; errors as in `problem_of`."""
    check_start(scene, problem.chain)
    q, qd = state_under(problem.inputs, scene, problem.chain, problem.ties)
    return dataclasses.replace(problem, scene=scene, q=q, qd=qd)


def started_from(
    scene: Scene, q0: ArrayLike | None, qd0: ArrayLike | None, t0: float | None, **changes: object
) -> Scene:
    """The scene with these changes by path and this initial state; None leaves a part of the state unchanged.

    States that are arrays of finite numbers are not validated again, which reduces the time to a tenth, and to a
    hundredth at the same time: nothing else in a scene depends on the state.
    """
    if q0 is None and qd0 is None and t0 is None and not changes:
        return scene
    start: dict[str, object] = {} if t0 is None else {"initial.time": t0}
    if q0 is not None:
        start |= {"initial.passive": None, "initial.q": q0}
    if qd0 is not None:
        start |= {"initial.rate_deg": None, "initial.rate_m": None, "initial.qd": qd0}
    known = _is_read(q0) and _is_read(qd0) and (t0 is None or (isinstance(t0, float) and 0.0 <= t0 < math.inf))
    if changes or not known:
        return scene.varied(changes | start)
    initial: dict[str, object] = {} if t0 is None else {"time": float(t0)}
    if isinstance(q0, np.ndarray):
        initial |= {"q": tuple(q0.tolist()), "passive": "zero"}
    if isinstance(qd0, np.ndarray):
        initial |= {"qd": tuple(qd0.tolist()), "rate_deg": None, "rate_m": None}
    build = build_validated if t0 is not None and t0 != scene.initial.time else build_unchecked
    started: Scene = build(replace, scene, initial=build(replace, scene.initial, **initial))
    return started


def _is_read(state: ArrayLike | None) -> bool:
    if state is None:
        return True
    return isinstance(state, np.ndarray) and state.dtype == np.float64 and state.ndim == 1 and is_finite(state)
