"""Executors of a sweep: the calling thread, worker processes, a Dask cluster, or the caller's executor."""

import contextlib
import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any

from flexlink.common.errors import ArgumentError, Diagnostic, EngineError, imported
from flexlink.common.wording import truncated

TASKS_PER_WORKER = 2  # number of queued tasks per worker: one that runs, and one that is ready

MAX_WORKERS = 1024
"""Largest number of processes; no machine has more cores, and this number needs a few hundred gigabytes of memory."""

DASK_TIMEOUT = 10  # longest wait for an answer of the scheduler and for its first worker [s]


class InThread(Executor):
    """Executor that runs tasks immediately in the calling thread."""

    def submit(self, task: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Run a task and return its completed future."""
        future: Future[Any] = Future()
        try:
            future.set_result(task(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class Workers(ProcessPoolExecutor):
    """Processes that end immediately on `shutdown`, or when their parent ends for any reason.

    Each process watches a pipe whose other end only the parent has; the pipe closes on `shutdown`, or when the parent
    ends. Ctrl-C in a terminal reaches all processes; workers ignore it, also while they start, and their parent handles
    it.
    """

    def __init__(self, count: int) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would keep the pipe open, and copy locks of threads
        self._watched, self._held = context.Pipe(duplex=False)
        super().__init__(count, mp_context=context, initializer=end_with, initargs=(self._watched,))

    def submit(self, task: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Queue a task; a process that starts for it inherits that Ctrl-C waits, until it ignores it."""
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            return super().submit(task, *arguments, **named)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(task, *arguments, **named)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes immediately."""
        self._held.close()
        super().shutdown(wait, cancel_futures=cancel_futures)


def end_with(watched: Connection) -> None:
    """End this process when the other end of a pipe closes; nothing is ever sent through it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    exit_when_closed(watched)


def workers_in(executor: Executor) -> int | None:
    """Number of workers that an executor names, which may be 0 at first; None if it names none."""
    named = (getattr(executor, name, None) for name in ("max_workers", "_max_workers"))
    return next((count for count in named if isinstance(count, int)), None)


class WorkerPool:
    """An executor of tasks, the function that replaces it, and the number of tasks that keep it busy."""

    def __init__(
        self, make: Callable[[], Executor], slots: int | None, *, again: bool = False,
        workers: Callable[[Executor], int | None] = workers_in,
    ) -> None:  # fmt: skip
        self.make, self.again, self.workers = make, again, workers
        self.executor = make()
        self._fixed = slots
        if slots is None and workers(self.executor) is None:
            self._fixed = TASKS_PER_WORKER * (os.cpu_count() or 1)
            why = f"{truncated(self.executor)}: names no number of workers, so {self._fixed} tasks run at once"
            warnings.warn(Diagnostic(f"{why}; give slots", "slots-guessed"), RuntimeWarning, stacklevel=2)

    @property
    def slots(self) -> int:
        """Number of tasks that keep all workers busy; workers may come and go."""
        return self._fixed or TASKS_PER_WORKER * max(1, self.workers(self.executor) or 0)

    def replace(self) -> bool:
        """Replace a broken executor; return False if it cannot be replaced."""
        if self.again:
            self.executor.shutdown(wait=False, cancel_futures=True)
            self.executor = self.make()
        return self.again


@contextlib.contextmanager
def pool_of(
    executor: Executor | Callable[[], Executor] | None, workers: int, dask: str | None, slots: int | None = None
) -> Iterator[WorkerPool]:
    """Pool with the caller's executor, or one made by the caller's function, or an executor for `dask` or `workers`."""
    if isinstance(executor, Executor):  # the caller shuts it down
        yield WorkerPool(lambda: executor, slots)
    elif callable(executor):
        yield from _own(WorkerPool(executor, slots, again=True))
    elif executor is not None:
        why = f"executor = {truncated(executor)}: expected a concurrent.futures.Executor or a function"
        raise ArgumentError(why, id="wrong-type")
    elif dask is not None:
        yield from _on_cluster(dask, slots)
    elif workers > 1:
        yield from _own(WorkerPool(lambda: Workers(workers), slots, again=True))
    else:
        yield WorkerPool(InThread, 1)


def _own(pool: WorkerPool) -> Iterator[WorkerPool]:
    try:
        yield pool
    finally:
        pool.executor.shutdown(wait=False, cancel_futures=True)


def _on_cluster(address: str, slots: int | None) -> Iterator[WorkerPool]:
    """Pool on the cluster of a Dask scheduler at an address, for example tcp://10.0.0.1:8786."""
    distributed = imported("distributed", "a Dask cluster needs distributed;", "dask")
    try:
        client = distributed.Client(address, timeout=DASK_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EngineError(f"{address}: no Dask scheduler responds: {error}", id="no-scheduler") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=DASK_TIMEOUT)
        except TimeoutError:
            why = f"{address}: the scheduler has no workers; start some with: dask worker {address}"
            raise EngineError(why, id="no-scheduler") from None

        def threads(_: Executor) -> int:
            with contextlib.suppress(OSError):  # tasks on a cluster that is gone end with an error
                return int(sum(client.nthreads().values()))
            return 0

        yield WorkerPool(client.get_executor, slots, workers=threads)


def exit_when_closed(pipe: Connection | int) -> None:
    """End this process as soon as the other end of a pipe is closed, whatever Python code it is running.

    `pipe` is this process's end, or its file descriptor; nothing is ever sent through it. The operating system closes
    the other end when its owner ends, for whatever reason.
    """
    Thread(target=lambda: (wait([pipe]), os._exit(1)), daemon=True).start()
