"""Run the members of a sweep on an executor, in tasks of half a second; repeat tasks whose worker died."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from itertools import islice

import msgspec

from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.common.interruption import Stop
from flexlink.motion.side_by_side import Block
from flexlink.sweeps.plan import Plan, version
from flexlink.sweeps.worker import Row, failed_row, goes_side_by_side, handshake, rows_of
from flexlink.sweeps.workers import WorkerPool

TASK_SECONDS = 0.5
"""Duration of a task [s]: much longer than its transfer, and short enough to repeat if the worker dies."""

MAX_WORKER_DEATHS = 3
"""Number of crashes of a worker that runs only one member, after which the member's row reports the crash."""

Numbers = list[int]
Task = Future[tuple[list[Row], float]]


class Execution:
    """The tasks of a sweep; one that fails, or whose worker dies, is repeated alone, then in halves, to find why."""

    def __init__(self, plan: Plan, pool: WorkerPool, stop: Stop) -> None:
        self.plan, self.pool, self.stop = plan, pool, stop
        self.question = msgspec.json.encode(plan.sweep), version()
        self.running: dict[Task, Numbers] = {}
        self.suspects: deque[Numbers] = deque()
        self.deaths: Counter[int] = Counter()
        self.size = Block.lanes

    def rows(self, missing: Iterator[int]) -> Iterator[list[Row]]:
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
        while not self.suspects and len(self.running) < self.pool.slots and not self.stop.requested:
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

    def _answer(self, future: Task, numbers: Numbers) -> list[Row]:
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
        if len(rows) < len(numbers) and not self.stop.requested:  # only the worker received a signal
            self.suspects.append(sorted({*numbers} - {row.number for row in rows}))
        return rows

    def _after_death(self, numbers: Numbers) -> list[Row]:
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

    def _after_failure(self, numbers: Numbers, reason: str) -> list[Row]:
        """Repeat the task in halves until the member that fails is found."""
        if len(numbers) == 1:
            return [failed_row(self.plan, numbers[0], reason)]
        middle = len(numbers) // 2
        self.suspects.extendleft([numbers[middle:], numbers[:middle]])
        return []
