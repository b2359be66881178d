"""Sweeps that outgrow a machine: parts that are merged, and executors whose workers are all used."""

import csv
import re
import shutil
import sqlite3
import subprocess
import sys
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from itertools import chain, repeat
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli.main import main
from flexlink.sweeps import worker, workers
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.plan import Plan
from tests.conftest import flexible, make_scene
from tests.support.words import refused, refused_line, reviewed
from tests.sweeps.test_sweeps import own_environment

SCENE = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))


def masses(count: int, **run: float) -> fl.Sweep:
    mass = {"tip.mass": {"between": [0.0, 1.0], "count": count}}
    scene = SCENE.varied({f"run.{key}": value for key, value in run.items()})
    return fl.Sweep(scene=scene, grid=mass, quantity={"x": SweepOutput(of="tip x [m]")})


def tables(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    with closing(sqlite3.connect(path)) as db:
        return {name: db.execute(f"SELECT * FROM {name}").fetchall() for name in ("about", "rows", "checks")}


def run_parts(plan: fl.Sweep, folder: Path, count: int) -> list[Path]:
    files = [folder / f"part{k}.db" for k in range(1, count + 1)]
    for k, file in enumerate(files, 1):
        fl.sweep(plan, part=f"{k}/{count}", out=file)
    return files


def merged_equal_whole(plan: fl.Sweep, folder: Path, count: int) -> None:
    """Run parts and the whole; compare rows and databases."""
    merged, whole = folder / "merged.db", folder / "whole.db"
    assert fl.sweep(plan, merge=run_parts(plan, folder, count)[::-1], out=merged) == fl.sweep(plan, out=whole)
    assert tables(merged) == tables(whole)


@pytest.mark.parametrize(("members", "parts"), [(1, 1), (21, 4), (3, 8), (999_983, 1000)])
def test_every_member_is_in_one_part(members: int, parts: int) -> None:
    plan = Plan(masses(members))
    ranges = [plan.numbers(f"{k}/{parts}") for k in range(1, parts + 1)]
    assert [0, *(each.stop for each in ranges)] == [*(each.start for each in ranges), members]
    assert {*map(len, ranges)} <= {members // parts, members // parts + 1}


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
    for _ in range(2):  # merging again changes nothing
        merged_equal_whole(plan, tmp_path, 3)


@pytest.mark.slow
def test_two_hundred_parts_of_a_small_sweep_equal_one_run(tmp_path: Path) -> None:
    merged_equal_whole(masses(190), tmp_path, 200)  # ten parts are empty


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four parts of a sweep, and databases that cannot be merged with them."""
    folder, plan = tmp_path_factory.mktemp("parts"), masses(12)
    run_parts(plan, folder, 4)
    fl.sweep(plan, part="3/5", out=folder / "other.db")
    fl.sweep(plan, out=folder / "whole.db")
    fl.sweep(replace(plan, set={"gravity": [0.0, 0.0, 1.0]}), part="1/4", out=folder / "foreign.db")
    shutil.copy(folder / "part3.db", folder / "copy.db")
    (folder / "empty.db").touch()
    for name, edit in (("begun", "DELETE FROM rows"), ("damaged", "UPDATE rows SET x = 2.0")):
        shutil.copy(folder / "part4.db", folder / f"{name}.db")
        with closing(sqlite3.connect(folder / f"{name}.db")) as db, db:
            db.execute(f"{edit} WHERE number = 11")
    return folder


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("part1 part3", "parts 2,4 of 4: "), ("part2", "parts 1,3-4 of 4: "),
        ("part1 part2 part3 empty none", "part 4 of 4: "), ("part1 part2 part3 begun", "--part 4/4"),
        ("part1 part2 part3 part4 copy", "copy.db: has part 3/4"), ("part1 other", "other.db: has part 3/5"),
        ("part1 whole", "whole.db: "), ("foreign part2 part3 part4", "--part 1/4 --fresh"),
        ("part1 part2 part3 damaged", "damaged.db: is damaged"), ("none", "none.db: "),
    ],
)  # fmt: skip
def test_a_missing_unfinished_double_foreign_or_damaged_part_is_named(names: str, said: str, folder: Path) -> None:
    with refused(fl.FlexlinkError, "cannot-write" if "damaged" in names else "cannot-merge") as caught:
        fl.sweep(masses(12), merge=[folder / f"{name}.db" for name in names.split()])
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "id"),
    [
        *[({"part": value}, "wrong-value") for value in ("0/4", "5/4", "1", (1, 4))],
        ({"slots": 0}, "out-of-range"), ({"merge": "part1.db"}, "wrong-type"),
        ({"part": "2/4", "merge": ["part1.db"]}, "both-given"),
        ({"part": "2/4", "out": "part1.db"}, "rows-of-another-sweep"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused(arguments: dict[str, Any], id: str, folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    with refused(fl.errors.ArgumentError, id):
        fl.sweep(masses(12), **arguments)


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


@pytest.mark.slow
def test_all_workers_of_an_executor_have_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    executor = Threads(64)
    executor.max_workers = 64  # type: ignore[attr-defined]
    run_at_once(monkeypatch, 64, executor=executor)
    run_at_once(monkeypatch, 64, executor=Threads(64), slots=64)
    run_at_once(monkeypatch, 12, executor=lambda: ThreadPoolExecutor(12))


def test_a_cluster_that_grows_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", distributed := MagicMock())
    client = distributed.Client.return_value
    client.get_executor.return_value = ThreadPoolExecutor(24)
    client.nthreads.side_effect = chain([{}], repeat({"worker": 24}))  # workers arrive after the first tasks
    run_at_once(monkeypatch, 24, dask="tcp://10.0.0.1:8786")
    sizes = chain([0, 0], repeat(24))
    monkeypatch.setattr(Threads, "max_workers", property(lambda _: next(sizes)), raising=False)
    run_at_once(monkeypatch, 24, executor=Threads(24))


def test_a_guessed_number_of_tasks_is_reported() -> None:
    with pytest.warns(RuntimeWarning) as caught:
        fl.sweep(masses(1), executor=workers.InThread())
    assert [warning.message.args[0].id for warning in caught] == ["slots-guessed"]  # type: ignore[union-attr]
    reviewed("slots-guessed", re.sub("<.*>", "<InThread>", str(caught[0].message)), values=False)
