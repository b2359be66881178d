"""Worker process of a sweep, killed by one member; the module imports little because it is started often."""

import os
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_all_start_methods, get_context

from flexlink.sweeps import worker
from flexlink.sweeps.plan import Plan

MEMBER = 5  # number of the member that kills its process; member MEMBER + 2 raises an unexpected exception


def make() -> None:
    """Patch this process so that the member kills it."""
    real = worker._row

    def row(plan: Plan, number: int, outcome: object) -> worker.Row:
        if number == MEMBER:
            os._exit(13)
        if number == MEMBER + 2:
            raise ZeroDivisionError("a mistake of the program")
        return real(plan, number, outcome)

    worker._row = row  # type: ignore[assignment]


def pool() -> Executor:
    """Pool of one such process, if possible a fork of a process that has already imported the library."""
    if "forkserver" not in get_all_start_methods():
        return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=make)
    context = get_context("forkserver")
    context.set_forkserver_preload([worker.__name__])
    return ProcessPoolExecutor(1, mp_context=context, initializer=make)
