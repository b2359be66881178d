"""sweep(…): run members side by side and on several workers, in repeatable tasks of half a second, into one table."""

from __future__ import annotations

import signal
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, suppress
from itertools import islice
from pathlib import Path

import msgspec

from flexlink.chain.arguments import integer, require_bool, require_callable, require_type, sequence
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, EngineError, FlexlinkError, InterruptedSweepError, SceneError
from flexlink.common.interruption import Stop, deferred, word
from flexlink.common.wording import did_you_mean, plural, truncated
from flexlink.data.documents import require_path
from flexlink.describe.scene import FIELDS
from flexlink.describe.vary import apply_changes
from flexlink.engines import load
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.side_by_side import Block
from flexlink.results.record import trajectory_from_states
from flexlink.sweeps.measures import DEFLECTION, MEASURES
from flexlink.sweeps.plan import Plan, Sweep, fingerprint, version
from flexlink.sweeps.statistics import Summary, kept
from flexlink.sweeps.store import Store, store_of, take_parts
from flexlink.sweeps.table import SweepRows
from flexlink.sweeps.worker import Row, failed_row, goes_side_by_side, handshake, rows_of
from flexlink.sweeps.workers import MAX_WORKERS, WorkerPool, pool_of


def sweep(
    what: Sweep | str | Path, *, out: str | Path | None = None,
    executor: Executor | Callable[[], Executor] | None = None, workers: int = 1, dask: str | None = None,
    slots: int | None = None, part: str | None = None, merge: Iterable[str | Path] = (), fresh: bool = False,
    progress: Callable[[float], None] | None = None,
) -> SweepRows:  # fmt: skip
    """Run every member of a sweep; each gives one row of outputs.

    Members with the same structure run eight at a time, side by side. A member that is refused, diverges, or crashes
    its process three times gets a row with the reason. Rows are bitwise reproducible on processors of the same kind;
    they do not depend on other members or on the executor.

    Parameters
    ----------
    what
        The sweep, or the path of its file.
    out
        SQLite database for the rows, written as they are computed. After an interruption or a crash, the same call
        continues the sweep. None: rows stay in memory.
    executor
        Executor of the members: any `concurrent.futures.Executor`, or a function that returns one and is called again
        if the executor breaks. None: see `workers` and `dask`.
    workers
        Number of processes; 1: no separate process.
    dask
        Address of a Dask scheduler, for example "tcp://10.0.0.1:8786".
    slots
        Number of tasks to run at once. None: twice the number of workers, which may grow while the sweep runs; needed
        for an executor that has no attribute `max_workers`.
    part
        Run only a part, "17/200" for the 17th of 200, each with its own `out`.
    merge
        Databases of all parts; their rows go to `out`, equal bit for bit to those of a sweep in one piece.
    fresh
        Whether to delete the rows in `out` first.
    progress
        Called with the fraction of members that have a row.

    Returns
    -------
    SweepRows
        All rows; if the sweep has `statistics`, a row of them for each output.

    Raises
    ------
    ArgumentError
        An argument is out of range, `out` has rows of another sweep, scene or version, or a part is missing.
    SceneError
        A key, a range or an output is not valid.
    OutputError
        `out` cannot be written, is not a database of a sweep, or another process writes to it.
    EngineError
        No worker can run members; existing rows remain.
    KeyboardInterrupt
        Ctrl-C or SIGTERM, the number of which is its attribute `signal`; existing rows remain.

    Examples
    --------
    >>> plan = fl.Sweep(
    ...     scene=scene.varied({"run.duration": 0.1}),
    ...     grid={"tip.mass": [1.0, 2.0]},
    ...     quantity={"height [m]": {"of": "tip y [m]"}},
    ... )
    >>> rows = fl.sweep(plan)  # out="masses.db" keeps them; workers=2
    >>> print(rows.failed, rows.to_pandas()["height [m]"].round(2).tolist())
    {} [0.13, 0.12]
    """
    require_callable("progress", progress)
    count = integer("workers", workers, 1, MAX_WORKERS)
    if slots is not None:
        integer("slots", slots, 1)
    plan = Plan(Sweep.load(what) if isinstance(what, str | Path) else require_type("what", what, Sweep))
    path = None if out is None else require_path("out", out)
    parts = [require_path("merge", file) for file in sequence("merge", merge, "path")]
    preflight(plan)
    with store_of(plan)(path, plan, fingerprint(plan.sweep), part=part, fresh=require_bool("fresh", fresh)) as store:
        take_parts(store, parts)
        fill(store, pool_of(executor, count, dask, slots), progress or (lambda _: None))
        columns, rows = store.table()
        return SweepRows(tuple(columns), tuple(rows))


