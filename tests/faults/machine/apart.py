"""Test a mutant in a copy of the tree if it cannot be applied in a forked process; a copy takes seconds longer."""

import os
import time
from pathlib import Path

from tests.faults.machine.generator import Mutant
from tests.faults.machine.judge import MOST, Judged, cost
from tests.faults.machine.recording import Function, Ran, tests_of
from tests.faults.plant import KILLED, SURVIVED, Copy, verdict

LONGEST = 300.0  # s of wall-clock time for the tests of one mutant


def judge_apart(copy: Copy, mutant: Mutant, by_function: dict[Function, list[Ran]]) -> Judged:
    """Return whether tests that run code of the file detect the mutant: fast tests first, up to `MOST` seconds."""
    chosen, taken = [], 0.0
    for ran in sorted(tests_of(mutant.file, mutant.where, by_function), key=cost):
        chosen.append(ran.test)
        taken += ran.seconds + 0.005
        if taken > MOST:
            break
    path = copy.root / mutant.file
    sound = path.read_bytes()
    kept = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    cache = None if os.environ.get("NUMBA_DISABLE_JIT") else kept
    start = time.monotonic()
    path.write_bytes(mutant.planted(sound))
    try:
        outcome, detail = verdict(copy.run(chosen, cache, LONGEST))
    finally:
        path.write_bytes(sound)
    seen = SURVIVED if outcome == SURVIVED else KILLED  # an import error counts as detected
    return Judged(mutant, seen, detail, len(chosen), time.monotonic() - start)
