"""What is done with members, wherever they run: scenes from their numbers, runs side by side, one row each."""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from flexlink.chain.lumping import lump
from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.describe.conditions import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.engines import load
from flexlink.inputs.actuation import input_arrays
from flexlink.motion.batch import Outcome, outcomes
from flexlink.results.record import trajectory_from_states
from flexlink.results.stop_reasons import InterruptedRunError
from flexlink.results.trajectory import Trajectory
from flexlink.sweeps.fingerprint import version
from flexlink.sweeps.measures import measured
from flexlink.sweeps.plan import Plan, Sweep

DONE, FAILED = "done", "failed"


class Row(NamedTuple):
    """What is kept of a member."""

    number: int
    status: str
    reason: str  # of one that failed
    warnings: str
    values: tuple[float | None, ...]  # in the order of the quantities


class Rows(NamedTuple):
    """What a task has done, and how long that took."""

    rows: list[Row]
    seconds: float


def rows_of(text: bytes, theirs: str, numbers: Sequence[int]) -> Rows:
    """The rows of members: the task of a worker.

    Parameters
    ----------
    text
        The sweep, as `msgspec.json` encodes it: decoded once in a process.
    theirs
        The version of flexlink that asks; rows of two versions are not mixed.
    numbers
        The members. Those that are asked to stop have no row.

    Raises
    ------
    EngineError
        flexlink is another version here.
    """
    begun = time.perf_counter()
    greet(text, theirs)
    plan = plan_of(text)
    with deferred() as stop:
        found = _outcomes(plan, numbers, stop)
        rows = [
            _row(plan, number, outcome)
            for number, outcome in zip(numbers, found, strict=True)
            if not isinstance(outcome, InterruptedRunError)
        ]
    return Rows(rows, time.perf_counter() - begun)


def greet(text: bytes, theirs: str) -> None:
    """What a worker is asked first: whether it has the version that asks, and can read the sweep.

    Raises
    ------
    EngineError
        flexlink is another version here.
    """
    if theirs != version():
        raise EngineError(f"a worker has flexlink {version()}, but flexlink {theirs} has started the sweep")
    plan_of(text)


@functools.lru_cache(maxsize=4)
def plan_of(text: bytes) -> Plan:
    """The plan of an encoded sweep."""
    return Plan(msgspec.json.decode(text, type=Sweep))


def lost(plan: Plan, number: int, reason: str) -> Row:
    """The row of a member without numbers."""
    return Row(number, FAILED, reason, "", (None,) * len(plan.sweep.quantity))


def goes_side_by_side(plan: Plan, number: int) -> bool:
    """Whether a member shares a pass of the kernel with its neighbours, so that eight of them cost little more."""
    try:
        scene, engine = plan.member(number)
    except FlexlinkError:
        return True
    alone = scene.wrench.varies or scene.run.solver != "articulated" or not steps_explicitly(scene.run)
    return engine == "native" and not alone


def _outcomes(plan: Plan, numbers: Sequence[int], stop: Stop) -> list[Outcome]:
    found: dict[int, Outcome] = {}
    native: dict[int, Scene] = {}
    for number in numbers:
        try:
            scene, engine = plan.member(number)
            if engine == "native":
                native[number] = scene
            else:
                found[number] = _integrated(scene, engine)
        except FlexlinkError as error:
            found[number] = error
    found |= zip(native, outcomes(list(native.values()), stop), strict=True)
    return [found[number] for number in numbers]


def _integrated(scene: Scene, engine: str) -> Trajectory:
    """The run of another engine."""
    chain = lump(scene)
    return trajectory_from_states(scene, chain, input_arrays(scene, chain), *load(engine, chain).integrate(scene))


def _row(plan: Plan, number: int, outcome: Outcome) -> Row:
    if not isinstance(outcome, Trajectory):
        return lost(plan, number, f"{type(outcome).__name__}: {outcome}")
    values, reason = measured(plan.sweep.quantity, outcome)
    return Row(number, FAILED if reason else DONE, reason, "\n".join(outcome.warnings), values)
