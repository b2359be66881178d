"""Faults as data, the temporary copy in which they are planted, and the verdicts of the tests."""

import builtins
import contextlib
import fnmatch
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
KERNELS = "flexlink/kernels/"
NOT_COPIED = shutil.ignore_patterns(".*_cache", ".git", ".hypothesis", "__pycache__", "*.egg-info", "build", "dist")
LONGEST = 600.0  # s; slower tests of a faulty tree hang (the slowest take a minute, including compilation)
LONGEST_AS_PYTHON = 120.0  # s; beyond this time, compiling the kernels is faster

KILLED, SURVIVED, STALE, BROKEN = "killed", "SURVIVED", "does not apply any more", "NO VERDICT"


class Fault(NamedTuple):
    """One fault: `file` with `find` replaced by `replace`. At least one of `tests` must then fail."""

    name: str  # "source file/name of the fault"
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]  # as given to pytest: a file, or file::test
    why: str  # what goes wrong, in one line

    @property
    def compiled(self) -> bool:
        """Return whether the fault is in a kernel, which must then be recompiled."""
        return self.file.startswith(KERNELS)

    def occurrences(self, root: Path) -> int:
        """Number of occurrences of the text in the tree; it must be 1."""
        path = root / self.file
        return path.read_text(encoding="utf-8").count(self.find) if path.is_file() else 0


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    find: str
    replace: str
    why: str
    file: str = ""
    tests: tuple[str, ...] = ()


class _File(msgspec.Struct, forbid_unknown_fields=True):
    tests: tuple[str, ...]
    fault: tuple[_Entry, ...]
    file: str = ""


def load(folder: Path = HERE) -> list[Fault]:
    """All faults. Faults without `file` or `tests` use those of the TOML file."""
    faults = []
    for path in sorted(folder.glob("*.toml")):
        source = msgspec.toml.decode(path.read_bytes(), type=_File)
        faults += [
            Fault(f"{path.stem}/{f.name}", f.file or source.file, f.find, f.replace, f.tests or source.tests, f.why)
            for f in source.fault
        ]
    return faults


def select(faults: Sequence[Fault], patterns: Sequence[str]) -> list[Fault]:
    """Select the faults whose name or source matches a pattern; all if there are no patterns.

    Raises
    ------
    LookupError
        A pattern matches no fault.
    """
    names = [fault.name for fault in faults]
    fitting: set[str] = set()
    for pattern in patterns:
        found = fnmatch.filter(names, pattern) or fnmatch.filter(names, f"{pattern}/*")
        if not found:
            raise LookupError(f"{pattern!r}: no such fault; there are {', '.join(names)}")
        fitting.update(found)
    return [fault for fault in faults if fault.name in fitting or not patterns]


class Verdict(NamedTuple):
    """Outcome of the tests of a fault."""

    outcome: str  # KILLED, SURVIVED, STALE or BROKEN
    detail: str  # the test that failed, or the reason why there is no verdict
    seconds: float


class Answer(NamedTuple):
    """Result of a pytest run; the exit code is None if the run did not end."""

    code: int | None
    output: str


class Copy:
    """Copy of the tree in which faults are planted and removed. The tree itself is never changed."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.root, self.sound, self.planted = folder / "tree", folder / "sound", folder / "planted"
        self._right: dict[str, bool] = {}  # whether each test passes as Python without a fault
        shutil.copytree(tree, self.root, ignore=NOT_COPIED)

    def run(self, tests: Sequence[str], cache: Path | None, longest: float = LONGEST) -> Answer:
        """Run tests in the copy until the first failure, with machine code in `cache` (None: run kernels as Python)."""
        # -B: byte code is identified by file size and time in seconds; a fault of equal length would reuse it.
        options = ("-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider")
        kernels = {"NUMBA_DISABLE_JIT": "1"} if cache is None else {"XDG_CACHE_HOME": str(cache)}
        environment = os.environ | {"PYTHONPATH": str(self.root), "COLUMNS": "1000"} | kernels  # show reasons in full
        environment.pop("NUMBA_CACHE_DIR", None)
        process = subprocess.Popen(
            [sys.executable, "-B", "-m", "pytest", *options, *tests],
            cwd=self.root, env=environment, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=longest)
            return Answer(process.returncode, output)
        except subprocess.TimeoutExpired:
            return Answer(None, "")
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # also ends all processes started by the tests
            process.wait()

    @contextlib.contextmanager
    def holding(self, fault: Fault) -> Iterator[None]:
        """Plant a fault for the block, then remove it."""
        path = self.root / fault.file
        sound = path.read_bytes()
        path.write_bytes(sound.replace(fault.find.encode(), fault.replace.encode()))
        try:
            yield
        finally:
            path.write_bytes(sound)

    def judge(self, fault: Fault) -> Verdict:
        """Verdict on a fault."""
        found = fault.occurrences(self.root)
        if found != 1:
            return Verdict(STALE, f"its text is found {found} times in {fault.file}", 0.0)
        start = time.monotonic()
        cache = self.planted if fault.compiled else self.sound
        with self.holding(fault):
            answer = self.run(fault.tests, cache)
        shutil.rmtree(self.planted, ignore_errors=True)  # 20 MB of machine code that is not used again
        return Verdict(*verdict(answer), time.monotonic() - start)

    def judge_as_python(self, fault: Fault) -> Verdict | None:
        """Verdict on a kernel fault with the kernels run as Python; None if inconclusive.

        A test that fails with the fault and passes without it would also fail compiled. The result is inconclusive if a
        test passes, is skipped, takes long, or ends in an error that only Python raises. Machine code does not stop at
        a division by zero or an index out of range.
        """
        if fault.occurrences(self.root) != 1:
            return None
        start = time.monotonic()
        with self.holding(fault):
            answer = self.run(fault.tests, None, LONGEST_AS_PYTHON)
        outcome, test = verdict(answer)
        error = re.search(r"^FAILED .*? - (\w+)", answer.output, re.MULTILINE)
        alike = error is not None and (error[1] == "AssertionError" or not hasattr(builtins, error[1]))
        if outcome != KILLED or not alike or not self._passes_as_python(test):
            return None
        return Verdict(outcome, f"{test}, as Python", time.monotonic() - start)

    def _passes_as_python(self, test: str) -> bool:
        if test not in self._right:
            self._right[test] = self.run((test,), None, LONGEST_AS_PYTHON).code == 0
        return self._right[test]


def verdict(answer: Answer) -> tuple[str, str]:
    """Outcome and the deciding test; a fault that Numba or Python cannot compile has no verdict."""
    code, output = answer
    failed = re.search(r"^(?:FAILED|ERROR) (.*)$", output, re.MULTILINE)
    line = failed[1] if failed else ""
    if code is None:
        return KILLED, f"not finished within {LONGEST:.0f} s"
    if code < 0:
        return KILLED, f"the process died of signal {-code}"
    if code == 0:
        return SURVIVED, ""
    if code == 1 and failed and "numba.core.errors" not in line:
        return KILLED, line.partition(" - ")[0]
    if stopped := re.search(r"^!+ (?!Interrupted: )(.*?) !+$", output, re.MULTILINE):  # a run that was "interrupted"
        return KILLED, stopped[1]
    return BROKEN, line or " ".join(output.splitlines()[-1:])


@contextlib.contextmanager
def copied(tree: Path = ROOT) -> Iterator[Copy]:
    """Context manager: a temporary copy of the tree, always removed at the end."""
    with tempfile.TemporaryDirectory(prefix="flexlink-faults-") as folder:
        yield Copy(tree, Path(folder))
