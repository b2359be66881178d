"""Sweeps that outgrow a machine: parts that are merged, and executors whose workers are all used."""

import contextlib
import csv
import re
import sqlite3
import subprocess
import sys
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli.main import main
from flexlink.sweeps import worker, workers
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.merge import _ranges
from flexlink.sweeps.plan import Plan
from tests.conftest import flexible, make_scene
from tests.support.words import refused, refused_line, reviewed
from tests.sweeps.test_sweeps import own_environment

SCENE = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))


def masses(count: int, **run: float) -> fl.Sweep:
    mass = {"tip.mass": {"between": [0.0, 1.0], "count": count}}
    wanted = {"x": SweepOutput(of="tip x [m]"), "spread": SweepOutput(of="tip y [m]", take="range")}
    return fl.Sweep(scene=SCENE.varied({f"run.{key}": to for key, to in run.items()}), grid=mass, quantity=wanted)


def tables(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    with closing(sqlite3.connect(path)) as db:
        return {name: db.execute(f"SELECT * FROM {name}").fetchall() for name in ("about", "rows", "checks")}


def run_parts(plan: fl.Sweep, folder: Path, count: int) -> list[Path]:
    files = [folder / f"part{k}.db" for k in range(1, count + 1)]
    for k, file in enumerate(files, 1):
        fl.sweep(plan, part=f"{k}/{count}", out=file)
    return files


@pytest.mark.parametrize(("members", "parts"), [(1, 1), (21, 4), (200, 200), (3, 8), (10**9 + 7, 1000)])
def test_every_member_is_in_one_part(members: int, parts: int) -> None:
    plan = object.__new__(Plan)
    plan.members = members
    ranges = [plan.numbers(f"{k}/{parts}") for k in range(1, parts + 1)]
    assert [0, *(each.stop for each in ranges)] == [*(each.start for each in ranges), members]
    assert max(map(len, ranges)) - min(map(len, ranges)) <= 1


KILLED = """
import os, signal, sys
import flexlink as fl
from flexlink.sweeps import run
from tests.sweeps.test_parts import masses
run.TASK_SECONDS = 1e-9  # eight members and one commit per task
kill = lambda done: os.kill(os.getpid(), signal.SIGKILL) if done > 0 else None
fl.sweep(masses(60, duration=1e-3), part="2/3", out=sys.argv[1], progress=kill)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_parts_of_which_one_was_killed_equal_one_run_bit_for_bit(tmp_path: Path) -> None:
    plan, out = masses(60, duration=1e-3), tmp_path / "part2.db"
    assert subprocess.run([sys.executable, "-c", KILLED, out], env=own_environment(), check=False).returncode == -9
    assert [row[0] for row in tables(out)["rows"]] == [*range(20, 28)]
    files = run_parts(plan, tmp_path, 3)
    assert fl.sweep(plan, merge=files[::-1], out=tmp_path / "merged.db") == fl.sweep(plan, out=tmp_path / "whole.db")
    assert tables(tmp_path / "merged.db") == tables(tmp_path / "whole.db")
    assert fl.sweep(plan, merge=files, out=tmp_path / "merged.db") == fl.sweep(plan), "merged again"


@pytest.mark.slow
def test_two_hundred_parts_of_a_small_sweep_equal_one_run(tmp_path: Path) -> None:
    plan = masses(190)  # ten parts are empty
    rows = fl.sweep(plan, merge=run_parts(plan, tmp_path, 200), out=tmp_path / "merged.db")
    assert rows == fl.sweep(plan, out=tmp_path / "whole.db")
    assert tables(tmp_path / "merged.db") == tables(tmp_path / "whole.db")


def test_a_part_in_memory_has_the_rows_of_its_members() -> None:
    plan = masses(9)
    assert fl.sweep(plan, part="2/2").rows == fl.sweep(plan).rows[4:]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four parts of a sweep, and databases that are none."""
    folder = tmp_path_factory.mktemp("parts")
    run_parts(masses(12), folder, 4)
    fl.sweep(masses(12), part="3/5", out=folder / "other.db")
    fl.sweep(masses(12), out=folder / "whole.db")
    fl.sweep(replace(masses(12), set={"gravity": [0.0, 0.0, 1.0]}), part="1/4", out=folder / "foreign.db")
    (folder / "copy.db").write_bytes((folder / "part3.db").read_bytes())
    (folder / "empty.db").touch()
    (folder / "begun.db").write_bytes((folder / "part4.db").read_bytes())
    with closing(sqlite3.connect(folder / "begun.db")) as db, db:
        db.execute("DELETE FROM rows WHERE number = 11")
    (folder / "damaged.db").write_bytes((folder / "part4.db").read_bytes())
    with closing(sqlite3.connect(folder / "damaged.db")) as db, db:
        db.execute("UPDATE rows SET x = 2.0 WHERE number = 11")
    return folder


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("part1 part3", "parts 2,4 of 4: "),
        ("part2", "parts 1,3-4 of 4: "),
        ("part1 part2 part3 none", "part 4 of 4: "),
        ("part1 part2 part3 empty", "--part 4/4"),
        ("part1 part2 part3 begun", "--part 4/4"),
        ("part1 part2 part3 part4 copy", "copy.db: has part 3/4"),
        ("part1 part2 part3 part4 other", "other.db: has part 3/5"),
        ("part1 part2 part3 part4 whole", "whole.db: "),
        ("foreign part2 part3 part4", "--part 1/4 --fresh"),
        ("none", "none.db: "),
    ],
)
def test_a_missing_unfinished_double_or_foreign_part_is_named(names: str, said: str, folder: Path) -> None:
    with refused(fl.errors.ArgumentError, "cannot-merge") as caught:
        fl.sweep(masses(12), merge=[folder / f"{name}.db" for name in names.split()])
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_damaged_part_is_refused(folder: Path) -> None:
    with refused(fl.errors.OutputError, "cannot-write"):
        fl.sweep(masses(12), merge=[folder / f"{name}.db" for name in ("part1", "part2", "part3", "damaged")])


