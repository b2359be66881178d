"""sweep(…): run all members of a sweep, side by side and on several workers, and collect their rows in a table."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from flexlink.chain.arguments import integer, require_bool, require_callable
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, FlexlinkError, InterruptedSweepError, SceneError
from flexlink.common.interruption import deferred, word
from flexlink.common.wording import did_you_mean, plural, truncated
from flexlink.data.documents import require_path
from flexlink.engines import load
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.record import trajectory_from_states
from flexlink.sweeps.execution import Execution
from flexlink.sweeps.measures import DEFLECTION, MEASURES
from flexlink.sweeps.plan import Plan, Sweep, fingerprint
from flexlink.sweeps.store import Store
from flexlink.sweeps.table import SweepRows
from flexlink.sweeps.workers import MAX_WORKERS, pool_of


def sweep(
    what: Sweep | str | Path, *, out: str | Path | None = None,
    executor: Executor | Callable[[], Executor] | None = None, workers: int = 1, dask: str | None = None,
    fresh: bool = False, progress: Callable[[float], None] | None = None,
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
    fresh
        Whether to delete the rows in `out` first.
    progress
        Called with the fraction of members that have a row.

    Returns
    -------
    SweepRows
        All rows.

    Raises
    ------
    ArgumentError
        An argument is out of range, or `out` has rows of another sweep, scene or version.
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
    plan = Plan(what if isinstance(what, Sweep) else Sweep.load(what))
    path = None if out is None else require_path("out", out)
    preflight(plan)
    with Store(path, plan, fingerprint(plan.sweep), fresh=require_bool("fresh", fresh)) as store:
        fill(store, executor, count, dask, progress or (lambda _: None))
        columns, rows = store.table()
        return SweepRows(tuple(columns), tuple(rows))


def fill(
    store: Store, executor: Executor | Callable[[], Executor] | None, workers: int, dask: str | None,
    progress: Callable[[float], None],
) -> None:  # fmt: skip
    """Run the members that have no row."""
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
            end = f"in {store.path}; repeat the command to continue" if store.path else "lost; specify out to save them"
            text = f"{done} of {plural(plan.members, 'row')} {'is' if done == 1 else 'are'} {end}"
            number = stop.signal or signal.SIGINT
            raise InterruptedSweepError(f"{word(number)}; {text}", number)


def preflight(plan: Plan) -> None:
    """Refuse a sweep with unknown keys or output columns; values are checked later, member by member."""
    plan.check_paths()
    columns: list[str] = []
    for number in {0, plan.members - 1}:
        with contextlib.suppress(FlexlinkError):  # the sweep reports the error in this member's row
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
        with contextlib.suppress(ArgumentError):  # an unknown engine, or one that does not support this chain
            load(engine, chain)
