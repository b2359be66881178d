"""Executors that a sweep runs on: here, in processes of its own, on a Dask cluster, or the caller's."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing.connection import Connection
from typing import ParamSpec, TypeVar

from flexlink.common.errors import ArgumentError, EngineError, MissingDependencyError
from flexlink.common.processes import exit_when_closed
from flexlink.describe.spec import short

P = ParamSpec("P")
T = TypeVar("T")

AHEAD = 2
"""Tasks for each that works: one is there when another is done."""

MOST = 1024
"""Processes that a sweep starts, all at once: more than a machine has cores, and a hundred gigabytes."""

PATIENCE = 10
"""How long a scheduler, and its first worker, are waited for [s]."""


class Here(Executor):
    """Runs what it is given in this thread, at once."""

    def submit(self, task: Callable[P, T], /, *arguments: P.args, **named: P.kwargs) -> Future[T]:
        """Run it: the future that comes back is done."""
        future: Future[T] = Future()
        try:
            future.set_result(task(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class Workers(ProcessPoolExecutor):
    """Processes that end with their parent, however that ends, and at once when they are told to.

    Each waits for the other end of a pipe to be closed, which this process alone holds: by `shutdown`, or by its own
    end. Ctrl-C in a terminal goes to all processes; workers leave the answer to their parent.
    """

    def __init__(self, count: int) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would hold the pipe, and copy locks of threads
        self._watched, self._held = context.Pipe(duplex=False)
        super().__init__(count, mp_context=context, initializer=end_with, initargs=(self._watched,))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes, whatever they do."""
        self._held.close()
        super().shutdown(wait, cancel_futures=cancel_futures)


def end_with(watched: Connection) -> None:
    """Let this process end when the other end of a pipe is closed, of which nothing is ever sent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    exit_when_closed(watched)


class Pool:
    """An executor, and how it is replaced.

    Attributes
    ----------
    executor
        What takes tasks.
    slots
        How many tasks keep it busy.
    """

    def __init__(self, make: Callable[[], Executor], slots: int, *, again: bool = False) -> None:
        self.make, self.slots, self.again = make, slots, again
        self.executor = make()

    def replace(self) -> bool:
        """Put another executor in the place of a broken one; whether there is one."""
        if self.again:
            self.executor.shutdown(wait=False, cancel_futures=True)
            self.executor = self.make()
        return self.again


@contextlib.contextmanager
def pool_of(executor: Executor | Callable[[], Executor] | None, workers: int, dask: str | None) -> Iterator[Pool]:
    """Where a sweep runs: the caller's executor or one that the caller's function makes, or else what is named."""
    if isinstance(executor, Executor):  # it stays its owner's
        yield Pool(lambda: executor, AHEAD * _count_of(executor))
    elif callable(executor):
        yield from _own(Pool(executor, AHEAD * (os.cpu_count() or 1), again=True))
    elif executor is not None:
        raise ArgumentError(f"executor = {short(executor)}: expected a concurrent.futures.Executor, or a function")
    elif dask is not None:
        yield from _on_cluster(dask)
    elif workers > 1:
        yield from _own(Pool(lambda: Workers(workers), AHEAD * workers, again=True))
    else:
        yield Pool(Here, 1)


def _own(pool: Pool) -> Iterator[Pool]:
    try:
        yield pool
    finally:
        pool.executor.shutdown(wait=False, cancel_futures=True)


def _count_of(executor: Executor) -> int:
    """How many work in it; of one that does not say, as many as there are cores."""
    return int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)


def _on_cluster(address: str) -> Iterator[Pool]:
    """On the cluster of a Dask scheduler, such as tcp://10.0.0.1:8786.

    Raises
    ------
    MissingDependencyError
        Dask is not installed.
    EngineError
        No scheduler answers, or it has no workers.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise MissingDependencyError(
            "a Dask cluster needs distributed; install it with: python -m pip install 'flexlink[dask]'"
        ) from None
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EngineError(f"{address}: no Dask scheduler answers: {error}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise EngineError(
                f"{address}: the scheduler has no workers; start some with: dask worker {address}"
            ) from None
        yield Pool(client.get_executor, AHEAD * max(4, sum(client.nthreads().values())))
