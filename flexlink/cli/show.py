"""The command `flexlink show`."""

import argparse
import os
import sys
import webbrowser
from pathlib import Path

from flexlink.chain.lumping import lump
from flexlink.cli.shared import prefix_errors, print_lines, print_notes, print_path, require_writable, varied_scene
from flexlink.common.errors import EngineError
from flexlink.common.progress import Progress
from flexlink.motion.simulate import simulate
from flexlink.results.pictures.animate import COLOURS, FORMATS, Shot, animate, drawing_room, shot
from flexlink.results.pictures.film import film_of, frame_count

formats, colours = ", ".join(FORMATS), " or ".join(COLOURS)  # words of the help texts in `options.toml`


def run_command(options: argparse.Namespace) -> int:
    """Check that a scene can be drawn, run it, and draw the motion."""
    out = options.out or Path(options.scene.with_suffix(".gif" if options.meshes else ".html").name)
    wanted = shot(out, **{name: getattr(options, name) for name in Shot._fields[1:]})
    if options.view and not has_screen():
        raise EngineError("--view: there is no screen; write a film, such as -o film.gif", id="cannot-render")
    if not options.view:
        require_writable(out)
    scene = varied_scene(options.scene, options, {} if options.duration is None else {"run.duration": options.duration})
    frame_count(scene.run.duration, wanted.fps, wanted.speed)
    if wanted.meshes is not None:
        drawing_room("solid").shapes_of(wanted.meshes, scene, lump(scene))  # its errors come before the run
    print_notes(scene)
    with prefix_errors(options.scene):
        run = simulate(scene.varied({"run.outputs": ("loads",)}), progress=Progress(scene.name))
    print_lines("warning", run.warnings)
    if options.view:
        film = film_of(run, magnify=wanted.magnify, colour=wanted.colour, fps=wanted.fps, speed=wanted.speed)
        drawing_room("solid").view(run, film, wanted.meshes)
        return 0
    animate(run, wanted, Progress(out.name))
    print_path("film", out)
    if options.out is None and out.suffix == ".html" and has_screen():
        webbrowser.open(out.resolve().as_uri())
    return 0


def has_screen() -> bool:
    """Whether a browser can open a window; without a screen a text browser would block the terminal."""
    return sys.platform in {"darwin", "win32"} or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
