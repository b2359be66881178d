"""Run all cases not yet stored for the same sources and versions; check each number and store it at once."""

from __future__ import annotations

import datetime
import hashlib
import math
import multiprocessing
import os
import platform
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from typing import Any

from flexlink.common.errors import DataFileError, FlexlinkError, OutputError, SceneError
from flexlink.common.processes import exit_when_closed
from flexlink.common.versions import processor, system, versions
from flexlink.describe.spec import decode
from validation import row_counts
from validation.case import ALL, CLAIM, Case, Measured, load_cases
from validation.kinds import BESIDE, KINDS, LONG, SETTINGS, TIMED, Kind, measurements
from validation.sources import ROOT, digests, sources
from validation.speed.machine import LoadMonitor
from validation.store import Environment, Finished, Planned, Row, Series, Store

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
)

Report = Callable[[str, Row | None], None]
"""Called with the case's name and a row when the row is stored; the row is None when the case starts."""


def run_cases(
    cases: Sequence[Case], store: Store, force: bool, report: Report, full: bool = False
) -> dict[str, FlexlinkError]:
    """Run every case that is not stored: first untimed cases in parallel, then timed cases one at a time.

    Parameters
    ----------
    cases, store
        Cases to run, and the store of their results.
    force
        Run stored cases again.
    report
        Called for every case that starts and for every row.
    full
        Run each timed case alone, and keep stored results even if the machine was busy. Otherwise, timed cases with
        limits are run again if the machine was busy, and timed cases without limits run in parallel.

    Returns
    -------
    dict
        The cases that failed, with the reason: invalid settings, a missing engine, a divergent run. All other cases
        have been run.

    Raises
    ------
    OutputError
        The store cannot be written.
    """
    shared, known = _hash_of_sources(), load_cases(*ALL)
    keys = {case.name: _key(case, shared) for case in known}
    wanted = [case for case in cases if force or not _is_done(case, keys[case.name], store, not full)]
    named = {case.name for case in cases} | set(store.finished())
    planned = [case for case in known if not case.by_name or case.name in named]
    store.note_plan({case.name: Planned(keys[case.name], case.kind, case.title, case.about) for case in planned})
    if wanted:
        store.note_environment(environment())
        store.reopen({case.name for case in wanted})
    failed: dict[str, FlexlinkError] = {}
    alone = TIMED if full else TIMED - BESIDE
    for case, results in _in_order_of_completion(wanted, keys, report, alone):
        store.forget(case.name)
        watch = LoadMonitor() if case.kind in alone else None
        try:
            _keep(case, results, store, report)
        except OutputError:  # the store cannot be written, so the next case would fail as well
            raise
        except FlexlinkError as error:
            failed[case.name] = error
            store.fail(case.name, str(error).replace(f"{ROOT}/", ""))
            continue
        conditions = watch.conditions() if watch else None
        store.finish(case.name, Finished(keys[case.name], _date(), processor(), conditions))
    return failed


def _keep(case: Case, results: Iterable[Row | Series], store: Store, report: Report) -> None:
    for result in results:
        if isinstance(result, Series):
            store.add_series(case.name, result)
        else:
            store.append(result)
            report(case.name, result)


def _is_done(case: Case, key: str, store: Store, again_if_busy: bool) -> bool:
    """Whether the case is stored for the same sources and versions; optionally also timed on an idle machine."""
    done = store.finished().get(case.name)
    if done is None or done.key != key:
        return False
    if not (again_if_busy and done.busy):
        return True
    return not any(row.timed and row.passed is not None for row in store.rows() if row.case == case.name)


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
    if shared:
        with _pool() as pool:
            rehearsals = [pool.submit(_rehearse, case) for case in alone]
            longest_first = sorted(shared, key=lambda case: case.kind not in LONG)
            running = {pool.submit(_all_results, case, keys[case.name]): case for case in longest_first}
            try:
                for done in as_completed(running):
                    report(running[done].name, None)
                    yield running[done], _results_of(done)
                for rehearsal in rehearsals:
                    rehearsal.exception()  # waits; an error occurs again, and is reported, when the case runs
            finally:
                pool.shutdown(cancel_futures=True)
    for case in alone:
        report(case.name, None)
        yield case, measure(case, keys[case.name])


