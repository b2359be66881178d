"""State between calls: stored rows of sweeps and their origin, archives of older versions, processes of engines."""

from __future__ import annotations

import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.engines import child_process
from flexlink.engines.child_process import IsolatedEngine
from flexlink.sweeps import fingerprint
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.plan import Plan
from flexlink.sweeps.store import Store
from flexlink.sweeps.worker import Row
from tests.conftest import flexible, make_scene
from tests.support.words import refused

SCENE = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))
SWEEP = fl.Sweep(scene=SCENE, quantity={"x": SweepOutput(of="tip x [m]")}, grid={"tip.mass": [0.0, 1.0, 2.0]})
OLDER_BODIES = {"parent", "begins", "slot", "fork", "loaded"}


@pytest.mark.parametrize("suffix", [".py", ".toml"])
def test_stored_rows_depend_on_sources_and_on_files_of_methods_and_rules(
    suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One additional byte in any of these files changes the version."""
    before, read = fingerprint.version.__wrapped__(), Path.read_bytes
    changed = next(path for path in sorted(Path(fl.__file__).parent.rglob(f"*{suffix}")))
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path == changed else b""))
    assert fingerprint.version.__wrapped__() != before


def test_stored_rows_depend_on_the_versions_of_all_packages() -> None:
    assert set(fingerprint.fingerprint(SWEEP)["versions"]) == {"flexlink", "numpy", "scipy", "numba"}


def row(number: int, reason: str = "") -> Row:
    return Row(number, "done" if not reason else "failed", reason, "", (1.0,))


def test_a_fresh_start_removes_the_rows_of_a_killed_process(tmp_path: Path) -> None:
    """The killed process left rows in the write-ahead log, which SQLite would read into the new database."""
    plan, out, left = Plan(SWEEP), tmp_path / "sweep.db", tmp_path / "left.db"
    with Store(out, plan, {"of": "this"}) as store:
        store.add([row(0), row(1)])
        for end in ("", "-wal"):
            shutil.copy(f"{out}{end}", f"{left}{end}")
    with Store(left, plan, {"of": "this"}, fresh=True) as store:
        assert store.count() == 0
        assert list(store.missing()) == [0, 1, 2]
    shutil.copy(out, left)
    with Store(left, plan, {"of": "this"}) as store:
        assert store.count() == 2


def test_an_interrupted_sweep_reports_its_signal() -> None:
    text = "2 of 3 members are done"
    stopped = fl.errors.InterruptedSweepError(text, 15)
    assert (str(stopped), stopped.signal) == (text, 15)


def test_a_damaged_page_of_the_database_is_found(tmp_path: Path) -> None:
    """The damaged page contains the end of a long text, which is read only by a full query of the table."""
    plan, out = Plan(SWEEP), tmp_path / "sweep.db"
    with Store(out, plan, {"of": "this"}) as store:
        store.add([row(0, "x" * 20_000)])
    data = bytearray(out.read_bytes())
    page = next(k for k in range(0, len(data), 4096) if data[k + 4 : k + 4096] == b"x" * 4092)
    data[page : page + 4] = b"\xff" * 4  # the number of the next page
    out.write_bytes(data)
    with sqlite3.connect(out) as db:
        numbers = db.execute("SELECT number FROM rows").fetchall()
    assert numbers == [(0,)]
    with refused(fl.errors.OutputError, "cannot-write"):
        Store(out, plan, {"of": "this"})


def test_the_rest_position_uses_the_final_angles_of_driven_joints() -> None:
    """A beam whose driven joint stays at 30° sags a little; with a free joint, it would hang down."""
    beam = flexible("a", segments=5, lumping="gauss")
    scene = make_scene(beam, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(30.0,)))
    run = fl.simulate(scene, step=1e-5, duration=2e-5, sample=1e-5)
    rest = SweepOutput(of="overshoot [m]", target="rest").place(run)
    assert np.degrees(np.arctan2(rest[1], rest[0])) == pytest.approx(30.0, abs=0.1)
    straight = np.zeros(run.chain.n)
    straight[0] = run.q[-1, 0]
    sag = fl.tip_position(run.chain, straight) - rest
    weight, EI = 2700.0 * 0.04**2 * 9.81 * np.cos(np.radians(30.0)), 70e9 * 0.04**4 / 12
    assert np.linalg.norm(sag) == pytest.approx(weight * 1.25**4 / (8 * EI), rel=0.05)


def test_a_trajectory_built_without_a_wrench_has_an_empty_wrench_array() -> None:
    run = fl.simulate(SCENE)
    bare = fl.Trajectory(run.chain, run.t, run.q, run.qd, run.tau, run.tip, run.energy)
    assert bare.tip_wrench.shape == (0, 6)


def test_archives_older_than_branched_arms_apply_the_wrench_to_the_last_body(tmp_path: Path) -> None:
    arm = make_scene(flexible("a", segments=3), flexible("b", segments=3), wrench=fl.Wrench(force=(0.0, 1.0, 0.0)))
    run = fl.simulate(arm, step=1e-5, sample=1e-5, duration=3e-5)
    arrays = dict(np.load(run.save(tmp_path / "run.npz")))
    bodies = arrays["chain_bodies"]
    names = [name for name in bodies.dtype.names if name not in OLDER_BODIES]
    arrays["chain_bodies"] = np.array(bodies[names].tolist(), [(name, bodies.dtype[name]) for name in names])
    np.savez(tmp_path / "older.npz", **{name: each for name, each in arrays.items() if name != "chain_tips"})
    again = fl.load_trajectory(tmp_path / "older.npz").chain
    np.testing.assert_array_equal(again.bodies, run.chain.bodies)
    q, qd = run.q[-1], run.qd[-1]
    wrench = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    one, other = (fl.bias_torque(chain, q, qd, tip_wrench=wrench) for chain in (run.chain, again))
    np.testing.assert_array_equal(other, one)


@pytest.mark.slow
def test_the_process_of_an_engine_outlives_the_timeout_of_its_last_call(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = IsolatedEngine("native", fl.lump(SCENE))
    monkeypatch.setattr(child_process, "CALL_TIMEOUT", 5.0)
    q = np.zeros(engine.n)
    before = engine.mass_matrix(q)
    with pytest.raises(child_process.subprocess.TimeoutExpired):
        engine._child.process.wait(6.0)
    np.testing.assert_array_equal(engine.mass_matrix(q), before)


@pytest.mark.slow
def test_an_idle_process_serves_only_one_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "_idle", {})
    chains = fl.lump(SCENE), fl.lump(make_scene(flexible("arm", segments=9)))
    waiting = IsolatedEngine("native", chains[0])._child
    assert child_process._idle == {("native", os.getpid()): waiting}
    engines = [IsolatedEngine("native", chain) for chain in chains]
    assert engines[0]._child is waiting
    for engine, chain in zip(engines, chains, strict=True):
        np.testing.assert_array_equal(engine.mass_matrix(np.zeros(chain.n)), fl.mass_matrix(chain, np.zeros(chain.n)))
