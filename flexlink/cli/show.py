"""`flexlink show`: Simulate a scene and show the motion: .gif, .mp4, or a page (.html).

flexlink show models/paper_fig5.toml --magnify 50 -o fall.gif
flexlink show models/t3_spatial.toml --colour strain --speed 0.25
"""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from pathlib import Path

from flexlink.cli.shared import prefix_errors, print_lines, print_notes, print_path, require_writable, varied_scene
from flexlink.common.progress import Progress
from flexlink.motion.simulate import simulate
from flexlink.results.pictures.animate import COLOURS, FORMATS, animate, shot
from flexlink.results.pictures.film import frame_count


def add_options(command: argparse.ArgumentParser) -> None:
    """Options of `show`."""
    add = command.add_argument
    add("scene", type=Path, help="scene file (.toml)")
    add(
        "--out", type=Path,
        help=f"file to write ({', '.join(FORMATS)}); default: a page named after the scene, opened in the browser",
    )  # fmt: skip
    add("--magnify", type=float, default=1.0, metavar="X", help="magnify deflections; default: 1")
    add("--colour", default="moment", help=f"colour by {' or '.join(COLOURS)}; default: moment")
    add("--duration", type=float, help="simulated time [s]; default: the scene's")
    add("--fps", type=float, default=25.0, help="frames per second; default: 25")
    add("--speed", type=float, default=1.0, help="simulated seconds per second of film; default: 1, real time")
    add("--width", type=int, default=640, help="width of the picture [pixels]; default: 640")


def run_command(options: argparse.Namespace) -> int:
    """Check that a scene can be drawn, run it, and draw the motion."""
    out = options.out or Path(options.scene.with_suffix(".html").name)
    wanted = shot(out, **{name: getattr(options, name) for name in ("magnify", "colour", "fps", "speed", "width")})
    require_writable(out)
    scene = varied_scene(options.scene, options, {} if options.duration is None else {"run.duration": options.duration})
    frame_count(scene.run.duration, wanted.fps, wanted.speed)
    print_notes(scene)
    with prefix_errors(options.scene):
        run = simulate(scene.varied({"run.outputs": ("loads",)}), progress=Progress(scene.name))
    print_lines("warning", run.warnings)
    animate(run, wanted, Progress(out.name))
    print_path("film", out)
    if options.out is None and has_screen():
        webbrowser.open(out.resolve().as_uri())
    return 0


def has_screen() -> bool:
    """Whether a browser can open a window; without a screen a text browser would block the terminal."""
    return sys.platform in {"darwin", "win32"} or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
