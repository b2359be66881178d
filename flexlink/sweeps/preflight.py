"""Check before the first run that the keys, engines and output columns of a sweep exist."""

from __future__ import annotations

import contextlib

from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError
from flexlink.common.wording import did_you_mean, truncated
from flexlink.engines import load
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.record import trajectory_from_states
from flexlink.sweeps.measures import DEFLECTION, MEASURES
from flexlink.sweeps.plan import Plan


def preflight(plan: Plan) -> None:
    """Refuse a sweep with unknown keys or output columns; values are checked later, member by member.

    Raises
    ------
    SceneError
        A key is not a path of the scene, or the first and the last member both lack the column of an output.
    MissingDependencyError
        An engine of the members is not installed.
    """
    plan.check_paths()
    columns: list[str] = []
    for number in {0, plan.members - 1}:
        with contextlib.suppress(FlexlinkError):  # the sweep reports the error in this member's row
            columns += _columns(plan, number)
    if columns:
        of_runs = ("work [J]", "imbalance [J]")  # columns that a run has, but a single state lacks
        known = list(dict.fromkeys([*columns, *of_runs, DEFLECTION, *MEASURES]))
        for name, quantity in plan.sweep.quantity.items():
            if quantity.of not in known:
                raise SceneError(
                    f"quantity.{name}.of = {truncated(quantity.of)}: no such quantity; allowed are {', '.join(known)}"
                    f"{did_you_mean(quantity.of, known)}",
                    id="unknown-quantity",
                )
    chain = lump(plan.sweep.scene)
    for engine in plan.engines:
        with contextlib.suppress(ArgumentError):  # an unknown engine, or one that does not support this chain
            load(engine, chain)


def _columns(plan: Plan, number: int) -> list[str]:
    """Names of the columns of a member's initial state."""
    scene, _ = plan.member(number)
    start = problem_of(scene)
    return list(trajectory_from_states(start, scene.run.times[:1], start.q[None], start.qd[None]).columns)
