"""The study's peak memory of a process is its own, also if a larger process started it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.conftest import ROOT
from validation.memory import STATUS, peak_megabytes

SCRIPT = "from validation.memory import peak_megabytes; print(peak_megabytes())"


@pytest.mark.skipif(not STATUS.exists(), reason="only Linux has this number")
def test_the_memory_of_a_starting_process_is_not_that_of_the_started_one() -> None:
    held = np.ones(25_000_000)  # 200 MB
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, check=True)
    assert 1.0 < float(done.stdout) < 100.0 < peak_megabytes()
    assert held.size


def test_peak_memory_contains_what_was_held_for_a_moment() -> None:
    before = peak_megabytes()
    held = np.ones(int(before * 125_000) + 12_500_000)  # the peak so far, and 100 MB
    assert peak_megabytes() - before > 90.0
    assert held.size
