"""What can be known of a sweep before its first run: that keys lead somewhere, engines are there, columns exist."""

from __future__ import annotations

import contextlib

from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError
from flexlink.describe.spec import did_you_mean, truncated
from flexlink.engines import load
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.initial_state import initial_state
from flexlink.results.record import trajectory_from_states
from flexlink.sweeps.measures import DEFLECTION, MEASURES
from flexlink.sweeps.plan import Plan

OF_NATIVE = ("work [J]", "imbalance [J]")
"""Columns that a run has, and a state has not."""


def require_possible(plan: Plan) -> None:
    """Refuse a sweep no member of which could have all its numbers; whether a value fits is a member's own matter.

    Raises
    ------
    SceneError
        A key leads nowhere, or a quantity is none of the first member and none of the last.
    MissingDependencyError
        An engine that members name is not installed.
    """
    plan.check_paths()
    columns: list[str] = []
    for number in {0, plan.members - 1}:
        with contextlib.suppress(FlexlinkError):  # that one is a row with its reason
            columns += _columns(plan, number)
    if columns:
        known = list(dict.fromkeys([*columns, *OF_NATIVE, DEFLECTION, *MEASURES]))
        for name, quantity in plan.sweep.quantity.items():
            if quantity.of not in known:
                raise SceneError(
                    f"quantity.{name}.of = {truncated(quantity.of)}: no such quantity; allowed are {', '.join(known)}"
                    f"{did_you_mean(quantity.of, known)}"
                )
    chain = lump(plan.sweep.scene)
    for engine in plan.engines:
        with contextlib.suppress(ArgumentError):  # it does not take this chain, or there is no such engine
            load(engine, chain)


def _columns(plan: Plan, number: int) -> list[str]:
    """Names of what is sampled of a member's state."""
    scene, _ = plan.member(number)
    chain = lump(scene)
    q, qd = initial_state(scene, chain)
    state = trajectory_from_states(scene, chain, input_arrays(scene, chain), scene.run.times[:1], q[None], qd[None])
    return list(state.columns)