def fill(store: Store, workers: AbstractContextManager[WorkerPool], progress: Callable[[float], None]) -> None:
    """Run the members that have no row."""
    plan, done, members = store.plan, store.count(), len(store.members)
    if done == members:
        return
    with deferred() as stop:
        with workers as pool:
            progress(done / members)
            for rows in Execution(plan, pool, stop).rows(store.missing()):
                store.add(rows)
                done += _count(rows)
                progress(done / members)
        if done < members:
            end = f"in {store.path}; repeat the command to continue" if store.path else "lost; specify out to save them"
            text = f"{done} of {plural(members, 'row')} {'is' if done == 1 else 'are'} {end}"
            number = stop.signal or signal.SIGINT
            raise InterruptedSweepError(f"{word(number)}; {text}", number)


def preflight(plan: Plan) -> None:
    """Refuse a sweep with unknown keys or output columns; values are checked later, member by member."""
    changes = {**plan.sweep.set, **plan.values(0)}
    changes.pop("engine", None)
    apply_changes(plan.sweep.scene.document(), FIELDS, changes)
    columns: list[str] = []
    for number in {0, plan.members - 1}:
        with suppress(FlexlinkError):  # the sweep reports the error in this member's row
            scene, _ = plan.member(number)
            start = problem_of(scene, tied=True)
            columns += trajectory_from_states(start, scene.run.times[:1], start.q[None], start.qd[None]).columns
    if columns:
        of_runs = ("work [J]", "imbalance [J]")  # columns that a run has, but a single state lacks
        known = list(dict.fromkeys([*columns, *of_runs, DEFLECTION, *MEASURES]))
        for name, quantity in plan.sweep.quantity.items():
            if quantity.of not in known:
                allowed = f"allowed are {', '.join(known)}{did_you_mean(quantity.of, known)}"
                why = f"quantity.{name}.of = {truncated(quantity.of)}: no such quantity; {allowed}"
                raise SceneError(why, id="unknown-quantity")
    chain = lump(open_chain(plan.sweep.scene))
    for engine in plan.engines:
        with suppress(ArgumentError):  # an unknown engine, or one that does not support this chain
            load(engine, chain)


TASK_SECONDS = 0.5
"""Duration of a task [s]: much longer than its transfer, and short enough to repeat if the worker dies."""

MAX_WORKER_DEATHS = 3
"""Number of crashes of a worker that runs only one member, after which the member's row reports the crash."""

Numbers = list[int]
Rows = Sequence[Row | Summary]
Task = Future[tuple[Rows, float]]


def _count(rows: Rows) -> int:
    """Number of members."""
    return sum(stop - first for row in rows for first, stop in row.members)


