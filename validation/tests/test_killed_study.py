"""A killed study leaves no process running, and its store is recognised as incomplete."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from reports.results import Results
from validation.store import Store
from validation.tests.studies import first_screen, words_from

ROOT = Path(__file__).parents[2]
WITH_A_WORKER = """
import os, time
from validation.runner import _pool
if __name__ == "__main__":
    print(_pool().submit(os.getpid).result(), flush=True)
    time.sleep(600)
"""
STUDY = ("order_conditions", "judge_50_digits", "physics_roll_up", "physics_finite_chains", "pointwise")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="no kill")]


def until(found: Callable[[], bool], seconds: float = 120.0) -> bool:
    end = time.monotonic() + seconds
    while not found() and time.monotonic() < end:
        time.sleep(0.02)
    return found()


def runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{process}/stat")  # a process that has ended keeps its id until its parent waits for it
    return not (status.exists() and status.read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z")


def test_workers_end_when_their_study_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "study.py"  # a worker imports what its parent ran
    script.write_text(WITH_A_WORKER, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment) as study:
        assert study.stdout
        worker = int(study.stdout.readline())
        assert runs(worker)
        study.kill()
    assert until(lambda: not runs(worker))


def test_an_interrupted_study_is_reported_as_incomplete(tmp_path: Path) -> None:
    results = tmp_path / "results"
    command = [sys.executable, "-m", "validation", "--no-report", "--results", str(results), *STUDY]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as study:
        assert until(lambda: bool(Store(results).rows()))
        study.terminate()
    whole, planned = set(Store(results).finished()), set(Store(results).plan())
    assert whole < planned, "no unmeasured case is finished"
    missing = {each.case for each in Results.read(results).missing}
    assert missing == planned - whole
    text = first_screen(words_from(results, tmp_path))
    assert "Verification: INCOMPLETE" in text
    assert all(case in text for case in missing)
