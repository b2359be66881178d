"""A process of a sweep in which one member ends it; it imports no more than its work needs, as it is started often."""

from __future__ import annotations

import os
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_all_start_methods, get_context

from flexlink.sweeps import worker
from flexlink.sweeps.plan import Plan

MEMBER = 5  # number of the one that ends its process; the next but one raises what no member may raise


def make() -> None:
    """Let this process be such a one."""
    real = worker._row

    def row(plan: Plan, number: int, outcome: object) -> worker.Row:
        if number == MEMBER:
            os._exit(13)
        if number == MEMBER + 2:
            raise ZeroDivisionError("a mistake of the program")
        return real(plan, number, outcome)

    worker._row = row  # type: ignore[assignment]


def pool() -> Executor:
    """One such process at a time, where the system can do that copied from one that has imported the library."""
    if "forkserver" not in get_all_start_methods():
        return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=make)
    context = get_context("forkserver")
    context.set_forkserver_preload([worker.__name__])
    return ProcessPoolExecutor(1, mp_context=context, initializer=make)
