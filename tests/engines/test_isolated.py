"""An engine in another process gives the same results; if it crashes, hangs or gets Ctrl-C, this process gets an error.

The tests use the native engine: nothing has to be installed, and the mechanism is the same.
"""

import gc
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import flexlink as fl
from flexlink import Drive, Scene, lump
from flexlink.engines import child_process, load
from flexlink.engines.child_process import IsolatedEngine
from flexlink.errors import ArgumentError, DivergenceError, EngineError, MissingDependencyError
from tests.conftest import flexible, make_scene, random_state
from tests.support.words import refused

pytestmark = pytest.mark.slow  # every test starts a process

SCENE = make_scene(flexible("arm")).varied({"run.duration": 0.02})


def process_of(engine: IsolatedEngine) -> subprocess.Popen[bytes]:
    return engine._child.process


def test_an_isolated_engine_gives_the_same_results(rng: np.random.Generator) -> None:
    chain = lump(SCENE)
    here, there = load("native", chain), IsolatedEngine("native", chain)
    assert (there.name, there.version, there.n) == (here.name, here.version, here.n)
    q, qd = random_state(chain, rng)
    tau, wrench = rng.uniform(-9, 9, chain.n), rng.uniform(-9, 9, 6)
    assert_array_equal(there.mass_matrix(q), here.mass_matrix(q))
    assert_array_equal(there.bias_torque(q, qd, tip_wrench=wrench), here.bias_torque(q, qd, tip_wrench=wrench))
    assert_array_equal(there.gravity_torque(q), here.gravity_torque(q))
    assert_array_equal(there.elastic_torque(q), here.elastic_torque(q))
    assert_array_equal(there.friction_torque(qd), here.friction_torque(qd))
    assert_array_equal(there.forward_dynamics(q, qd, tau), here.forward_dynamics(q, qd, tau))
    for mine, theirs in zip(here.integrate(SCENE), there.integrate(SCENE), strict=True):
        assert_array_equal(theirs, mine)


def torn() -> Scene:
    """An arm whose drive makes the run diverge."""
    drive = Drive(kind="table", times=(0.0, 0.02), torques=((0.0,), (1e303,)))
    return SCENE.varied({"drive": drive, "run.unstable": "allow"})


def test_errors_of_an_isolated_engine_keep_their_attributes() -> None:
    engine = IsolatedEngine("native", lump(SCENE))
    with pytest.raises(DivergenceError) as caught:
        engine.integrate(torn())
    assert np.isfinite(caught.value.trajectory.q).all()
    with refused(ArgumentError, "wrong-shape"):
        engine.mass_matrix(np.zeros(1))
    with refused(EngineError, "engine-failed"):
        engine._call("no_such_method", child_process._run, "no_such_method")
    assert engine.mass_matrix(np.zeros(engine.n)).shape == (engine.n, engine.n)


@pytest.mark.parametrize("number", [signal.SIGABRT, signal.SIGSEGV, signal.SIGKILL])
def test_a_crash_is_an_error_that_names_the_call_the_arm_and_the_signal(number: signal.Signals) -> None:
    engine = IsolatedEngine("native", lump(SCENE))
    os.kill(process_of(engine).pid, number)
    for _ in range(2):
        with refused(EngineError, "engine-crashed"):
            engine.mass_matrix(np.zeros(engine.n))


