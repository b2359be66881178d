"""Record which tests call each function; a test file runs once for this, and again only after it has changed."""

import hashlib
import json
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

from tests.faults.machine.generator import TREES
from tests.faults.plant import ROOT

Function = tuple[str, str]  # file, name of the outermost function
EVERY: Function = ("", "")


class Ran(NamedTuple):
    """A test with its processor time [s] and the functions that it ran."""

    test: str
    seconds: float
    functions: frozenset[Function]


class Recorded:
    """Recorded test files, saved in a file. A test file that has changed counts as not recorded."""

    def __init__(self, path: Path, slow: Sequence[str] = ()) -> None:
        self._path, self._slow = path, slow
        self._known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def _digest(self, file: str) -> str:
        return hashlib.sha256((ROOT / file).read_bytes()).hexdigest()[:16] + " with slow ones" * (file in self._slow)

    def knows(self, file: str) -> bool:
        """Whether this version of the test file was recorded."""
        return file in self._known and self._known[file]["digest"] == self._digest(file)

    def add(self, file: str, ran: list[Ran]) -> None:
        """Save the tests of a file."""
        names = sorted({function for each in ran for function in each.functions})
        number = {name: k for k, name in enumerate(names)}
        tests = {each.test: [round(each.seconds, 4), sorted(number[name] for name in each.functions)] for each in ran}
        self._known[file] = {"digest": self._digest(file), "functions": names, "tests": tests}
        self._path.parent.mkdir(exist_ok=True)
        self._path.write_text(json.dumps(self._known), encoding="utf-8")

    def __iter__(self) -> Iterator[Ran]:
        """All recorded tests of test files that still exist."""
        for file, known in self._known.items():
            names = [(path, name) for path, name in known["functions"]]
            if (ROOT / file).is_file():
                for test, (seconds, numbers) in known["tests"].items():
                    yield Ran(test, seconds, frozenset(names[k] for k in numbers))

    def by_function(self) -> dict[Function, list[Ran]]:
        """Tests by function. An empty function name gives all tests of a file; an empty file name gives all tests."""
        found: dict[Function, list[Ran]] = defaultdict(list)
        for ran in self:
            for function in ran.functions | {(file, "") for file, _ in ran.functions} | {EVERY}:
                found[function].append(ran)
        return found


def tests_of(file: str, where: str, by_function: dict[Function, list[Ran]]) -> list[Ran]:
    """Tests that may detect a change in function `where` of a file, or (if `where` is empty) in a value of the file."""
    return by_function.get((file, where), []) or (by_function[EVERY] if not where else [])


@contextmanager
def calls() -> Iterator[dict[int, CodeType]]:
    """Record the code that runs inside the block, in all threads of this process."""
    seen: dict[int, CodeType] = {}

    def look(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        seen[id(code)] = code

    sys.settrace(look)
    threading.settrace(look)
    try:
        yield seen
    finally:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]


def functions(seen: dict[int, CodeType]) -> frozenset[Function]:
    """Functions of the project among these code objects."""
    trees = tuple(f"{ROOT / tree}/" for tree in TREES)
    found = set()
    for code in seen.values():
        if code.co_filename.startswith(trees) and code.co_name != "<module>":
            file = Path(code.co_filename).relative_to(ROOT).as_posix()
            found.add((file, outermost(code.co_qualname)))
    return frozenset(found)


def outermost(name: str) -> str:
    """For a nested function, return the outer one."""
    return name.partition(".<locals>")[0]


def clock() -> float:
    """Processor time of this process and of its finished children [s]."""
    own = time.process_time()
    import resource  # noqa: PLC0415  only here, since judges also fork

    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own + children.ru_utime + children.ru_stime
