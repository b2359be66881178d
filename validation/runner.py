"""Run the cases that a change can have touched since they were stored; check each number and store it at once."""

from __future__ import annotations

import datetime
import multiprocessing
import os
import platform
import subprocess
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, as_completed
from pathlib import Path

from flexlink.common.errors import FlexlinkError, OutputError
from flexlink.common.versions import processor, system, versions
from flexlink.sweeps.workers import exit_when_closed
from validation import dependencies
from validation.case import ALL, Case, load_cases
from validation.kinds import BESIDE, KINDS, TIMED
from validation.measuring import kind_of, measure
from validation.sources import ROOT
from validation.speed.machine import LoadMonitor
from validation.store import STOPPED, Environment, Finished, Planned, Row, Series, Store

WORTH_A_POOL = 4  # least number of cases for a process pool; starting a process takes as long as a short case
PACKAGES = (
    "flexlink",
    "numpy",
    "scipy",
    "numba",
    "msgspec",
    "pin",
    "mujoco",
    "mpmath",
    "scikit-sundae",
    "drake",
    "exudyn",
    "pyelastica",
)

Report = Callable[[str, Row | None], None]
"""Called with the case's name and a row when the row is stored; the row is None when the case starts."""
Notify = Callable[[str], None]
NEVER, BUSY = "not stored", "timed on a busy machine"


def run_cases(
    cases: Sequence[Case], store: Store, force: bool, report: Report, *, full: bool, notify: Notify
) -> dict[str, FlexlinkError]:
    """Run every case that is not stored: first untimed cases in parallel, then timed cases one at a time.

    A case is run again if anything that it depends on has changed, or if its limits were timed on a busy machine.

    Parameters
    ----------
    cases, store
        Cases to run, and the store of their results.
    force
        Run stored cases again.
    report
        Called for every case that starts and for every row.
    full
        Run each timed case alone, and keep results of other versions of packages. Otherwise, timed cases without limits
        run in parallel, and results of other versions are measured again.
    notify
        Called with a sentence for every stored case that is run again, and about each pass.

    Returns
    -------
    dict
        The cases that failed, with the reason: invalid settings, a missing engine, a divergent run, a crash. All other
        cases have been run.

    Raises
    ------
    OutputError
        The store cannot be written.
    """
    known = load_cases(*ALL)
    files = dependencies.of_cases(known)
    keys = {name: dependencies.key(each) for name, each in files.items()}
    reasons = _reasons(cases, files, store, force, full)
    for name, why in reasons.items():
        if why != NEVER:
            notify(f"{name}: {why}")
    named = {case.name for case in cases} | set(store.plan())  # once planned, a case is missing until it has run
    planned = [case for case in known if not case.by_name or case.name in named]
    store.note_plan({case.name: Planned(keys[case.name], case.kind, case.title, case.about) for case in planned})
    if reasons:
        store.note_environment(environment())
        store.reopen(set(reasons))
    alone = TIMED if full else TIMED - BESIDE
    wanted = _last_what_ended_badly([case for case in cases if case.name in reasons], reasons, store)
    if full:
        timed = sum(case.kind in alone for case in wanted)
        notify(f"untimed cases: {len(wanted) - timed}, {os.cpu_count()} at once; then timed cases, alone: {timed}")
    failed: dict[str, FlexlinkError] = {}
    for case, results in _in_order_of_completion(wanted, keys, report, alone):
        store.begin(case.name, files[case.name])
        watch = LoadMonitor() if case.kind in alone else None
        try:
            _keep(case, results, store, report)
        except OutputError:  # the store cannot be written, so the next case would fail as well
            raise
        except Exception as error:  # a case that crashes must not stop the others
            failed[case.name] = error if isinstance(error, FlexlinkError) else FlexlinkError(_crash(error))
            store.fail(case.name, str(failed[case.name]).replace(f"{ROOT}/", ""))
            continue
        conditions = watch.conditions() if watch else None
        store.finish(case.name, Finished(keys[case.name], _date(), processor(), conditions, software()))
    return failed


def _reasons(
    cases: Iterable[Case], files: Mapping[str, dependencies.Files], store: Store, force: bool, full: bool
) -> dict[str, str]:
    """Why each of these cases must run; cases with valid results are left out."""
    finished, rows, now = store.finished(), store.rows(), {} if full else software()
    limited = {row.case for row in rows if row.timed and row.passed is not None}
    found = {}
    for case in cases:
        done = finished.get(case.name)
        if done is None:
            why = NEVER
        elif done.key != dependencies.key(files[case.name]):
            why = dependencies.changes(files[case.name], store.sources(case.name)) or "measured by an earlier version"
        elif other := [name for name in now if now[name] != done.versions.get(name)]:
            why = f"{other[0]} {now[other[0]]}, stored with {done.versions.get(other[0]) or 'another version'}"
        elif done.busy and case.name in limited:
            why = BUSY
        else:
            why = "measured again on demand" if force else ""
        if why:
            found[case.name] = why
    return found


