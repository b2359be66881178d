"""A sweep that is killed repeatedly with its workers finally has the same rows as an undisturbed sweep."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.sweeps import workers
from tests.conftest import ROOT
from tests.support.words import line, reviewed
from validation.sweep_processes import cluster, counted, finish, killed_at, rows, started, until

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
