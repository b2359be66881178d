"""The command `flexlink compare`."""

import argparse
import contextlib
from typing import Any

from flexlink.chain.lumping import lump, open_chain
from flexlink.cli.shared import prefix_errors, print_lines, varied_scene
from flexlink.common.progress import Progress
from flexlink.diagnosis.comparison import Comparison, compare
from flexlink.diagnosis.trajectories import TrajectoryComparison, compare_trajectories, in_fixed_steps

MANY_STEPS = 50_000  # number of steps for which other engines take a few seconds


def run_command(options: argparse.Namespace) -> int:
    """Compare; exit with 1 if an engine or the file differs by more than rounding errors."""
    scene = varied_scene(options.scene, options)
    bar = Progress(scene.name)
    how: dict[str, Any] = {"engines": options.engines, "progress": bar}
    comparison: Comparison | TrajectoryComparison
    with prefix_errors(options.scene) if options.file is None else contextlib.nullcontext():
        if options.trajectory:
            over = scene if options.duration is None else scene.varied({"run.duration": options.duration})
            fixed, steps = in_fixed_steps(over, lump(open_chain(over)))
            number = fixed.run.duration / fixed.run.fixed_step
            if number >= MANY_STEPS:
                print_lines("note", [f"{number:,.0f} steps in each engine, {steps}; --duration shortens it"])
            comparison = compare_trajectories(scene, duration=options.duration, **how)
        else:
            comparison = compare(scene, file=options.file, samples=options.samples, seed=options.seed, **how)
    bar.clear()
    if isinstance(comparison, Comparison):
        engines: Any = comparison.diagnoses
    else:
        engines = [row._asdict() for row in comparison.rows]
    options.document = {
        "passed": comparison.passed, "scene": comparison.scene, "engines": engines, "refused": comparison.refused
    }  # fmt: skip
    print(comparison)
    return 0 if comparison.passed else 1
