"""`flexlink advise`: the smallest model that a scene needs, and the scene with it."""

from __future__ import annotations

import argparse

from flexlink.advice.advise import advise
from flexlink.cli.shared import prefix_errors, require_writable, varied_scene
from flexlink.common.output import write_or_keep, write_text


def advise_scene(options: argparse.Namespace) -> int:
    """Find a model, say why it is this one, and write the scene where it is asked for; 1 if no model is good enough."""
    scene = varied_scene(options.scene, options.set)
    if options.out is not None:
        require_writable(options.out)
    tip = float(options.tip) if _is_number(options.tip) else options.tip
    with prefix_errors(options.scene):
        found = advise(scene, tip, deflection=options.deflection, band=options.band, budget=options.budget)
    print(found)
    if options.out is not None:
        write_or_keep(options.out, lambda place: write_text(place, found.scene.to_toml()))
        print(f"scene: {options.out}")
    return 0 if found.met else 1


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