class Execution:
    """The tasks of a sweep; one that fails, or whose worker dies, is repeated alone, then in halves, to find why."""

    def __init__(self, plan: Plan, pool: WorkerPool, stop: Stop) -> None:
        self.plan, self.pool, self.stop = plan, pool, stop
        self.question = msgspec.json.encode(plan.sweep), version()  # sent to the workers with every task
        self.running: dict[Task, Numbers] = {}  # numbers of the members of each task
        self.suspects: deque[Numbers] = deque()  # tasks to repeat one at a time, since one member may crash a worker
        self.deaths: Counter[int] = Counter()  # crashed workers by the number of the member
        self.size = Block.lanes  # number of members of the next task

    def rows(self, missing: Iterator[int]) -> Iterator[Rows]:
        """Rows of the missing members, task by task, in the order of completion."""
        self._handshake()
        poll_interval = 0.2  # longest reaction time to a signal [s]
        while not self.stop.requested:
            self._fill(missing)
            if not self.running:
                return
            for future in wait(self.running, poll_interval, FIRST_COMPLETED).done:
                if future in self.running:
                    yield self._answer(future, self.running.pop(future))
        for future in wait(self.running, 0).done:  # tasks that were complete when the signal arrived
            if future.exception() is None:
                yield future.result()[0]

    def _handshake(self) -> None:
        try:
            self.pool.executor.submit(handshake, *self.question).result()
        except FlexlinkError:
            raise
        except BrokenExecutor:
            why = "workers ended during their start; call sweep(workers=…) in a script below if __name__ == '__main__':"
            raise EngineError(why, id="workers-failed") from None
        except Exception as error:
            why = f"workers cannot run flexlink: {type(error).__name__}: {error}"
            raise EngineError(why, id="workers-failed") from None

    def _fill(self, missing: Iterator[int]) -> None:
        """Start tasks until all workers are busy; only one task at a time while a member is suspected of crashes."""
        while self.suspects and not self.running:
            self._start(self.suspects.popleft())
        slots = self.pool.slots
        while not self.suspects and len(self.running) < slots and not self.stop.requested:
            numbers = self._next(missing)
            if not numbers:
                break
            self._start(numbers)

    def _next(self, missing: Iterator[int]) -> Numbers:
        numbers = list(islice(missing, 1))
        if numbers:
            least = Block.lanes if goes_side_by_side(self.plan, numbers[0]) else 1
            numbers += islice(missing, max(self.size // least, 1) * least - 1)
        return numbers

    def _start(self, numbers: Numbers) -> None:
        try:
            future = self.pool.executor.submit(rows_of, *self.question, numbers)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        self.running[future] = numbers

    def _answer(self, future: Task, numbers: Numbers) -> Rows:
        try:
            rows, seconds = future.result()
        except FlexlinkError:
            raise
        except BrokenExecutor:
            return self._after_death(numbers)
        except CancelledError:
            why = "the cluster is gone; existing rows remain: repeat the command to continue"
            raise EngineError(why, id="cluster-gone") from None
        except Exception as error:  # an error that a member causes
            return self._after_failure(numbers, f"{type(error).__name__}: {error}")
        size = len(numbers) * TASK_SECONDS / max(seconds, 1e-6)  # number of members that take half a second
        self.size = int(min(size, 4 * len(numbers), 4096))  # grow slowly: the first task includes compilation
        if _count(rows) < len(numbers) and not self.stop.requested:  # only the worker received a signal
            had = {number for row in rows for first, stop in row.members for number in range(first, stop)}
            self.suspects.append(sorted({*numbers} - had))
        return rows

    def _after_death(self, numbers: Numbers) -> Rows:
        """Repeat all running tasks (they are lost) one by one, to find the member that crashes its worker."""
        lost_tasks = [numbers, *self.running.values()]
        self.running.clear()
        if not self.pool.replace():
            why = "the executor is broken; existing rows remain: repeat the call with a new executor"
            raise EngineError(why, id="cluster-gone")
        if len(lost_tasks) > 1:
            self.suspects += lost_tasks
            return []
        self.deaths.update(numbers)
        if len(numbers) == 1 and self.deaths[numbers[0]] < MAX_WORKER_DEATHS:
            self.suspects.appendleft(numbers)
            return []
        return self._after_failure(numbers, f"its worker process crashed {MAX_WORKER_DEATHS} times")

    def _after_failure(self, numbers: Numbers, reason: str) -> Rows:
        """Repeat the task in halves until the member that fails is found."""
        if len(numbers) == 1:
            return kept(self.plan, [failed_row(self.plan, numbers[0], reason)])
        middle = len(numbers) // 2
        self.suspects.extendleft([numbers[middle:], numbers[:middle]])
        return []