def test_numbers_are_shown_as_job_arrays_take_them() -> None:
    assert _ranges([1, 2, 3, 5, 7, 8]) == "1-3,5,7-8"


@pytest.mark.parametrize("part", ["0/4", "5/4", "1/0", "1", "a/b", "01/4", 3, (1, 4)])
def test_a_wrong_part_is_refused(part: Any) -> None:
    with refused(fl.errors.ArgumentError, "wrong-value"):
        fl.sweep(masses(4), part=part)


def test_a_database_of_another_part_is_not_continued(folder: Path) -> None:
    with refused(fl.errors.ArgumentError, "rows-of-another-sweep"):
        fl.sweep(masses(12), part="2/4", out=folder / "part1.db")
    with refused(fl.errors.ArgumentError, "both-given"):
        fl.sweep(masses(12), part="2/4", merge=[folder / "part1.db"])


def test_the_command_runs_parts_and_merges_them(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE.to_toml(), "utf-8")
    Path("s.toml").write_text('scene = "scene.toml"\ngrid.tip.mass = [0, 1, 2]\nquantity.x.of = "tip x [m]"\n', "utf-8")
    assert [main(["sweep", "s.toml", "--part", f"{k}/4"]) for k in (1, 2, 4)] == [0] * 3, "also for an empty part"
    files = [f"s-{k}.db" for k in range(1, 5)]
    assert main(["sweep", "s.toml", "--merge", *files]) == 2
    assert "3/4" in refused_line(capsys.readouterr().err, "cannot-merge")
    assert main(["sweep", "s.toml", "--part", "3/4"]) == 0
    assert main(["sweep", "s.toml", "--merge", *files, "--export", "csv"]) == 0
    with Path("s.csv").open(encoding="utf-8", newline="") as file:
        assert [float(row["x"]) for row in csv.DictReader(file)] == fl.sweep("s.toml").column("x")


class Threads(Executor):
    """An executor that names its number of workers nowhere."""

    def __init__(self, count: int) -> None:
        self.threads = ThreadPoolExecutor(count)

    def submit(self, task: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        return self.threads.submit(task, *arguments, **named)


class Client(contextlib.nullcontext[Any]):
    """A client of a Dask cluster whose workers arrive after the first tasks were sent."""

    def __init__(self, threads: int) -> None:
        super().__init__(self)
        self.executor, self.answers = Threads(threads), chain([{}], repeat({"worker": threads}))
        self.get_executor, self.wait_for_workers = lambda: self.executor, lambda *_, **__: None
        self.nthreads = lambda: next(self.answers)


def run_at_once(monkeypatch: pytest.MonkeyPatch, tasks: int, **how: Any) -> None:
    """Run a sweep whose first tasks wait for each other."""
    barrier, started, real = threading.Barrier(tasks, timeout=60), iter(range(10_000)), worker.rows_of

    def rows_of(*task: Any) -> Any:
        if next(started) < tasks:
            barrier.wait()
        return real(*task)

    monkeypatch.setattr("flexlink.sweeps.run.rows_of", rows_of)
    assert len(fl.sweep(masses(8 * tasks), **how).rows) == 8 * tasks
    assert not barrier.broken, "not all workers had a task at the same time"


def test_all_workers_of_an_executor_have_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    executor = Threads(64)
    executor.max_workers = 64  # type: ignore[attr-defined]
    run_at_once(monkeypatch, 64, executor=executor)
    run_at_once(monkeypatch, 64, executor=Threads(64), slots=64)
    run_at_once(monkeypatch, 12, executor=lambda: ThreadPoolExecutor(12))


def test_a_cluster_that_grows_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=lambda *_, **__: Client(24)))  # type: ignore[arg-type]
    run_at_once(monkeypatch, 24, dask="tcp://10.0.0.1:8786")


def test_a_guessed_number_of_tasks_is_said() -> None:
    with pytest.warns(RuntimeWarning) as caught:
        fl.sweep(masses(1), executor=workers.InThread())
    assert [warning.message.args[0].id for warning in caught] == ["slots-guessed"]  # type: ignore[union-attr]
    reviewed("slots-guessed", re.sub("<.*>", "<InThread>", str(caught[0].message)), values=False)


@pytest.mark.parametrize(("slots", "id"), [(0, "out-of-range"), (2.5, "not-an-integer")])
def test_a_wrong_number_of_tasks_is_refused(slots: Any, id: str) -> None:
    with refused(fl.errors.ArgumentError, id):
        fl.sweep(masses(1), slots=slots)