def _pool() -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(os.cpu_count(), mp_context=context, initializer=_end_with_parent)


def _end_with_parent() -> None:
    """End a worker when the study ends, even if the study was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        exit_when_closed(parent.sentinel)


def _results_of(done: Future[list[Row | Series]]) -> Iterator[Row | Series]:
    """Results of a finished case; its error is raised at the first result, as for a case measured in this process."""
    yield from done.result()


def _all_results(case: Case, key: str) -> list[Row | Series]:
    return list(measure(case, key))


def _rehearse(case: Case) -> None:
    kind, settings = kind_of(case)
    if rehearsal := getattr(kind, "rehearsal", None):
        deque(measurements(kind, case, rehearsal(settings)), maxlen=0)


def measure(case: Case, key: str) -> Iterator[Row | Series]:
    """Checked rows and series of a case, as they are measured.

    Raises
    ------
    FlexlinkError
        The case cannot be run, or does not measure all of its quantities.
    """
    kind, settings = kind_of(case)
    missing = {quantity for quantity in case.quantity if case.demands(quantity)}
    rows: list[Row] = []
    start = time.perf_counter()
    for result in measurements(kind, case, settings):
        if isinstance(result, Series):
            yield result
        elif result.quantity in case.quantity:  # a case may use only some quantities of its kind
            rows.append(judged(case, result, time.perf_counter() - start, key))
            yield rows[-1]
            missing.discard(result.quantity)
            start = time.perf_counter()
    if missing:  # a limit that was not measured must not appear to be met
        raise DataFileError(
            f"{case.path}: quantity.{min(missing)}: kind {case.kind!r} does not measure it here", id="unknown-quantity"
        )
    yield from row_counts.wrong(case, rows)


def kind_of(case: Case) -> tuple[Kind, Any]:
    """The kind of a case, and its settings."""
    kind = KINDS.get(case.kind)
    if kind is None:
        raise DataFileError(
            f"{case.path}: kind = {case.kind!r}: unknown; allowed are {', '.join(KINDS)}", id="unknown-name"
        )
    try:
        return kind, decode(case.settings, SETTINGS[case.kind], "settings")
    except SceneError as error:
        raise DataFileError(f"{case.path}: {error}") from None


def judged(case: Case, measured: Measured, seconds: float, key: str) -> Row:
    """Make the row of a number, which passes if it is on the right side of the case's tolerance; nan never passes."""
    quantity = case.quantity[measured.quantity]
    tolerance = None if quantity.tolerance is None else quantity.tolerance * measured.scale
    value = float(measured.value) if math.isfinite(measured.value) else None  # JSON has no nan
    passed = None
    if tolerance is not None:
        passed = measured.value <= tolerance if quantity.bound == "at most" else measured.value >= tolerance
    claim = {CLAIM: case.claim} if case.claim and measured.quantity == CLAIM else {}
    return Row(
        case=case.name, kind=case.kind, title=case.title, scene=measured.scene, engine=measured.engine,
        varied={**claim, **measured.varied}, quantity=measured.quantity, metric=quantity.metric,
        value=value, unit=quantity.unit, tolerance=tolerance, bound=quantity.bound,
        passed=None if passed is None else bool(passed), timed=measured.timed, reason=quantity.reason,
        note=measured.note, given_up=quantity.given_up, seconds=round(seconds, 3), key=key,
        widened=quantity.widened,
    )  # fmt: skip


def _key(case: Case, shared: bytes) -> str:
    digest = hashlib.sha256(shared)
    for path in (case.path, *case.scene_files):
        digest.update(path.read_bytes() if path.exists() else b"")
    return digest.hexdigest()[:16]


def _hash_of_sources() -> bytes:
    """Hash of all sources and package versions that results may depend on; cases and scenes are hashed per case."""
    digest = hashlib.sha256(repr([platform.python_version(), versions(PACKAGES)]).encode())
    for path in sources():
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.digest()


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
        sources=digests(),
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
