"""`flexlink simulate`: one run; what is there of it is delivered, however it ends."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path

import numpy as np

from flexlink.cli.shared import draw, prefix_errors, require_picture, require_writable, varied_scene
from flexlink.cli.terminal import Progress
from flexlink.common.interruption import deferred, finish
from flexlink.common.output import write_or_keep
from flexlink.describe.conditions import RunSettings
from flexlink.describe.scene import Scene
from flexlink.dynamics.hints import notes
from flexlink.motion.simulate import SingleRun
from flexlink.results.files import output_format
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError
from flexlink.results.trajectory import Trajectory


def simulate_scene(options: argparse.Namespace) -> int:
    """Run a scene, show how far it is, deliver what was asked for."""
    settings = {f"run.{name}": getattr(options, name) for name in RunSettings.__struct_fields__}
    said = {path: value for path, value in settings.items() if value is not None}
    scene = varied_scene(options.scene, options.set, said)
    if options.out is not None:
        output_format(options.out)
        require_writable(options.out)
    require_picture(options.plot)
    with prefix_errors(options.scene):
        ready = SingleRun(scene)  # compiled: a signal need not wait, and no run is timed by it
        for note in notes(scene):
            print(f"note: {note}", file=sys.stderr)
    with deferred() as stop, contextlib.ExitStack() as last:
        last.callback(finish)
        bar = Progress(scene.name)
        started = time.perf_counter()
        try:
            with prefix_errors(options.scene):
                run = ready.finish(stop, bar, warn=lambda text: _warn(bar, text))
            seconds = time.perf_counter() - started
        except (DivergenceError, InterruptedRunError) as error:
            bar.clear()
            _deliver(error.trajectory, options)
            error.args = (f"{error}{_place(options)}",)
            raise
        bar.clear()
        _deliver(run, options)
        _summary(scene, run, seconds)
        if stop.signal is not None:
            raise InterruptedRunError(run, stop.signal, _place(options))
    return 0


def _warn(bar: Progress, text: str) -> None:
    """What cannot wait for the end of the run."""
    bar.clear()
    print(f"warning: {text}", file=sys.stderr, flush=True)


def _deliver(run: Trajectory, options: argparse.Namespace) -> None:
    """All that was asked for of the samples that are there."""
    for warning in run.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    _save(run, options.out)
    if options.plot is not None:
        draw(run.plot(), options.plot)


def _place(options: argparse.Namespace) -> str:
    return f" in {options.out}" if options.out else ", but not saved, for want of --out"


def _summary(scene: Scene, run: Trajectory, seconds: float) -> None:
    x, y, z = run.tip[-1]
    total = np.asarray(run.energy.total)
    past = run.t[-1] - run.t[0]
    print(f"{scene.name}: {past:g} s simulated in {seconds:.2f} s ({past / seconds:.1f} × real time)")
    print(f"steps: {run.steps}")
    print(f"tip at the end: x = {x:.6f}, y = {y:.6f}, z = {z:.6f} m (frame 0)")
    print(f"energy: {total[0]:.9g} J at the start, {total[-1]:.9g} J at the end")
    worst, exchanged = float(np.abs(run.imbalance).max()), float(run.exchanged[-1])
    share = f", {worst / exchanged:.2g} of the {exchanged:.4g} J exchanged" if exchanged > 0 else ""
    print(f"power balance: E − E(0) − W is at most {worst:.2g} J{share}")


def _save(run: Trajectory, out: Path | None) -> None:
    if out is not None:
        write_or_keep(out, run.writer(out))
        print(f"samples: {out}")
