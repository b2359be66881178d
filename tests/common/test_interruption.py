"""Ctrl-C and SIGTERM at any moment: samples are saved, no file is incomplete, and no traceback is printed."""

import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli import simulate
from flexlink.cli.main import main
from flexlink.common import output, progress
from flexlink.common.interruption import LAST, StoppedError, deferred, is_command
from flexlink.results import files
from tests.conftest import ROOT
from tests.support.words import refused, reviewed

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
PAPER = str(ROOT / "models" / "paper_fig5.toml")


@pytest.fixture(autouse=True)
def usual_answers():
    """Set Python's default handlers, since shells start background jobs with SIGINT ignored."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@BOTH
def test_a_signal_is_deferred_until_the_block_has_returned_its_results(number: int) -> None:
    with refused(fl.errors.ArgumentError, "test-interruption"), deferred() as outer:
        with deferred() as inner:
            signal.raise_signal(number)
        assert inner is outer
        signal.raise_signal(signal.SIGINT + signal.SIGTERM - number)
        assert (outer.requested, outer.signal) == (True, number), "the first of two"
        raise fl.errors.ArgumentError("results")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_is_raised_at_the_end_of_a_block_that_does_not_handle_it() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), deferred():
        signal.raise_signal(signal.SIGINT)
        done.append(True)
    assert done


@BOTH
def test_the_second_signal_is_deferred_and_warns_that_the_third_stops_at_once(number: int, capfd) -> None:
    with pytest.raises(StoppedError), deferred():
        for _ in range(LAST - 1):
            signal.raise_signal(number)
        reviewed("interruption: second signal", capfd.readouterr().err)
        signal.raise_signal(number)


@pytest.mark.parametrize("own", [signal.SIG_IGN, lambda *_: None])
def test_signal_handlers_of_the_calling_program_are_not_replaced(own: object) -> None:
    signal.signal(signal.SIGINT, own)
    with deferred() as stop:
        assert signal.getsignal(signal.SIGINT) is own
        signal.raise_signal(signal.SIGINT)
        assert not stop.requested


def test_threads_see_the_signal_of_the_main_thread() -> None:
    seen = []

    def look() -> None:
        with deferred() as stop:
            seen.append(stop.requested)

    def beside() -> None:
        thread = threading.Thread(target=look)
        thread.start()
        thread.join()

    beside()
    with pytest.raises(KeyboardInterrupt), deferred():
        signal.raise_signal(signal.SIGINT)
        beside()
    assert seen == [False, True]


@BOTH
def test_a_signal_does_not_wait_for_a_long_sample(number: int, models) -> None:
    seen: list[float] = []

    def stop_soon(fraction: float) -> None:
        seen.append(fraction)
        if fraction > 0:
            signal.raise_signal(number)

    with pytest.raises(fl.errors.InterruptedRunError) as caught:
        fl.simulate(fl.load_scene(models / "paper_fig5.toml"), progress=stop_soon, duration=100.0, sample=100.0)
    assert seen[-1] < 0.3  # s
    assert caught.value.signal == number
    assert caught.value.trajectory.t.tolist() == [0.0]


@pytest.mark.parametrize("clock", [time.perf_counter, lambda: 0.0], ids=["a clock", "a stopped clock"])
def test_a_run_is_split_into_short_pieces_even_if_samples_are_long(clock, models, monkeypatch) -> None:
    """50,000 steps take at least 0.1 s: 100 pieces of 1 ms. If the clock stops: 4 pieces, from 200 steps, × 8 each."""
    seen: list[float] = []
    monkeypatch.setattr(sys.modules["flexlink.motion.budget"], "BREATH", 1e-3)
    monkeypatch.setattr(sys.modules["flexlink.motion.budget"], "time", SimpleNamespace(perf_counter=clock))
    fl.simulate(fl.load_scene(models / "paper_fig5.toml"), progress=seen.append, duration=5.0, sample=5.0)
    assert len(seen) > (30 if clock() else 4)


def test_splitting_samples_into_pieces_does_not_change_the_result(models, monkeypatch) -> None:
    scene = fl.load_scene(models / "t3_spatial.toml")
    whole = fl.simulate(scene, duration=0.02, sample=0.005)
    for breath in (0.0, 1e-3):
        monkeypatch.setattr(sys.modules["flexlink.motion.budget"], "BREATH", breath)
        for sample in (0.005, 0.02):
            again = fl.simulate(scene, duration=0.02, sample=sample)
            np.testing.assert_array_equal(again.q[-1], whole.q[-1])


def at_first_call(monkeypatch, owner: object, name: str, number: int) -> None:
    """Raise a signal during the first call of `owner.name`."""
    real = getattr(owner, name)
    calls = []

    def interrupted(*arguments, **named):
        calls.append(name)
        if len(calls) == 1:
            signal.raise_signal(number)
        return real(*arguments, **named)

    monkeypatch.setattr(owner, name, interrupted)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(
    ("moment", "ending"),
    [
        ("running", ".npz"),
        ("saving", ".npz"),
        ("saving", ".csv"),
        ("before the file is there", ".npz"),
        ("drawing", ".npz"),
        ("summing up", ".npz"),
    ],
)
def test_a_signal_at_any_time_keeps_the_samples(number, ending, moment, tmp_path, capsys, monkeypatch) -> None:
    owner, name = {
        "running": (progress.Progress, "__call__"),
        "saving": (files, "write"),
        "before the file is there": (output.Path, "replace"),
        "drawing": (simulate.shared, "save_plot"),
        "summing up": (simulate, "_summary"),
    }[moment]
    at_first_call(monkeypatch, owner, name, number)
    out, picture = tmp_path / f"x{ending}", tmp_path / "x.svg"
    plot = ["--plot", str(picture)] if moment == "drawing" else []
    assert main(["simulate", PAPER, "--duration", "0.05", "--out", str(out), *plot]) == 128 + number
    assert {path.name for path in tmp_path.iterdir()} == {out.name} | ({picture.name} if plot else set())
    rows = np.load(out)["t"] if ending == ".npz" else np.genfromtxt(out, delimiter=",", skip_header=1, ndmin=2)[:, 0]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert f"{len(rows)} sample" in lines[0]
    assert str(out) in lines[0]
    reviewed("interruption: samples saved", lines[0])
    assert len(rows) == (1 if moment == "running" else 11)


def test_a_signal_while_saving_waits_for_the_file(tmp_path: Path, models, monkeypatch) -> None:
    run = fl.simulate(fl.load_scene(models / "paper_fig5.toml"), duration=0.01)
    at_first_call(monkeypatch, np, "savez_compressed", signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        run.save(tmp_path / "run.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]
    np.testing.assert_array_equal(np.load(tmp_path / "run.npz")["q"], run.q)


def test_a_signal_at_the_end_of_a_run_loses_no_sample(models) -> None:
    def stop_at_the_end(fraction: float) -> None:
        if fraction == 1.0:
            signal.raise_signal(signal.SIGTERM)

    with refused(fl.errors.InterruptedRunError, "test-interruption") as caught:
        fl.simulate(fl.load_scene(models / "paper_fig5.toml"), progress=stop_at_the_end, duration=0.02)
    assert len(caught.value.trajectory.t) == 5


@pytest.mark.parametrize(
    ("program", "words", "wanted"),
    [
        ("/usr/bin/flexlink", ["python", "/usr/bin/flexlink", "info"], True),
        ("-m", ["python", "-X", "dev", "-m", "flexlink", "info"], True),
        ("-m", ["python", "-m", "laboratory", "flexlink"], False),  # a user's program that imports the library
        ("study.py", ["python", "study.py", "-m", "flexlink"], False),
        ("", ["python"], False),
    ],
)
def test_only_the_command_line_exits_immediately_on_a_signal(program: str, words: list[str], wanted: bool) -> None:
    assert is_command([program], words) is wanted


START = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["flexlink", "simulate", {scene!r}, "--out", {out!r}]
class Bomb:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            signal.raise_signal({number})
sys.meta_path.insert(0, Bomb())
from flexlink.cli.main import main
from numba.core import event
class OnCompile(event.Listener):
    def on_start(self, event):
        pass
    def on_end(self, event):
        signal.raise_signal({number})
event.register("numba:compile", OnCompile())
sys.exit(main())
"""


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("module", ["numba", "msgspec", "flexlink.cli", "never"])
def test_a_signal_while_importing_or_compiling_ends_the_command_in_one_line(
    number: int, module: str, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = tmp_path / "x.npz"
    code = START.format(scene=PAPER, out=str(out), module=module, number=int(number))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 128 + number
    check_without_samples(done.stderr, number)
    assert len(done.stderr.splitlines()) == (2 if module == "never" else 1)
    assert not list(tmp_path.glob("*x*"))


def check_without_samples(stderr: str, number: int) -> None:
    """Check that the last line names the signal and mentions no samples."""
    last = stderr.splitlines()[-1]
    assert last.startswith(f"flexlink: {'terminated' if number == signal.SIGTERM else 'interrupted'}; ")
    assert not re.search(r"\d", last)
    reviewed("interruption: no samples", last)


@BOTH
@pytest.mark.parametrize("command", ["advise", "show"])
def test_a_command_without_samples_does_not_mention_them(number: int, command: str, monkeypatch, capsys) -> None:
    run = fl.simulate(fl.load_scene(PAPER), duration=0.01)

    def stopped(*_: object, **__: object) -> None:
        raise fl.errors.InterruptedRunError(run, number)

    name = {"advise": "advise.advise", "show": "show.simulate"}[command]
    monkeypatch.setattr(f"flexlink.cli.{name}", stopped)
    options = {"advise": ["--tip", "1e-3"], "show": ["-o", "x.gif"]}[command]
    assert main([command, PAPER, *options]) == 128 + number
    what = "terminated" if number == signal.SIGTERM else "interrupted"
    assert capsys.readouterr().err == f"flexlink: {what}\n"
