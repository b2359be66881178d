"""Sweeps and studies that are killed: no row is lost, no process is left, and a result is recognised as incomplete."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.sweeps import workers
from reports.results import Results
from tests.conftest import ROOT
from tests.support.words import line, reviewed
from validation.store import Store
from validation.sweep_processes import cluster, counted, finish, killed_at, rows, started, until
from validation.tests.studies import first_screen, words_from

MEMBERS = 600  # enough to keep two workers busy for more than half a second
SWEEP = """
scene = "{scene}"
set = {{ run.duration = 0.002, run.sample = 0.001 }}
quantity = {{ x = {{ of = "tip x [m]" }}, bend = {{ of = "deflection [m]", take = "max" }} }}
[sample]
count = {count}
keys = {{ tip.mass = {{ between = [0, 2] }}, initial.joint_deg.upper = {{ between = [-90, 90] }} }}
"""
pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="no kill")]


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP.format(scene=ROOT / "models" / "paper_fig5.toml", count=MEMBERS), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[tuple]:
    path = tmp_path_factory.mktemp("undisturbed") / "sweep.toml"
    path.write_text(SWEEP.format(scene=ROOT / "models" / "paper_fig5.toml", count=MEMBERS), encoding="utf-8")
    return list(fl.sweep(path).rows)


def test_a_sweep_killed_three_times_has_the_same_rows_as_an_undisturbed_one(sweep, tmp_path, undisturbed) -> None:
    out = tmp_path / "killed.db"
    counts = np.random.default_rng().integers(1, MEMBERS // 2, size=3)
    assert killed_at(sorted(counts.tolist()), sweep, out, "--workers", "2") == 3, "killed before its end"
    assert rows(out) == undisturbed
    assert [row[0] for row in undisturbed] == list(range(MEMBERS))


@pytest.mark.parametrize(("number", "options"), [(signal.SIGINT, ["--workers", "2"]), (signal.SIGTERM, [])])
def test_a_signal_keeps_the_rows_and_the_message_explains_how_to_continue(sweep, tmp_path, number, options) -> None:
    out = tmp_path / "sweep.db"
    with started(sweep, out, *options) as process:
        assert until(lambda: counted(out) > 0, process)
        os.killpg(process.pid, number)
        assert process.stderr
        printed = process.stderr.read()
    assert process.returncode == 128 + number
    kept = counted(out)
    last = line(printed, f" {kept} of {MEMBERS} ")
    assert str(out) in last
    reviewed("killed sweep: signal", last, values=False)
    assert 0 < kept < MEMBERS


def test_a_cluster_that_lost_a_worker_gives_the_same_rows_as_one_process(sweep, tmp_path, undisturbed) -> None:
    pytest.importorskip("distributed")
    out = tmp_path / "sweep.db"
    with cluster(tmp_path, 2) as (address, processes), started(sweep, out, "--dask", address) as process:
        assert until(lambda: counted(out) > 100, process)
        assert process.poll() is None
        processes[0].kill()
        finish(process)
    assert rows(out) == undisturbed


def test_a_missing_cluster_is_refused(sweep: Path, tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "DASK_TIMEOUT", 1)
    with pytest.raises(fl.errors.EngineError) as silent:
        fl.sweep(sweep, dask="tcp://127.0.0.1:9")
    assert silent.value.id == "no-scheduler" and "tcp://127.0.0.1:9" in str(silent.value)
    with cluster(tmp_path, 0) as (address, _), pytest.raises(fl.errors.EngineError) as empty:
        fl.sweep(sweep, dask=address)
    assert empty.value.id == "no-scheduler" and address in str(empty.value)


WITH_A_WORKER = """
import os, time
from validation.runner import _pool
if __name__ == "__main__":
    print(_pool().submit(os.getpid).result(), flush=True)
    time.sleep(600)
"""
STUDY = ("order_conditions", "judge_50_digits", "physics_roll_up", "physics_finite_chains", "pointwise")


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
    end = time.monotonic() + 120.0
    while runs(worker) and time.monotonic() < end:
        time.sleep(0.02)
    assert not runs(worker)


def test_an_interrupted_study_is_reported_as_incomplete(tmp_path: Path) -> None:
    results = tmp_path / "results"
    command = [sys.executable, "-m", "validation", "--no-report", "--results", str(results), *STUDY]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as study:
        assert until(lambda: bool(Store(results).rows()), study)
        study.terminate()
    whole, planned = set(Store(results).finished()), set(Store(results).plan())
    assert whole < planned, "no unmeasured case is finished"
    missing = {each.case for each in Results.read(results).missing}
    assert missing == planned - whole
    text = first_screen(words_from(results, tmp_path))
    assert "Verification: INCOMPLETE" in text
    assert all(case in text for case in missing)
