"""The command `flexlink simulate`."""

import argparse
import contextlib
import time

import numpy as np

from flexlink.chain.lumping import open_chain
from flexlink.cli import shared
from flexlink.common.interruption import deferred, finish
from flexlink.common.output import write_or_keep
from flexlink.common.progress import Progress
from flexlink.describe import data_files
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.sensors.instrument import coarse_samples
from flexlink.motion.evaluation_cost import machine_factor, run_cost
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.intervals import of_run
from flexlink.motion.single_run import SingleRun
from flexlink.results.files import TRAJECTORY, ending
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError
from flexlink.results.trajectory import Trajectory

# words of the help texts in `options.toml`
methods, solvers = ", ".join(data_files.names("methods")), ", ".join(SOLVERS)


def run_command(options: argparse.Namespace) -> int:
    """Run a scene with a progress bar, write its outputs, and print a summary."""
    settings = {f"run.{name}": getattr(options, name, None) for name in RunSettings.__struct_fields__}
    changes = {path: value for path, value in settings.items() if value is not None}
    if options.plot is not None:
        changes["run.outputs"] = ("torques",)
    scene = shared.varied_scene(options.scene, options, changes)
    if options.out is not None:
        ending(options.out, *TRAJECTORY)
        shared.require_writable(options.out)
    with shared.prefix_errors(options.scene):
        ready = SingleRun(problem_of(scene, tied=True))  # compiles now: signals act at once, run times are correct
        shared.print_notes(open_chain(scene))
    with deferred() as stop, contextlib.ExitStack() as last:
        last.callback(finish)
        bar = Progress(scene.name)
        started = time.perf_counter()
        try:
            with shared.prefix_errors(options.scene):
                run = ready.finish(stop, bar, warn=lambda text: _warn(bar, text))
            seconds = time.perf_counter() - started
        except (DivergenceError, InterruptedRunError) as error:
            bar.clear()
            _deliver(error.trajectory, options)
            error.args = (f"{error}{_kept_in(options)}",)
            raise
        bar.clear()
        _deliver(run, options)
        options.document = {
            "duration_s": run.t[-1] - run.t[0], "run_time_s": seconds, "tip_m": run.tip[-1], "tip_error_m": run.error,
            "energy_j": np.asarray(run.energy.total)[[0, -1]], "imbalance_j": np.abs(run.imbalance).max(),
            "warnings": shared.with_ids(run.warnings),
        }  # fmt: skip
        _summary(scene, run, seconds)
        if options.uncertain and stop.signal is None:
            with shared.prefix_errors(options.scene):
                names, expected = of_run(scene, run)
                options.document |= {"intervals": expected.document(names)}
                print(*expected.lines(names), sep="\n")
        if stop.signal is not None:
            raise InterruptedRunError(run, stop.signal, _kept_in(options))
    return 0


def _warn(bar: Progress, text: str) -> None:
    """Print a warning during the run."""
    bar.clear()
    shared.print_lines("warning", [text])


def _deliver(run: Trajectory, options: argparse.Namespace) -> None:
    """Print warnings, and write the samples and the plot."""
    shared.print_lines("warning", run.warnings)
    if run.scene is not None:
        shared.print_lines("note", coarse_samples(run.scene, run))
    if options.out is not None:
        write_or_keep(options.out, run.writer(options.out))
        shared.print_path("samples", options.out)
    if options.plot is not None:
        shared.save_plot(run.plot(what=options.panels), options.plot)


def _kept_in(options: argparse.Namespace) -> str:
    return f" in {options.out}" if options.out else "; not saved: no --out"


def _summary(scene: Scene, run: Trajectory, seconds: float) -> None:
    x, y, z = run.tip[-1]
    total, past = np.asarray(run.energy.total), run.t[-1] - run.t[0]
    if past == 0:
        print(f"{scene.name}: run.duration = 0 s: only the initial state; specify a duration, such as --duration 1")
    else:
        took = f"{seconds:.3g} s ({past / seconds:.3g} × real time), checks included"
        print(f"{scene.name}: {past:g} s simulated in {took}")
    if run.steps is not None:
        factor = machine_factor(problem_of(scene, tied=True))
        cost = factor * run_cost(run.chain, run.steps.method, run.steps.evaluations)
        print(f"steps: {run.steps}; CPU time {1e3 * cost:.3g} ms, without set-up and checks")
    if run.stated is not None:
        print(run.stated)
    z_axis = ", z down" * (scene.gravity[2] > 0)
    print(f"final tip position: x = {x:.6f}, y = {y:.6f}, z = {z:.6f} m (frame 0{z_axis})")
    print(f"energy: {total[0]:.9g} J initially, {total[-1]:.9g} J finally")
    worst, exchanged = float(np.abs(run.imbalance).max()), float(run.exchanged[-1])
    share = f", {100 * worst / exchanged:.2g} % of the {exchanged:.4g} J exchanged" if exchanged > 0 else ""
    print(f"power balance: E − E(0) − W at most {worst:.2g} J{share}")
