"""`flexlink show`: Simulate a scene and show the motion: .gif, .mp4, or a page (.html).

flexlink show models/paper_fig5.toml --magnify 50 -o fall.gif
flexlink show models/t3_spatial.toml --colour strain --speed 0.25
"""

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

formats, colours = ", ".join(FORMATS), " or ".join(COLOURS)  # words of the help texts in `options.toml`


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