def _last_what_ended_badly(cases: Sequence[Case], reasons: Mapping[str, str], store: Store) -> list[Case]:
    """Sort cases: one that ended its process must not keep others from running, nor one that needs a quiet machine."""
    before = store.failed()
    return sorted(cases, key=lambda case: (before.get(case.name) == STOPPED, reasons[case.name] == BUSY))


def _crash(error: Exception) -> str:
    """What a case that crashed raised, and where."""
    *_, last = traceback.extract_tb((error.__cause__ or error).__traceback__) or (None,)
    place = f" ({Path(last.filename).name}, line {last.lineno})" if last else ""
    return f"crashed: {type(error).__name__}: {' '.join(str(error).split())}{place}"


def _keep(case: Case, results: Iterable[Row | Series], store: Store, report: Report) -> None:
    for result in results:
        if isinstance(result, Series):
            store.add_series(case.name, result)
        else:
            store.append(result)
            report(case.name, result)


def _in_order_of_completion(
    cases: Sequence[Case], keys: dict[str, str], report: Report, kinds_alone: AbstractSet[str]
) -> Iterator[tuple[Case, Iterable[Row | Series]]]:
    """Yield each case with its results; cases that run alone, or in a small set, yield results as they are measured.

    While other cases run, timed cases are rehearsed, so that their kernels are compiled before they are timed.
    """
    alone = [case for case in cases if case.kind in kinds_alone]
    shared = [case for case in cases if case.kind not in kinds_alone]
    if len(shared) < WORTH_A_POOL:
        alone, shared = shared + alone, []
    yield from _in_parallel(shared, alone, keys, report)
    for case in alone:
        report(case.name, None)
        yield case, measure(case, keys[case.name])


def _in_parallel(
    cases: Sequence[Case], to_rehearse: Sequence[Case], keys: dict[str, str], report: Report
) -> Iterator[tuple[Case, Iterable[Row | Series]]]:
    """Yield cases when they end; if one ends its process, those that are lost run again, each in a separate pool."""
    if not cases:
        return
    lost = []
    with _pool() as pool:
        rehearsals = [pool.submit(_rehearse, case) for case in to_rehearse]
        longest_first = sorted(cases, key=lambda case: not KINDS[case.kind].long)
        running = {pool.submit(_all_results, case, keys[case.name]): case for case in longest_first}
        try:
            for done in as_completed(running):
                if isinstance(done.exception(), BrokenExecutor):
                    lost.append(running[done])
                    continue
                report(running[done].name, None)
                yield running[done], _results_of(done)
            for rehearsal in rehearsals:
                rehearsal.exception()  # waits; an error occurs again, and is reported, when the case runs
        finally:
            pool.shutdown(cancel_futures=True)
    for case in lost:
        report(case.name, None)
        with _pool(1) as pool:
            yield case, _results_of(pool.submit(_all_results, case, keys[case.name]))


def _pool(processes: int | None = None) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes or os.cpu_count(), mp_context=context, initializer=_end_with_parent)


def _end_with_parent() -> None:
    """End a worker when the study ends, even if the study was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        exit_when_closed(parent.sentinel)


def _results_of(done: Future[list[Row | Series]]) -> Iterator[Row | Series]:
    """Results of a finished case; its error is raised at the first result, as for a case measured in this process."""
    try:
        yield from done.result()
    except BrokenExecutor:
        raise FlexlinkError("ended its process") from None


def _all_results(case: Case, key: str) -> list[Row | Series]:
    return list(measure(case, key))


def _rehearse(case: Case) -> None:
    kind, settings = kind_of(case)
    if kind.rehearsal:
        deque(kind.measurements(case, kind.rehearsed(settings)), maxlen=0)


def software() -> dict[str, str]:
    """Versions that may change results, without flexlink's own, since its sources are compared."""
    found = {"Python": platform.python_version(), **versions(PACKAGES)}
    return {name: version for name, version in found.items() if name != "flexlink"}


def environment() -> Environment:
    """Versions, processor, system, commit and date: the context of the numbers."""
    return Environment(
        date=_date(),
        commit=_commit(),
        python=platform.python_version(),
        versions=versions(PACKAGES),
        processor=processor(),
        cores=os.cpu_count() or 0,
        system=system(),
        sources=dependencies.everything(),
    )


def _date() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)


def _commit() -> str:
    """The commit of the sources, with "+" if they have changed since; "" outside a repository."""
    try:
        git = ["git", "-C", str(ROOT)]
        head = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=True)
        status = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return head.stdout.strip() + ("+" if status.stdout.strip() else "")
