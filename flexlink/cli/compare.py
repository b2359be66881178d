"""`flexlink compare`: the same arm in other engines, or in a file that somebody else wrote."""

from __future__ import annotations

import argparse
import contextlib

from flexlink.cli.shared import prefix_errors, varied_scene
from flexlink.cli.terminal import Progress
from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.diagnosis.comparison import compare
from flexlink.diagnosis.trajectories import compare_trajectories

SAMPLES = 200
OF_STATES, OF_RUNS = ("file", "samples", "seed"), ("duration",)
"""Options that only one of both comparisons has."""


def compare_engines(options: argparse.Namespace) -> int:
    """Compare on a scene; 1 where engines or the file disagree by more than rounding explains."""
    _refuse_without_effect(options)
    scene = varied_scene(options.scene, options.set)
    if options.trajectory:
        return _compare_runs(scene, options)
    bar = Progress(scene.name)
    with prefix_errors(options.scene) if options.file is None else contextlib.nullcontext():  # a file names itself
        comparison = compare(
            scene, engines=options.engines, file=options.file, progress=bar,
            samples=SAMPLES if options.samples is None else options.samples, seed=options.seed or 0,
        )  # fmt: skip
    bar.clear()
    print(comparison)
    return 0 if comparison.passed else 1


def _compare_runs(scene: Scene, options: argparse.Namespace) -> int:
    bar = Progress(scene.name)
    with prefix_errors(options.scene):
        found = compare_trajectories(scene, engines=options.engines, duration=options.duration, progress=bar)
    bar.clear()
    print(found)
    return 0 if found.passed else 1


def _refuse_without_effect(options: argparse.Namespace) -> None:
    for name in OF_STATES if options.trajectory else OF_RUNS:
        value = getattr(options, name)
        if value is not None:
            why = "--trajectory compares runs, not states" if options.trajectory else "it takes --trajectory"
            raise ArgumentError(f"--{name} {value}: has no effect; {why}")
