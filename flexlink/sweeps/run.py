"""sweep(…): all members of a sweep, side by side and on as many workers as there are, into one table."""

from __future__ import annotations

import signal
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from flexlink.chain.arguments import integer, require_bool, require_callable
from flexlink.common.errors import InterruptedSweepError
from flexlink.common.interruption import Stop, deferred, word
from flexlink.describe.data_files import require_path
from flexlink.sweeps.execution import Execution
from flexlink.sweeps.fingerprint import identity
from flexlink.sweeps.plan import Plan, Sweep, load_sweep
from flexlink.sweeps.preflight import require_possible
from flexlink.sweeps.store import Store
from flexlink.sweeps.table import SweepRows
from flexlink.sweeps.workers import MOST, pool_of


def sweep(
    what: Sweep | str | Path,
    *,
    out: str | Path | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int = 1,
    dask: str | None = None,
    fresh: bool = False,
    progress: Callable[[float], None] | None = None,
) -> SweepRows:
    """Run every member of a sweep, and keep the quantities that it names, one row a member.

    Members that are alike run eight side by side. A member that is refused or diverges is a row with its reason, and so
    is one that ends its process three times. Rows are the same to the bit whatever runs them: their numbers depend
    neither on their neighbours nor on the executor, on machines whose processors are alike.

    Parameters
    ----------
    what
        The sweep, or the path of its file.
    out
        SQLite database that the rows go to as they are done; after a stop, or a kill, the same call goes on from there.
        None: they are kept in memory.
    executor
        Where members run: any `concurrent.futures.Executor`, or a function that makes one, which is asked again where
        the one before has broken. None: as the next two say.
    workers
        Number of processes; 1: in this one.
    dask
        Address of a Dask scheduler, such as "tcp://10.0.0.1:8786".
    fresh
        Begin anew where `out` has rows.
    progress
        Called with the part of the members that have rows, now and then.

    Returns
    -------
    SweepRows
        All rows.

    Raises
    ------
    ArgumentError
        An argument is not what is expected, or `out` has rows of another sweep, scene or version.
    SceneError
        A key, a range or a quantity that cannot be.
    OutputError
        `out` cannot be written, is no sweep's, or another process writes to it.
    EngineError
        No worker can run members, or none is left; rows are kept.
    InterruptedSweepError
        Ctrl-C or SIGTERM; rows are kept.
    """
    require_callable("progress", progress)
    count = integer("workers", workers, 1, MOST)
    plan = Plan(what if isinstance(what, Sweep) else load_sweep(what))
    place = None if out is None else require_path("out", out)
    require_possible(plan)
    with Store(place, plan, identity(plan.sweep), fresh=require_bool("fresh", fresh)) as store:
        fill(store, executor, count, dask, progress or (lambda _: None))
        columns, rows = store.table()
        return SweepRows(tuple(columns), tuple(rows))


def fill(
    store: Store,
    executor: Executor | Callable[[], Executor] | None,
    workers: int,
    dask: str | None,
    progress: Callable[[float], None],
) -> None:
    """Run the members that have no row; errors as above."""
    plan, done = store.plan, store.count()
    if done == plan.members:
        return
    with deferred() as stop:
        with pool_of(executor, workers, dask) as pool:
            progress(done / plan.members)
            for rows in Execution(plan, pool, stop).rows(store.missing()):
                store.add(rows)
                done += len(rows)
                progress(done / plan.members)
        if done < plan.members:
            raise _interrupted(store, stop, done)


def _interrupted(store: Store, stop: Stop, done: int) -> InterruptedSweepError:
    kept = "the same command goes on from there" if store.path else "and lost, for want of a file to keep them in"
    number = stop.signal or signal.SIGINT
    place = f" in {store.path}" if store.path else ""
    return InterruptedSweepError(f"{word(number)}; {done} of {store.plan.members} rows are{place}; {kept}", number)
