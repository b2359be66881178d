"""A sweep that is killed, workers and all, as often as one likes, ends with the rows of one that never was."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import flexlink as fl

SWEEP = """
scene = "{scene}"
set = {{ run.duration = 0.002, run.sample = 0.001 }}
quantity = {{ x = {{ of = "tip x [m]" }}, bend = {{ of = "deflection [m]", take = "max" }} }}
[sample]
count = {count}
keys = {{ tip.mass = {{ between = [0, 2] }}, initial.joint_deg.upper = {{ between = [-90, 90] }} }}
"""
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="no kill")]


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP.format(scene=ROOT / "models" / "paper_fig5.toml", count=2000), encoding="utf-8")
    return path


def start(sweep: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    """In a process group of its own, as a terminal would."""
    command = [sys.executable, "-m", "flexlink", "sweep", str(sweep), "--out", str(out), *options]
    return subprocess.Popen(command, env=ENVIRONMENT, start_new_session=True, stderr=subprocess.PIPE, text=True)


def rows(path: Path) -> list[tuple]:
    if not path.exists():
        return []
    with contextlib.closing(sqlite3.connect(path, timeout=10)) as db:
        has_rows = db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'rows'").fetchone()[0]
        return db.execute("SELECT * FROM rows ORDER BY number").fetchall() if has_rows else []


def until(found: Callable[[], bool], process: subprocess.Popen, seconds: float = 300.0) -> bool:
    end = time.monotonic() + seconds
    while not found() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    return found()


def test_rows_of_a_sweep_that_was_killed_three_times_are_those_of_one_that_was_not(sweep: Path, tmp_path: Path) -> None:
    out, rng = tmp_path / "killed.db", np.random.default_rng()
    for _ in range(3):
        there = len(rows(out))
        with start(sweep, out, "--workers", "2") as process:
            more = there + int(rng.integers(1, 400))
            assert until(lambda more=more: len(rows(out)) >= more, process)
            assert process.poll() is None, "killed on the way, not after its end"
            os.killpg(process.pid, signal.SIGKILL)
        kept = rows(out)
        assert there < len(kept) < 2000
        assert len({row[0] for row in kept}) == len(kept)
    with start(sweep, out, "--workers", "2") as process:
        assert process.wait() == 0
    undisturbed = fl.sweep(sweep)
    assert rows(out) == list(undisturbed.rows)
    assert [row[0] for row in undisturbed.rows] == list(range(2000))


@pytest.mark.parametrize(("number", "options"), [(signal.SIGINT, ["--workers", "2"]), (signal.SIGTERM, [])])
def test_a_signal_keeps_the_rows_and_says_how_to_go_on(sweep: Path, tmp_path: Path, number: int, options) -> None:
    out = tmp_path / "sweep.db"
    with start(sweep, out, *options) as process:
        assert until(lambda: bool(rows(out)), process)
        os.killpg(process.pid, number)
        assert process.stderr
        said = process.stderr.read()
    assert process.returncode == 128 + number
    kept = rows(out)
    assert f"; {len(kept)} of 2000 rows are in {out}; the same command goes on from there" in said
    assert 0 < len(kept) < 2000


def test_a_worker_that_is_killed_is_replaced(sweep: Path, tmp_path: Path) -> None:
    out = tmp_path / "sweep.db"
    with start(sweep, out, "--workers", "2") as process:
        assert until(lambda: bool(rows(out)), process)
        os.kill(workers_of(process.pid)[0], signal.SIGKILL)
        assert process.wait() == 0
    assert [(row[0], row[1]) for row in rows(out)] == [(k, "done") for k in range(2000)]


def workers_of(process: int) -> list[int]:
    """Its children that run tasks."""
    found = []
    for child in Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8").split():
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
            found.append(int(child))
    return found


@contextlib.contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A Dask scheduler and workers on loopback, each a process."""
    with contextlib.ExitStack() as stack:

        def launch(role: str, *options: str) -> subprocess.Popen:
            command = [sys.executable, "-m", f"distributed.cli.dask_{role}", *options]
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            process = subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, **quiet)  # type: ignore[call-overload]
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        file = folder / "scheduler.json"
        scheduler = launch(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)
        )
        assert until(lambda: file.exists() and "tcp://" in file.read_text(encoding="utf-8"), scheduler)
        address = next(part for part in file.read_text(encoding="utf-8").split('"') if part.startswith("tcp://"))
        options = ["--no-nanny", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard"]
        yield address, [launch("worker", address, *options) for _ in range(workers)]


def test_rows_of_a_cluster_that_lost_a_worker_are_those_of_one_process(sweep: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    out = tmp_path / "sweep.db"
    with cluster(tmp_path, 2) as (address, workers), start(sweep, out, "--dask", address) as process:
        assert until(lambda: len(rows(out)) > 100, process)
        assert process.poll() is None
        workers[0].kill()
        assert process.wait() == 0
    assert rows(out) == list(fl.sweep(sweep).rows)


def test_a_cluster_that_is_not_there_is_told(sweep: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(fl.EngineError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        fl.sweep(sweep, dask="tcp://127.0.0.1:9")
    with cluster(tmp_path, 0) as (address, _), pytest.raises(fl.EngineError, match="the scheduler has no workers"):
        fl.sweep(sweep, dask=address)
