"""Task of a worker: build the scenes of members from their numbers, run them side by side, return their rows."""

import functools
import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

import msgspec

from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.engines import load
from flexlink.motion.batch import Outcome, ends_of
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.side_by_side import Run
from flexlink.results.record import trajectory_from_states
from flexlink.results.stop_reasons import InterruptedRunError
from flexlink.results.trajectory import Trajectory
from flexlink.sweeps.measures import measured, measured_together
from flexlink.sweeps.plan import Plan, Sweep, version
from flexlink.sweeps.statistics import Summary, kept


class Row(NamedTuple):
    """Row of a member."""

    number: int
    status: Literal["done", "failed"]
    reason: str  # reason of a failure, otherwise empty
    warnings: str
    values: tuple[float | None, ...]  # outputs, in the order of `quantity`

    @property
    def members(self) -> list[tuple[int, int]]:
        """Range [first, stop) of numbers, as of a `Summary`."""
        return [(self.number, self.number + 1)]


def rows_of(text: bytes, theirs: str, numbers: Sequence[int]) -> tuple[Sequence[Row | Summary], float]:
    """Compute the rows of members or their summary, and the time that they take [s]; a signal leaves members out.

    `text` is the sweep, encoded by `msgspec.json`; `theirs` is the version of flexlink that started it.
    """
    together = 512  # number of members to prepare together; their chains take a few megabytes
    started = time.perf_counter()
    handshake(text, theirs)
    plan = plan_of(text)
    with deferred() as stop:
        rows = []
        for part in (numbers[first : first + together] for first in range(0, len(numbers), together)):
            if stop.requested:
                break
            ends = zip(part, _ends(plan, part, stop), strict=True)
            rows += [_row(plan, number, end) for number, end in ends if not isinstance(end, InterruptedRunError)]
    return kept(plan, rows), time.perf_counter() - started


def handshake(text: bytes, theirs: str) -> None:
    """Check that the worker has the same version of flexlink as the main process, and can decode the sweep."""
    if theirs != version():
        why = f"a worker has flexlink {version()}, but the sweep was started by flexlink {theirs}; install the same one"
        raise EngineError(why, id="versions-differ")
    plan_of(text)


@functools.lru_cache(maxsize=4)
def plan_of(text: bytes) -> Plan:
    """Decode a sweep, and return its plan."""
    return Plan(msgspec.json.decode(text, type=Sweep))


def failed_row(plan: Plan, number: int, reason: str) -> Row:
    """Row of a failed member, without outputs."""
    return Row(number, "failed", reason, "", (None,) * len(plan.sweep.quantity))


def goes_side_by_side(plan: Plan, number: int) -> bool:
    """Whether a member runs side by side with others: eight such members together cost little more than one."""
    try:
        scene, engine = plan.member(number)
    except FlexlinkError:
        return True
    alone = scene.wrench.varies or scene.wrench.on or scene.ties or scene.run.solver != "articulated"
    return engine == "native" and not alone and steps_explicitly(scene.run)


def _ends(plan: Plan, numbers: Sequence[int], stop: Stop) -> list[Row | Outcome]:
    """Rows of the members that ran side by side, and the outcomes of the others."""
    results: dict[int, Row | Outcome] = {}
    native: dict[int, Scene] = {}
    for number in numbers:
        try:
            scene, engine = plan.member(number)
            if engine == "native":
                native[number] = scene
            else:
                problem = problem_of(scene)
                results[number] = trajectory_from_states(problem, *load(engine, problem.original).integrate(scene))
        except FlexlinkError as error:
            results[number] = error
    block, values = None, []
    for number, end in zip(native, ends_of(list(native.values()), stop), strict=True):
        if isinstance(end, Run):
            if end.block is not block:
                block, values = end.block, measured_together(plan.sweep.quantity, end.block)
            results[number] = _done(number, *values[end.place], block.monitors[end.place].warnings)
        else:
            results[number] = end
    return [results[number] for number in numbers]


def _row(plan: Plan, number: int, end: Row | Outcome) -> Row:
    if isinstance(end, Row):
        return end
    if not isinstance(end, Trajectory):
        return failed_row(plan, number, f"{type(end).__name__}: {end}")
    return _done(number, *measured(plan.sweep.quantity, end), end.warnings)


def _done(number: int, values: tuple[float | None, ...], reason: str, warnings: Sequence[str]) -> Row:
    return Row(number, "failed" if reason else "done", reason, "\n".join(warnings), values)