def test_the_error_of_a_process_that_cannot_start_names_the_cause(tmp_path, monkeypatch) -> None:
    (tmp_path / "numba.py").write_text("raise SystemExit('no numba today')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(child_process, "_idle", {})
    with refused(EngineError, "engine-crashed"):
        IsolatedEngine("native", lump(SCENE))


def test_an_engine_process_that_times_out_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = IsolatedEngine("native", lump(SCENE))
    monkeypatch.setattr(child_process, "CALL_TIMEOUT", 0.05)
    monkeypatch.setattr(child_process, "TIMEOUT_PER_STEP", 0.0)
    with refused(EngineError, "engine-timeout"):
        engine.integrate(SCENE.varied({"run.duration": 1000.0}))
    assert process_of(engine).returncode == -signal.SIGKILL


POSIX_ONLY = {"pass_fds", "preexec_fn", "start_new_session"}
"""Arguments of `subprocess.Popen` that Windows does not support."""

BARE = """
import os, signal
for name in ("SIGALRM", "setitimer", "ITIMER_REAL", "SIGKILL", "SIGUSR1", "pthread_sigmask"):
    vars(signal).pop(name, None)
for name in ("fork", "mkfifo", "sched_getaffinity"):
    vars(os).pop(name, None)
"""


def test_isolation_uses_only_features_available_on_windows(tmp_path, monkeypatch, rng) -> None:
    """Without extra file descriptors and alarms in both processes, the engine works, and a timeout ends its process."""
    (tmp_path / "sitecustomize.py").write_text(BARE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(child_process, "_idle", {})
    for name in ("SIGALRM", "setitimer", "ITIMER_REAL"):
        monkeypatch.delattr(signal, name, raising=False)
    started = subprocess.Popen

    def popen(*arguments: object, **named: object) -> object:
        assert not named.keys() & POSIX_ONLY
        return started(*arguments, **named)

    monkeypatch.setattr(subprocess, "Popen", popen)
    engine = IsolatedEngine("native", lump(SCENE))
    without_timer = engine._call("look", eval, "not hasattr(__import__('signal'), 'setitimer')")
    assert without_timer
    q, _ = random_state(lump(SCENE), rng)
    assert_array_equal(engine.mass_matrix(q), load("native", lump(SCENE)).mass_matrix(q))
    monkeypatch.setattr(child_process, "CALL_TIMEOUT", 0.05)
    monkeypatch.setattr(child_process, "TIMEOUT_PER_STEP", 0.0)
    with refused(EngineError, "engine-timeout"):
        engine.integrate(SCENE.varied({"run.duration": 1000.0}))


def test_a_script_without_a_main_guard_is_not_run_again_in_the_child(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os\nfrom flexlink.engines.child_process import ChildProcess\n"
        "print(os.getpid(), ChildProcess().call('number', 60.0, os.getpid))\n"
    )
    path = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    printed = subprocess.run([sys.executable, script], capture_output=True, text=True, env=path, check=True).stdout
    here, child = printed.split()
    assert here != child


def test_ctrl_c_ends_the_engine_process_and_raises_keyboard_interrupt() -> None:
    engine = IsolatedEngine("native", lump(SCENE))

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    old = signal.signal(signal.SIGUSR1, interrupt)
    try:
        subprocess.Popen(["sh", "-c", f"sleep 0.3; kill -USR1 {os.getpid()}"])
        with pytest.raises(KeyboardInterrupt):
            engine.integrate(SCENE.varied({"run.duration": 1000.0}))
    finally:
        signal.signal(signal.SIGUSR1, old)
    assert process_of(engine).returncode == -signal.SIGKILL
    with refused(EngineError, "engine-crashed"):
        engine.mass_matrix(np.zeros(engine.n))


def test_ctrl_c_sent_only_to_the_engine_process_is_raised_in_the_parent() -> None:
    engine = IsolatedEngine("native", lump(SCENE))
    os.kill(process_of(engine).pid, signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        engine.mass_matrix(np.zeros(engine.n))


def test_a_process_serves_one_engine_after_another(monkeypatch) -> None:
    gc.collect()  # without this, an unused engine of an earlier test could leave its process idle later
    monkeypatch.setattr(child_process, "_idle", {})
    engine = IsolatedEngine("native", lump(SCENE))
    first, other = process_of(engine), process_of(IsolatedEngine("native", lump(SCENE)))
    assert other is not first
    del engine
    longer = make_scene(flexible("arm", segments=9))
    engine = IsolatedEngine("native", lump(longer))
    assert process_of(engine) in (first, other)
    assert engine.n == lump(longer).n


def test_errors_printed_for_one_engine_are_not_reported_for_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "_idle", {})
    engine = IsolatedEngine("native", lump(SCENE))
    engine._call("print", print, "Error: first", flush=True)
    assert engine.stderr_errors == ["first"]
    process = process_of(engine)
    del engine
    engine = IsolatedEngine("native", lump(SCENE))
    assert process_of(engine) is process
    assert engine.stderr_errors == []


def test_an_idle_process_serves_one_engine_only(monkeypatch: pytest.MonkeyPatch) -> None:
    gc.collect()
    monkeypatch.setattr(child_process, "_idle", {})
    engine = IsolatedEngine("native", lump(SCENE))
    process = process_of(engine)
    del engine
    engine, other = (IsolatedEngine("native", lump(SCENE)) for _ in range(2))
    assert process_of(engine) is process is not process_of(other)


def test_a_call_that_ends_in_time_does_not_stop_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The timer that would stop the process starts before the call and is stopped after the call."""
    calls: list[str] = []

    class Watched:
        daemon = False

        def __init__(self, seconds: float, _: object) -> None:
            calls.append(f"{seconds:g} s")

        def start(self) -> None:
            calls.append("started")

        def cancel(self) -> None:
            calls.append("stopped")

    monkeypatch.setattr(child_process, "Timer", Watched)
    child = child_process.ChildProcess()
    assert child.call("number", 60.0, os.getpid) == child.process.pid
    assert calls == ["60 s", "started", "stopped"]


def test_an_idle_process_that_died_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "_idle", {})
    engine = IsolatedEngine("native", lump(SCENE))
    process = process_of(engine)
    del engine
    process.kill()
    process.wait()
    assert IsolatedEngine("native", lump(SCENE)).n == lump(SCENE).n


def test_an_engine_process_ends_with_its_last_reference() -> None:
    child = child_process.ChildProcess()
    process = child.process
    del child
    assert process.returncode == -signal.SIGKILL


PARENT = """
import os
from tests.conftest import flexible, make_scene
from flexlink import lump
from flexlink.engines.child_process import IsolatedEngine
scene = make_scene(flexible("arm")).varied({"run.duration": 1000.0})
engine = IsolatedEngine("native", lump(scene))
print(engine._child.process.pid, flush=True)
engine.integrate(scene)
"""


def test_an_engine_process_ends_if_its_parent_is_killed() -> None:
    here = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, env=here)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    time.sleep(0.3)  # by now the engine simulates a motion of 1000 s
    assert alive(child)
    parent.kill()
    parent.wait()
    end = time.monotonic() + 30
    while alive(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not alive(child)


def alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.exists() and not re.search(r"State:\s+Z", status.read_text())


def test_the_error_of_a_missing_package_names_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pydrake.py").write_text("raise ImportError('no Drake today')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(child_process, "_idle", {})
    with refused(MissingDependencyError, "package-missing"):
        load("drake", lump(SCENE))


SHORT = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))


@pytest.mark.slow
def test_the_process_of_an_engine_outlives_the_timeout_of_its_last_call(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = IsolatedEngine("native", fl.lump(SHORT))
    monkeypatch.setattr(child_process, "CALL_TIMEOUT", 5.0)
    q = np.zeros(engine.n)
    before = engine.mass_matrix(q)
    with pytest.raises(child_process.subprocess.TimeoutExpired):
        engine._child.process.wait(6.0)
    np.testing.assert_array_equal(engine.mass_matrix(q), before)
