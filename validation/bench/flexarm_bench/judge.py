"""Run a solver on cases without their references, and compare its answers with them."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexarm_bench.benchmark import Benchmark
from flexarm_bench.case import Answer, Array, Cannot, Case, Settings
from flexarm_bench.units import Units

Run = Callable[[Case, Settings], Any]

HERE = Path(__file__).parent
ACCEPTED, NOT_ACCEPTED, CANNOT, FAILED = "accepted", "not accepted", "cannot", "failed"


@dataclass(frozen=True)
class Verdict:
    """The judgement of one answer; `error` is nan if there is none. `seconds` is CPU time."""

    solver: str
    case: str
    part: str
    error: float
    accepted: float
    verdict: str
    reason: str = ""
    seconds: float = math.nan
    note: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the answer is accepted; None if the solver cannot compute the case."""
        return None if self.verdict == CANNOT else self.verdict == ACCEPTED

    @property
    def words(self) -> str:
        """Verdict and reason."""
        return f"{self.verdict}: {self.reason}" if self.reason else self.verdict


def judge(
    name: str, run: Run, benchmark: Benchmark, settings: Settings | None = None, units: Units | None = None
) -> Iterator[Verdict]:
    """Yield a verdict on a solver's answer to each part of a benchmark.

    Parameters
    ----------
    name
        Name of the solver.
    run
        The solver.
    benchmark
        The problem.
    settings
        Settings for the solver.
    units
        Units of the arm that the solver gets; by default those of the file.
    """
    units = units or Units()
    for case, reference in benchmark.parts:
        start, reason, note, error = time.process_time(), "", "", math.nan
        try:
            found = run(units.similar(case), settings or {})
            seconds = time.process_time() - start
            answer = found if isinstance(found, Answer) else Answer(found)
            note, error = answer.note, error_of(case, units.back(case, _checked(case, answer)), reference.values(case))
            verdict = ACCEPTED if error <= benchmark.accepted else NOT_ACCEPTED
        except Cannot as why:
            seconds, verdict, reason = math.nan, CANNOT, str(why)
        except Exception as why:  # any fault of a solver is a verdict on it
            seconds, verdict, reason = math.nan, FAILED, f"{type(why).__name__}: {' '.join(str(why).split())}{_at(why)}"
        yield Verdict(name, case.name, case.part, error, benchmark.accepted, verdict, reason, seconds, note)


def _at(fault: Exception) -> str:
    """Last line of a solver's file at which a fault occurred, " (mine.py:12)"; "" for faults that the judge found."""
    lines = [each for each in traceback.extract_tb(fault.__traceback__) if HERE not in Path(each.filename).parents]
    return f" ({Path(lines[-1].filename).name}:{lines[-1].lineno})" if lines else ""


def error_of(case: Case, values: Array, exact: Array) -> float:
    """Error of an answer, by the definition for what the case asks for."""
    if case.ask == "statics":
        return float(np.linalg.norm(values - exact) / np.linalg.norm(exact))
    if case.ask == "motion":
        return float(np.linalg.norm(values - exact, axis=1).max())
    return float(np.abs(values / exact - 1).max())


def _checked(case: Case, answer: Answer) -> Array:
    values = np.asarray(answer.values, dtype=float)
    if values.shape != case.shape:
        raise ValueError(f"answer of shape {values.shape}: expected {case.shape}")
    if not np.isfinite(values).all():
        raise ValueError("an answer that is not finite")
    return values
