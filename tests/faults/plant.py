"""Faults as data, the temporary copy they are planted in, and the verdict of the tests."""

from __future__ import annotations

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
LONGEST = 600.0  # s; tests that take longer on a planted tree hang: the slowest take a minute, compilation included
LONGEST_AS_PYTHON = 120.0  # s; then compiling the kernels, which takes about as long, is the quicker way

KILLED, SURVIVED, STALE, BROKEN = "killed", "SURVIVED", "does not apply any more", "NO VERDICT"


class Fault(NamedTuple):
    """One mistake: in `file`, `find` becomes `replace`; at least one of `tests` must then fail."""

    name: str  # source/fault
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]  # as pytest takes them: a file, or file::test
    why: str  # what goes wrong, in one line

    @property
    def compiled(self) -> bool:
        """Whether it is in a kernel, so that machine code is made anew."""
        return self.file.startswith(KERNELS)

    def occurrences(self, root: Path) -> int:
        """How often the text is found in the tree; anything but 1 means that the fault cannot be planted."""
        path = root / self.file
        return path.read_text(encoding="utf-8").count(self.find) if path.is_file() else 0


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    find: str
    replace: str
    why: str
    tests: tuple[str, ...] = ()


class _File(msgspec.Struct, forbid_unknown_fields=True):
    file: str
    tests: tuple[str, ...]
    fault: tuple[_Entry, ...]


def load(folder: Path = HERE) -> list[Fault]:
    """All faults; those that name no tests of their own take the ones of their file."""
    faults = []
    for path in sorted(folder.glob("*.toml")):
        source = msgspec.toml.decode(path.read_bytes(), type=_File)
        faults += [
            Fault(f"{path.stem}/{f.name}", source.file, f.find, f.replace, f.tests or source.tests, f.why)
            for f in source.fault
        ]
    return faults


def select(faults: Sequence[Fault], patterns: Sequence[str]) -> list[Fault]:
    """Those whose name, or source, fits one of the patterns; all without patterns.

    Raises
    ------
    LookupError
        A pattern fits none.
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
    """What the tests said about a fault."""

    outcome: str  # KILLED, SURVIVED, STALE or BROKEN
    told: str  # the test that failed, or why there is no verdict
    seconds: float


class Answer(NamedTuple):
    """What became of a run of pytest; its exit code, None if it did not end."""

    code: int | None
    output: str


class Copy:
    """A copy of the tree in which faults come and go; the tree itself is never touched."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.root, self.sound, self.planted = folder / "tree", folder / "sound", folder / "planted"
        self._right: dict[str, bool] = {}  # whether a test passes as Python without a fault
        shutil.copytree(tree, self.root, ignore=NOT_COPIED)

    def run(self, tests: Sequence[str], cache: Path | None, longest: float = LONGEST) -> Answer:
        """Run tests in the copy up to the first failure, machine code in `cache`; None: kernels as Python."""
        # -B: byte code is matched by seconds and size, a fault of the same length planted at once would not be seen.
        options = ("-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider")
        kernels = {"NUMBA_DISABLE_JIT": "1"} if cache is None else {"XDG_CACHE_HOME": str(cache)}
        environment = os.environ | {"PYTHONPATH": str(self.root), "COLUMNS": "1000"} | kernels  # reasons in full
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
                os.killpg(process.pid, signal.SIGKILL)  # and whatever the tests have started
            process.wait()

    @contextlib.contextmanager
    def holding(self, fault: Fault) -> Iterator[None]:
        """Plant a fault, and take it out again."""
        path = self.root / fault.file
        sound = path.read_bytes()
        path.write_bytes(sound.replace(fault.find.encode(), fault.replace.encode()))
        try:
            yield
        finally:
            path.write_bytes(sound)

    def judge(self, fault: Fault) -> Verdict:
        """Whether its tests notice a fault."""
        found = fault.occurrences(self.root)
        if found != 1:
            return Verdict(STALE, f"its text is found {found} times in {fault.file}", 0.0)
        start = time.monotonic()
        cache = self.planted if fault.compiled else self.sound
        with self.holding(fault):
            answer = self.run(fault.tests, cache)
        shutil.rmtree(self.planted, ignore_errors=True)  # 20 MB of machine code that nobody asks for again
        return Verdict(*verdict(answer), time.monotonic() - start)

    def judge_as_python(self, fault: Fault) -> Verdict | None:
        """Whether its tests notice a fault of a kernel that is not compiled; None where this does not tell.

        A test that fails so, and without the fault does not, would fail compiled: the formula is the same. One that
        passes, is skipped, takes long, or ends in an error of Python's own (a division by zero, a place outside an
        array: machine code goes on there), tells nothing.
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
    """Outcome, and the test that decided it; a fault that numba or Python cannot compile proves nothing."""
    code, output = answer
    failed = re.search(r"^(?:FAILED|ERROR) (.*)$", output, re.MULTILINE)
    line = failed[1] if failed else ""
    if code is None:
        return KILLED, f"no end within {LONGEST:.0f} s"
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
    """A copy of the tree for as long as it is needed; gone afterwards, whatever happened."""
    with tempfile.TemporaryDirectory(prefix="flexlink-faults-") as folder:
        yield Copy(tree, Path(folder))
