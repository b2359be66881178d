"""Judge mistakes in one process that has imported the project and found its tests: each in a fork of it.

Tests that run the function of a mistake are run up to the first failure, those that run little else first, and no more
than `MOST` seconds of processor time. What a fork cannot take (a default of a class, a decorator) is planted in a copy
of the tree, `plant.Copy`.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.faults.machine.generator import Mutant
from tests.faults.machine.recording import Function, Ran, Recorded, calls, clock, functions, tests_of
from tests.faults.machine.swap import CannotSwapError, swap
from tests.faults.plant import KILLED, ROOT, SURVIVED

MOST = 20.0  # s of processor time that the tests of a mistake may take; those left after that were not asked
DEAR = 8.0  # s of processor time from which a test is not asked, and is stopped while it is recorded
LONGEST = 30.0  # s of processor time that the last test of a mistake, or of a file, may take beyond
ASLEEP = 600.0  # s that a fork may take by the clock: it waits for something that never comes
UNREACHED, APART = "no test runs it", "cannot be swapped"
OPTIONS = ("-qq", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-o", "addopts=--strict-markers")


class Judged(NamedTuple):
    """A mistake, what became of it, by which test, after how many tests and seconds of processor time."""

    mutant: Mutant
    outcome: str
    told: str = ""
    asked: int = 0
    seconds: float = 0.0


def cost(ran: Ran) -> float:
    """Small for a test that is quick, and that runs little but what it tests."""
    return (ran.seconds + 0.003) * len(ran.functions)


class _TooDearError(BaseException):
    """Which no code that is tested catches."""


class Session:
    """A plugin of pytest: once the tests are found, `work` has them; slow ones only of the files `slow`."""

    def __init__(self, work: Callable[[Session], None], slow: Sequence[str] = ()) -> None:
        self._work, self._slow, self.failed, self.items = work, slow, "", dict[str, pytest.Item]()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Leave out slow tests of other files."""
        items[:] = [
            item
            for item in items
            if item.nodeid.partition("::")[0] in self._slow or not item.get_closest_marker("slow")
        ]

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In place of running them all."""
        self.items = {item.nodeid: item for item in session.items}
        self._work(self)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remember whether a test failed, or did not run."""
        if report.failed or report.skipped:
            self.failed = self.failed or report.outcome

    def run(self, item: pytest.Item) -> str:
        """Run one test; empty: it passed, else "failed" or "skipped"."""
        self.failed = ""
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        return self.failed

    def record(self, file: str) -> list[Ran]:
        """The tests of a file that pass in time, up to one that ends the process."""
        items = [item for name, item in self.items.items() if name.partition("::")[0] == file]
        told = forked(lambda: self._recorded(items), (DEAR + 1.0) * len(items) + LONGEST)
        return [Ran(test, seconds, frozenset((a, b) for a, b in names)) for test, seconds, names in told]

    def _recorded(self, items: Sequence[pytest.Item]) -> Iterator[Any]:
        for item in items:
            start = clock()
            with calls() as seen, _stopped_after(DEAR):
                failed = self.run(item)
            if not failed:
                yield item.nodeid, clock() - start, sorted(functions(seen))

    def judge(self, mutant: Mutant, by_function: dict[Function, list[Ran]]) -> Judged:
        """Whether a test that runs the function of a mistake notices it."""
        every = tests_of(mutant.file, mutant.where, by_function)
        tests = sorted((ran for ran in every if ran.test in self.items and ran.seconds < DEAR), key=cost)
        if not tests:
            return Judged(mutant, SURVIVED, UNREACHED)
        start = clock()
        told = list(forked(lambda: self._judged(mutant, tests), MOST + LONGEST))
        asked = sum(1 for each in told if each is None)
        seconds = clock() - start
        match told[-1] if told else None:
            case None:
                return Judged(mutant, KILLED, "the process died, or came to no end", asked, seconds)
            case [outcome, test]:
                return Judged(mutant, outcome, test, asked, seconds)
        raise AssertionError(told)

    def _judged(self, mutant: Mutant, tests: Sequence[Ran]) -> Iterator[Any]:
        try:
            swap(mutant)
        except CannotSwapError:
            yield APART, ""
            return
        except Exception as error:  # the module cannot be imported
            yield KILLED, f"import: {type(error).__name__}"
            return
        end = time.process_time() + MOST
        for ran in tests:
            if time.process_time() > end:
                break
            if self.run(self.items[ran.test]) == "failed":
                yield KILLED, ran.test
                return
            yield None
        yield SURVIVED, ""


def forked(work: Callable[[], Iterator[Any]], seconds: float) -> Iterator[Any]:
    """What `work` yields in a fork of this process, line by line, until it ends, dies or has used its time."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.setsid()
            os.close(read)
            nothing = os.open(os.devnull, os.O_WRONLY)
            for output in (1, 2):
                os.dup2(nothing, output)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
            with os.fdopen(write, "w", encoding="utf-8") as pipe:
                for each in work():
                    print(json.dumps(each), file=pipe, flush=True)
        finally:
            os._exit(0)
    os.close(write)
    try:
        with os.fdopen(read, encoding="utf-8") as pipe:
            end = time.monotonic() + ASLEEP
            while select.select([pipe], [], [], max(0.0, end - time.monotonic()))[0]:
                line = pipe.readline()
                if not line:
                    break
                yield json.loads(line)
    finally:
        for kill in (os.killpg, os.kill):
            with contextlib.suppress(ProcessLookupError):
                kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


@contextlib.contextmanager
def _stopped_after(seconds: float) -> Iterator[None]:
    """Let a test fail that takes more processor time (where kernels are Python, `conftest` does so)."""

    def ring(*_: object) -> None:
        raise _TooDearError

    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    except _TooDearError:
        raise AssertionError("the report of a test takes too long") from None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def with_tests(files: Sequence[str], work: Callable[[Session], None], slow: Sequence[str] = ()) -> int:
    """Find the tests of these files, in this process, and call `work` with them."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    os.chdir(ROOT)
    with tempfile.TemporaryDirectory(prefix="flexlink-faults-") as folder:
        return int(pytest.main([*OPTIONS, f"--basetemp={folder}/tests", *files], plugins=[Session(work, slow)]))


def record(session: Session, recorded: Recorded, tell: Callable[[str], None]) -> None:
    """Record every test file that is not known."""
    for file in dict.fromkeys(name.partition("::")[0] for name in session.items):
        if not recorded.knows(file):
            ran = session.record(file)
            tell(f"{file}: {len(ran)} tests in {sum(each.seconds for each in ran):.1f} s")
            recorded.add(file, ran)


def test_files() -> list[str]:
    """Every test file."""
    return sorted(path.relative_to(ROOT).as_posix() for path in Path(ROOT / "tests").glob("test_*.py"))
