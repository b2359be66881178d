"""Tasks on an executor: half a second each, as many as keep it busy, again where a worker died, until all are done."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from itertools import islice

import msgspec

from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.common.interruption import Stop
from flexlink.kernels.tools.lanes import LANES
from flexlink.sweeps.fingerprint import version
from flexlink.sweeps.members import Row, Rows, goes_side_by_side, greet, lost, rows_of
from flexlink.sweeps.plan import Plan
from flexlink.sweeps.workers import Pool

SECONDS = 0.5
"""What a task is to take: far more than its way to a worker and back, and little to lose by a kill."""

LARGEST, FASTER = 1024, 4
"""Members of a task; times as many as in the one before, which may have waited for machine code."""

DEATHS = 3
"""Workers that a member may take along, each time alone, before it is a row that says so."""

BREATH = 0.2
"""How often a signal is looked for while workers work [s]."""

Numbers = list[int]


class Execution:
    """The tasks of a sweep.

    A task that has failed, or whose worker died, is tried again with nothing beside it, then by halves, so that the one
    member that does it is found.
    """

    def __init__(self, plan: Plan, pool: Pool, stop: Stop) -> None:
        self.plan, self.pool, self.stop = plan, pool, stop
        self.question = msgspec.json.encode(plan.sweep), version()
        self.running: dict[Future[Rows], Numbers] = {}
        self.suspects: deque[Numbers] = deque()
        self.deaths: Counter[int] = Counter()
        self.size = LANES

    def rows(self, missing: Iterator[int]) -> Iterator[list[Row]]:
        """The rows of the missing members, task by task, in the order in which they are done.

        Raises
        ------
        EngineError
            No worker can do anything: another version of flexlink, none that starts, none that is left.
        """
        self._greet()
        while not self.stop.asked:
            self._fill(missing)
            if not self.running:
                return
            for future in wait(self.running, BREATH, FIRST_COMPLETED).done:
                if future in self.running:
                    yield self._answer(future, self.running.pop(future))
        for future in wait(self.running, 0).done:  # what was done when the signal came
            if future.exception() is None:
                yield future.result().rows

    def _greet(self) -> None:
        try:
            self.pool.executor.submit(greet, *self.question).result()
        except FlexlinkError:
            raise
        except BrokenExecutor:
            raise EngineError(
                "workers ended while they started; a script that starts processes does so below "
                "if __name__ == '__main__':"
            ) from None
        except Exception as error:
            raise EngineError(f"workers cannot run flexlink: {type(error).__name__}: {error}") from None

    def _fill(self, missing: Iterator[int]) -> None:
        """Start as many tasks as there is room for; one alone while there are suspects."""
        while self.suspects and not self.running:
            self._start(self.suspects.popleft())
        while not self.suspects and len(self.running) < self.pool.slots and not self.stop.asked:
            numbers = self._next(missing)
            if not numbers:
                break
            self._start(numbers)

    def _next(self, missing: Iterator[int]) -> Numbers:
        numbers = list(islice(missing, 1))
        if numbers:
            least = LANES if goes_side_by_side(self.plan, numbers[0]) else 1
            numbers += islice(missing, max(self.size // least, 1) * least - 1)
        return numbers

    def _start(self, numbers: Numbers) -> None:
        try:
            future = self.pool.executor.submit(rows_of, *self.question, numbers)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        self.running[future] = numbers

    def _answer(self, future: Future[Rows], numbers: Numbers) -> list[Row]:
        try:
            rows, seconds = future.result()
        except FlexlinkError:
            raise
        except BrokenExecutor:
            return self._after_death(numbers)
        except CancelledError:
            raise EngineError("the cluster is gone; all rows are kept, and the same command goes on") from None
        except Exception as error:  # of one member, whatever it is
            return self._after_failure(numbers, f"{type(error).__name__}: {error}")
        wanted = len(numbers) * SECONDS / max(seconds, 1e-6)
        self.size = int(min(wanted, FASTER * len(numbers), LARGEST))
        if len(rows) < len(numbers) and not self.stop.asked:  # its worker was told to stop, and this sweep was not
            self.suspects.append(sorted({*numbers} - {row.number for row in rows}))
        return rows

    def _after_death(self, numbers: Numbers) -> list[Row]:
        """All that ran was lost; which of the tasks it was shows when each runs alone."""
        lost_tasks = [numbers, *self.running.values()]
        self.running.clear()
        if not self.pool.replace():
            raise EngineError("the executor is broken; all rows are kept, and the same call goes on with another one")
        if len(lost_tasks) > 1:
            self.suspects += lost_tasks
            return []
        self.deaths.update(numbers)
        if len(numbers) == 1 and self.deaths[numbers[0]] < DEATHS:
            self.suspects.appendleft(numbers)
            return []
        return self._after_failure(numbers, f"the process that ran it ended {DEATHS} times")

    def _after_failure(self, numbers: Numbers, reason: str) -> list[Row]:
        """By halves, down to the one member whose row it is."""
        if len(numbers) == 1:
            return [lost(self.plan, numbers[0], reason)]
        middle = len(numbers) // 2
        self.suspects.extendleft([numbers[middle:], numbers[:middle]])
        return []
