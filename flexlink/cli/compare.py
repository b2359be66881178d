"""`flexlink compare`: the same arm in other engines, or in a file that somebody else wrote."""

from __future__ import annotations

import argparse
import contextlib

from flexlink.cli.shared import about, varied_scene
from flexlink.cli.terminal import Progress
from flexlink.engines.comparison import compare


def compare_engines(options: argparse.Namespace) -> int:
    """Compare on a scene; 1 where engines or the file disagree by more than rounding explains."""
    scene = varied_scene(options.scene, options.set)
    bar = Progress(scene.name)
    with about(options.scene) if options.file is None else contextlib.nullcontext():  # a file names itself
        comparison = compare(
            scene, engines=options.engines, file=options.file, samples=options.samples, seed=options.seed, progress=bar
        )
    bar.clear()
    print(comparison)
    return 0 if comparison.passed else 1
