"""Test mutants in one process that has imported the project and collected its tests, each in a fork.

Tests that call the mutated function run until the first failure, the most specific tests first, for at most `MOST`
seconds of processor time. Mutants that cannot be applied in a fork (a default of a class, a decorator) are planted in
a copy of the tree by `plant.Copy`.
"""

import contextlib
import json
import os
import resource
import select
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import pytest

from tests.faults.machine.generator import Mutant
from tests.faults.machine.recording import Function, Ran, Recorded, calls, clock, functions, tests_of
from tests.faults.machine.swap import CannotSwapError, swap
from tests.faults.plant import KILLED, ROOT, SURVIVED

MOST = 20.0  # s of processor time for the tests of a mutant; the remaining tests are skipped
DEAR = 8.0  # s of processor time; slower tests are stopped while recording and not used
LONGEST = 30.0  # s of processor time by which the last test of a mutant or a file may exceed the limit
ASLEEP = 600.0  # s of wall-clock time after which a fork is ended, in case it waits forever
UNREACHED, APART = "no test runs it", "cannot be swapped"
OPTIONS = ("-qq", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-o", "addopts=--import-mode=importlib")


class Judged(NamedTuple):
    """A mutant with its outcome, the deciding test, the number of tests run and the processor time [s]."""

    mutant: Mutant
    outcome: str
    detail: str = ""
    tests_run: int = 0
    seconds: float = 0.0


def cost(ran: Ran) -> float:
    """Sort key: small for fast tests that run little other code."""
    return (ran.seconds + 0.003) * len(ran.functions)


class _TooDearError(BaseException):
    """Raised by a timer. No tested code catches it."""


class Session:
    """pytest plugin that calls `work` with the collected tests; slow tests are included only from the files `slow`."""

    def __init__(self, work: Callable[["Session"], None], slow: Sequence[str] = ()) -> None:
        self._work, self._slow, self.failed, self.items = work, slow, "", dict[str, pytest.Item]()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Deselect slow tests of other files."""
        items[:] = [
            item
            for item in items
            if item.nodeid.partition("::")[0] in self._slow or not item.get_closest_marker("slow")
        ]

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Call `work` instead of running all tests."""
        self.items = {item.nodeid: item for item in session.items}
        self._work(self)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record whether a test failed or was skipped."""
        if report.failed or report.skipped:
            self.failed = self.failed or report.outcome

    def run(self, item: pytest.Item) -> str:
        """Run one test; return "" if it passed, else "failed" or "skipped"."""
        self.failed = ""
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        return self.failed

    def record(self, file: str) -> list[Ran]:
        """Run the tests of a file; return those that pass in time, or all before a test that kills the process."""
        items = [item for name, item in self.items.items() if name.partition("::")[0] == file]
        recorded = forked(lambda: self._recorded(items), (DEAR + 1.0) * len(items) + LONGEST)
        return [Ran(test, seconds, frozenset((a, b) for a, b in names)) for test, seconds, names in recorded]

    def _recorded(self, items: Sequence[pytest.Item]) -> Iterator[Any]:
        for item in items:
            start = clock()
            with calls() as seen, _stopped_after(DEAR):
                failed = self.run(item)
            if not failed:
                yield item.nodeid, clock() - start, sorted(functions(seen))

    def judge(self, mutant: Mutant, by_function: dict[Function, list[Ran]]) -> Judged:
        """Test whether a test that runs the mutated function detects the mutant."""
        every = tests_of(mutant.file, mutant.where, by_function)
        tests = sorted((ran for ran in every if ran.test in self.items and ran.seconds < DEAR), key=cost)
        if not tests:
            return Judged(mutant, SURVIVED, UNREACHED)
        start = clock()
        outcomes = list(forked(lambda: self._judged(mutant, tests), MOST + LONGEST))
        tests_run = sum(1 for each in outcomes if each is None)
        seconds = clock() - start
        match outcomes[-1] if outcomes else None:
            case None:
                return Judged(mutant, KILLED, "the process died or did not end", tests_run, seconds)
            case [outcome, test]:
                return Judged(mutant, outcome, test, tests_run, seconds)
        raise AssertionError(outcomes)

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
    """Yield the output lines of `work` in a fork of this process, until the fork ends, dies or exceeds its time."""
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
    """Make a test fail if it takes more than this processor time (`conftest` does so if kernels run as Python)."""

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
    """Collect the tests of these files in this process, and call `work` with them."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    os.chdir(ROOT)
    with tempfile.TemporaryDirectory(prefix="flexlink-faults-") as folder:
        return int(pytest.main([*OPTIONS, f"--basetemp={folder}/tests", *files], plugins=[Session(work, slow)]))


def record(session: Session, recorded: Recorded, report: Callable[[str], None]) -> None:
    """Record every test file that is not up to date."""
    for file in dict.fromkeys(name.partition("::")[0] for name in session.items):
        if not recorded.knows(file):
            ran = session.record(file)
            report(f"{file}: {len(ran)} tests in {sum(each.seconds for each in ran):.1f} s")
            recorded.add(file, ran)


def test_files() -> list[str]:
    """All test files."""
    found = (path for folder in ("tests", "validation/tests") for path in (ROOT / folder).rglob("test_*.py"))
    return sorted(path.relative_to(ROOT).as_posix() for path in found)
