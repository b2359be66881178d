"""Find a solver: by name, as a Python file, or as a folder of stored values."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from flexarm_bench.case import BenchError, Cannot, Case, Settings
from flexarm_bench.files import Files
from flexarm_bench.judge import Run

GROUP = "flexarm_bench.solvers"
OWN = {
    "flexlink": "flexarm_bench.solvers.with_flexlink:run",
    "pinocchio": "flexarm_bench.solvers.with_pinocchio:run",
    "mujoco": "flexarm_bench.solvers.with_mujoco:run",
    "exudyn": "flexarm_bench.solvers.with_exudyn:run",
    "cosseratbench": "flexarm_bench.solvers.with_cosseratbench:run",
}
"""Solvers of this package; other packages register theirs as entry points of `GROUP`."""


@dataclass(frozen=True)
class Entry:
    """A solver that takes part; `stored` values do not change with the units of the arm."""

    name: str
    run: Run
    stored: bool = False


def names() -> list[str]:
    """Names of all solvers that are registered."""
    return [*OWN, *sorted(each.name for each in entry_points(group=GROUP) if each.name not in OWN)]


def installed(name: str) -> bool:
    """Whether the program of a registered solver is installed."""
    if name not in OWN:
        return True
    try:
        importlib.import_module(OWN[name].partition(":")[0])
    except ImportError:
        return False
    return True


def find(wanted: str) -> Entry:
    """The solver of this name, in this Python file, or from the files in this folder.

    Raises
    ------
    BenchError
        It does not exist, or has no function or class `run`.
    """
    if wanted in OWN:
        module, function = OWN[wanted].split(":")
        try:
            return Entry(wanted, getattr(importlib.import_module(module), function))
        except ImportError as missing:
            return Entry(wanted, _absent(missing))
    for each in entry_points(group=GROUP, name=wanted):
        return Entry(wanted, _runner(each.load(), wanted))
    path = Path(wanted)
    if path.is_dir():
        return Entry(path.name, Files(path).run, stored=True)
    if path.suffix == ".py":
        return Entry(path.stem, _runner(_module(path), wanted))
    raise BenchError(f"--solver {wanted}: no such solver, file or folder; available: {', '.join(names())}")


def _absent(missing: ImportError) -> Run:
    """A solver whose program is not installed."""
    reason = str(missing)

    def run(case: Case, settings: Settings) -> Any:
        raise Cannot(reason)

    return run


def _module(path: Path) -> Any:
    if not path.is_file():
        raise BenchError(f"--solver {path}: no such file")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None  # a file that ends in .py
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # any fault of a stranger's file
        raise BenchError(f"--solver {path}: {type(error).__name__}: {error}") from error
    return module


def _runner(found: Any, wanted: str) -> Run:
    """The function `run(case, settings)` of a module, class or object, or the function itself."""
    if isinstance(found, type):
        found = found()
    run = getattr(found, "run", found)
    if not callable(run):
        raise BenchError(f"--solver {wanted}: no function run(case, settings) in it")
    runner: Run = run
    return runner
