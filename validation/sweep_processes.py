"""Sweeps in separate processes, which can be killed, and a Dask cluster on loopback."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from flexlink.common.errors import EngineError, MissingDependencyError
from flexlink.data.documents import read_toml
from flexlink.describe.writing import toml_of

ROOT = Path(__file__).parent.parent
SWEEP_FOLDER = ROOT / "validation" / "sweeps"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
LONGEST_WAIT = 300.0  # s, for any condition


def shortened(name: str, members: int, folder: Path, method: str = "latin") -> Path:
    """Write a sweep of `validation/sweeps` with another sample size and sampling method to a folder."""
    sweep = read_toml(SWEEP_FOLDER / f"{name}.toml")
    sweep["scene"] = str((SWEEP_FOLDER / sweep["scene"]).resolve())
    sweep["sample"] |= {"count": members, "method": method}
    path = folder / f"{name}.toml"
    path.write_text(toml_of(sweep), encoding="utf-8")
    return path


def started(sweep: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    """Start `flexlink sweep` in a separate process group, as a terminal would."""
    command = [sys.executable, "-m", "flexlink", "sweep", str(sweep), "--out", str(out), *options]
    return subprocess.Popen(
        command, env=ENVIRONMENT, start_new_session=True, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def finish(process: subprocess.Popen[str]) -> None:
    """Wait until a sweep ends.

    Raises
    ------
    EngineError
        The sweep failed.
    """
    _, errors = process.communicate()
    if process.returncode:
        raise EngineError(f"flexlink sweep ended with {process.returncode}: {errors.strip()[-200:]}")


def kill(process: subprocess.Popen[str]) -> bool:
    """Kill a sweep with all its workers; return whether it was still running."""
    alive = process.poll() is None
    if alive:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return alive


def killed_at(counts: Iterable[int], sweep: Path, out: Path, *options: str) -> int:
    """Run a sweep, kill and restart it at each of these row counts; return the number of kills."""
    kills = 0
    for count in counts:
        with started(sweep, out, *options) as process:
            until(lambda count=count: counted(out) >= count, process)  # type: ignore[misc]
            kills += kill(process)
    with started(sweep, out, *options) as process:
        finish(process)
    return kills


def rows(path: Path) -> list[tuple[Any, ...]]:
    """All rows of a sweep's database, sorted by number; none if it does not exist yet."""
    return _query(path, "SELECT * FROM rows ORDER BY number")


def counted(path: Path) -> int:
    """Number of rows in a sweep's database; 0 if it does not exist yet."""
    found = _query(path, "SELECT count(*) FROM rows")
    return int(found[0][0]) if found else 0


def _query(path: Path, question: str) -> list[tuple[Any, ...]]:
    if not path.exists():
        return []
    with contextlib.closing(sqlite3.connect(path, timeout=10)) as db:
        has_rows = db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'rows'").fetchone()[0]
        return db.execute(question).fetchall() if has_rows else []


def until(found: Callable[[], bool], process: subprocess.Popen[Any], seconds: float = LONGEST_WAIT) -> bool:
    """Wait for a condition while a process runs; return whether it was met."""
    end = time.monotonic() + seconds
    while not found() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    return found()


@contextlib.contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """Run a Dask scheduler and workers as processes on loopback; yield its address and the workers.

    Raises
    ------
    MissingDependencyError
        Dask is not installed.
    """
    if importlib.util.find_spec("distributed") is None:
        raise MissingDependencyError(
            "a Dask cluster needs distributed; install it with: python -m pip install 'flexlink[dask]'"
        )
    with contextlib.ExitStack() as stack:

        def launch(role: str, *options: str) -> subprocess.Popen[str]:
            command = [sys.executable, "-m", f"distributed.cli.dask_{role}", *options]
            process = subprocess.Popen(
                command, cwd=folder, env=ENVIRONMENT, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        file = folder / "scheduler.json"
        here = ("--host", "127.0.0.1", "--no-dashboard")
        scheduler = launch("scheduler", *here, "--port", "0", "--scheduler-file", str(file))
        if not until(lambda: file.exists() and "tcp://" in file.read_text(encoding="utf-8"), scheduler):
            raise EngineError("the Dask scheduler did not start")
        address = next(part for part in file.read_text(encoding="utf-8").split('"') if part.startswith("tcp://"))
        yield address, [launch("worker", address, *here, "--no-nanny", "--nthreads", "1") for _ in range(workers)]
