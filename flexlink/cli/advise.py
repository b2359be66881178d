"""The command `flexlink advise`."""

import argparse
import contextlib

from flexlink.advice.advise import advise
from flexlink.cli.shared import prefix_errors, print_path, varied_scene
from flexlink.common.errors import ArgumentError
from flexlink.common.output import write_or_keep, write_text


def run_command(options: argparse.Namespace) -> int:
    """Find a model, print the reasons, and write the scene on request; exit with 1 if no model is good enough."""
    scene, tip = varied_scene(options.scene, options), options.tip
    if options.out is not None and options.out.resolve() == options.scene.resolve():
        raise ArgumentError(f"--out {options.out}: is the scene that is advised on; name another file", id="own-file")
    with contextlib.suppress(ValueError):  # a length with its unit
        tip = float(tip)
    with prefix_errors(options.scene):
        limits = {"deflection": options.deflection, "band": options.band, "budget": options.budget}
        advice = advise(scene, tip, **limits, measure=options.measure)
    names = "met", "error", "tolerance", "tip_travel", "run_time", "again_time", "horizon", "runs", "compute_time"
    options.document = {name: getattr(advice, name) for name in names} | {"scene": advice.scene.to_toml()}  # in m and s
    print(advice)
    if options.out is not None:
        write_or_keep(options.out, lambda place: write_text(place, advice.scene.to_toml()))
        print_path("scene", options.out)
    return 0 if advice.met else 1
