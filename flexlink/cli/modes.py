"""`flexlink modes`: frequencies, damping ratios and shapes about the initial posture."""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from flexlink.chain.lumping import lump
from flexlink.cli.shared import about, draw, require_picture, varied_scene
from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.modal import Modes, modes
from flexlink.inputs.initial_state import initial_state
from flexlink.inputs.tip_wrench import initial_wrench
from flexlink.results.trajectory import plotting


def print_modes(scene: Scene, found: Modes, which: Iterable[int]) -> None:
    """Frequency, damping ratio, and beside it what the links' damping asks for at that frequency, η ω/2."""
    η = [scene.arm.loss_time(link) for link in scene.arm.links if link.flex != "rigid"]
    asks = any(η)
    print("mode  frequency [Hz]  damping ratio" + "  asked" * asks)
    for k in which:
        line = f"{k + 1:4d}  {found.hertz[k]:14.6g}  {found.damping_ratios[k]:13.4g}"
        bounds = [f"{bound(η) * found.frequencies[k] / 2:.4g}" for bound in (min, max)] if asks else []
        print("  ".join([line, " … ".join(dict.fromkeys(bounds))]).rstrip())


def show_modes(options: argparse.Namespace) -> int:
    """Print modes, slowest first, and draw them where that was asked for."""
    scene = varied_scene(options.scene, options.set)
    require_picture(options.plot)
    if options.count < 1:
        raise ArgumentError(f"--count = {options.count}: must be at least 1")
    with about(options.scene):
        chain = lump(scene)
        names = {*chain.link_names, *chain.joint_names}
        locked = [int(name) if name.isdecimal() and name not in names else name for name in options.lock]
        wrench, follower = initial_wrench(scene, chain)
        posture = initial_state(scene, chain)[0]
        found = modes(chain, posture, locked=locked, tip_wrench=wrench, follower=follower)
    print_modes(scene, found, range(min(options.count, len(found.eigenvalues))))
    if options.plot is not None:
        draw(plotting().plot_modes(found, chain, options.count), options.plot)
    return 0
