"""`flexlink`: `info`, `simulate`, `advise`, `modes`, `show`, `export`, `report` and the rest; one line on errors."""

from __future__ import annotations

import argparse
import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from flexlink.cli.advise import advise_scene
from flexlink.cli.compare import SAMPLES, compare_engines
from flexlink.cli.export import export_scenes
from flexlink.cli.import_robot import import_scene
from flexlink.cli.info import show_info
from flexlink.cli.modes import show_modes
from flexlink.cli.report import report_scene
from flexlink.cli.robots import list_robots
from flexlink.cli.show import add_options as add_show_options
from flexlink.cli.show import show_scene
from flexlink.cli.simulate import simulate_scene
from flexlink.cli.sweep import add_options, sweep_members
from flexlink.cli.terminal import announced
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import finish, word
from flexlink.common.versions import __version__
from flexlink.describe import data_files as catalogue
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.formats import FORMATS
from flexlink.results.stop_reasons import InterruptedRunError

EXAMPLES = """examples:
  flexlink info models/paper_fig5.toml
  flexlink simulate models/paper_fig5.toml --plot fall.png --out fall.csv
  flexlink simulate models/paper_fig5.toml --method RK10 --step 2e-4 --duration 1
  flexlink simulate models/t3_spatial.toml --tolerance 1e-4
  flexlink simulate models/paper_fig5.toml --set 'link.*.segments=9' --set material.aluminium.young=35e9
  flexlink advise models/t3_spatial.toml --tip 1e-3 -o small.toml
  flexlink modes models/paper_fig5.toml --lock upper fore --plot modes.png
  flexlink show models/paper_fig5.toml --magnify 50 -o fall.gif
  flexlink show models/t3_spatial.toml --colour strain --speed 0.25
  flexlink export models/paper_fig5.toml --format urdf --out .
  flexlink export models/t3_spatial.toml --format sdf --small-mass 1e-9
  flexlink compare models/paper_fig5.toml --engines pinocchio mujoco
  flexlink compare models/t3_spatial.toml --trajectory --duration 0.1
  flexlink compare models/t3_spatial.toml --file theirs.xml
  flexlink report models/t3_spatial.toml --out t3_report
  flexlink report models/t3_spatial.toml --out t3_report --against theirs.xml
  flexlink report models/ptp_move.toml --out move --against measured.csv
  flexlink import robot.urdf --base base_link --tip tool0 -o robot.toml
  flexlink robots --out models/robots
  flexlink sweep sweep.toml --out sweep.db
  flexlink sweep sweep.toml --workers 4 --export csv
  flexlink sweep sweep.toml --dask tcp://10.0.0.1:8786 --fresh
  flexlink import ur5 --posture elbow_joint=90 --flexible 'forearm_link={ frequency_hz = 12 }' -o ur5.toml
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0 done, 1 engines disagree or no model is good enough, 2 error, 130 Ctrl-C, 143 SIGTERM.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # q̈ on a terminal that cannot show it
    options = _parser().parse_args(arguments)
    try:
        with announced(), np.errstate(all="ignore"):  # numbers beyond float64 are refused where they arise
            code: int = options.command(options)
        print(end="", flush=True)  # so that a full disk or a closed pipe is noticed here
        return code
    except BrokenPipeError:  # the reader has seen enough: `flexlink info scene.toml | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (FlexlinkError, OSError) as error:
        print(f"flexlink: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"flexlink: not enough memory: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        number = getattr(error, "signal", signal.SIGINT)
        lost = isinstance(error, InterruptedRunError) and options.command is not simulate_scene  # of it nothing is kept
        print(f"flexlink: {word(number) if lost else str(error) or 'interrupted'}", file=sys.stderr)
        return 128 + number
    finally:
        finish()


class _Parser(argparse.ArgumentParser):
    """A wrong option, too, is answered in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="flexlink",
        description="Robot arms whose links bend: simulate, find modes, export, compare. SI units.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flexlink {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")

    def add(name: str, run: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        own = [line for line in EXAMPLES.splitlines() if line.startswith(f"  flexlink {name} ")]
        command = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog="\n".join(["examples:", *own]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(command=run)
        command.add_argument(
            "--set", action="append", default=[], metavar="PATH=VALUE",
            help="another value, by its path in the file, as run.step=1e-5 or 'link.*.segments=9'; may be repeated",
        )  # fmt: skip
        return command

    info = add("info", show_info, "Show the chain of a scene: degrees of freedom, masses, frequencies, stable steps.")
    info.add_argument("scene", type=Path, help="scene file (.toml)")

    _of_simulate(add("simulate", simulate_scene, "Simulate a scene with the native solver."))

    _advice_options(
        add("advise", advise_scene, "Find the smallest model that keeps the tip within a tolerance, and check it.")
    )

    shapes = add("modes", show_modes, "Natural frequencies and mode shapes about the initial posture, with gravity.")
    shapes.add_argument("scene", type=Path, help="scene file (.toml)")
    shapes.add_argument(
        "--lock", nargs="+", default=[], metavar="NAME", help="links, or joints (boom.2.z), that are held"
    )
    shapes.add_argument("--count", type=int, default=8, help="how many modes to show, slowest first (default: 8)")
    shapes.add_argument("--plot", type=Path, help="draw the mode shapes to this .png, .svg or .pdf file")

    add_show_options(add("show", show_scene, "Simulate a scene and show the arm in motion: .gif, .mp4, or a page."))

    export = add("export", export_scenes, "Write the chains of scenes as files that other engines load exactly.")
    export.add_argument("scenes", type=Path, nargs="+", help="scene files (.toml)")
    export.add_argument("--format", choices=FORMATS, action="append", help="default: all")
    export.add_argument("--out", type=Path, default=Path(), help="folder to write to (default: here)")
    export.add_argument("--strict", action="store_true", help="write nothing if a format cannot hold all of a scene")
    export.add_argument(
        "--small-mass", type=float, metavar="KG",
        help="mass for links that have none, for programs that refuse them; what it changes is printed",
    )  # fmt: skip

    check = add("compare", compare_engines, "Compare the native solver with other engines on a scene.")
    _of_compare(check)

    page = add(
        "report", report_scene, "Write a page about a scene: model, agreement, accuracy, cost, statics, modes, loads."
    )
    page.add_argument("scene", type=Path, help="scene file (.toml)")
    page.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for index.html and its files")
    page.add_argument(
        "--against", type=Path, metavar="FILE",
        help="MJCF, URDF or SDF of the same arm, to be compared; or a CSV of measurements, with t [s] and columns of "
        "`flexlink simulate --out run.csv`",
    )  # fmt: skip

    robot = add("import", import_scene, "Make a scene of a robot's URDF: the arm between two links, some bending.")
    robot.add_argument("robot", help="URDF file, or the name of an arm that `flexlink robots` lists")
    robot.add_argument(
        "-o", "--out", type=Path, help="scene file to write (.toml); default: only say what would be done"
    )
    robot.add_argument("--base", help="link where the arm begins; default: the robot's root")
    robot.add_argument("--tip", help="link where the arm ends; default: the end of the only arm")
    for option, form, text in (
        ("posture", "JOINT=DEG", "where a joint starts, or stays if it is off the path; slides in m; may be repeated"),
        ("locked", "JOINT=DEG", "a joint of the path that stays there; slides in m; may be repeated"),
        ("flexible", "LINK={…}", "a link that bends: { section, material, mass, frequency_hz, line, segments, … }"),
        ("armature", "JOINT=I", "rotor inertia seen at the joint [kg m²]; may be repeated"),
    ):
        robot.add_argument(f"--{option}", action="append", default=[], metavar=form, help=text)

    add_options(add("sweep", sweep_members, "Run all variants of a scene that a sweep file names, into a database."))

    add(
        "robots", list_robots, "List the arms of example-robot-data that `flexlink import` takes by name."
    ).add_argument("--out", type=Path, help="folder to write their scenes to")
    return parser


def _of_simulate(run: argparse.ArgumentParser) -> None:
    """Options of `simulate`."""
    own = "the scene's"
    run.add_argument("scene", type=Path, help="scene file (.toml)")
    run.add_argument(
        "--method", help=f"auto, {', '.join(catalogue.names('methods'))}, or a file (.toml); default: {own}"
    )
    run.add_argument("--step", type=float, help=f"fixed integration step [s]; default: {own}")
    run.add_argument("--tolerance", type=float, help="error of any body's place [m] that steps follow from")
    run.add_argument(
        "--relative-tolerance", type=float, help="the same as a part of the arm's reach, or of its deflection"
    )
    run.add_argument("--accuracy", help="what a relative tolerance is a part of: tip or deflection; default: tip")
    run.add_argument("--max-evaluations", type=float, help=f"evaluations that a tolerance may take; default: {own}")
    run.add_argument("--duration", type=float, help=f"simulated time [s]; default: {own}")
    run.add_argument("--sample", type=float, help=f"time between samples [s], a multiple of the step; default: {own}")
    run.add_argument("--solver", help=f"forward dynamics: {', '.join(SOLVERS)}; default: {own}")
    run.add_argument(
        "--insist", action="store_const", const="allow", dest="unstable",
        help="run in spite of a step beyond the largest stable one, or an energy that does not balance",
    )  # fmt: skip
    run.add_argument("--out", type=Path, help="write the samples to this .npz or .csv file")
    run.add_argument(
        "--plot", type=Path, help="draw angles [deg], tip [m] and energy [J] to this .png, .svg or .pdf file"
    )


def _advice_options(advice: argparse.ArgumentParser) -> None:
    advice.add_argument(
        "scene", type=Path, help="scene file (.toml); its flex, segments, lumping, steps have no effect"
    )
    advice.add_argument(
        "--tip", default="1e-3", metavar="ERROR",
        help="allowed error of the tip, a part of how far it moves, or a length as 2mm; default: 1e-3",
    )  # fmt: skip
    advice.add_argument("--deflection", action="store_true", help="the error is a part of how far springs move the tip")
    advice.add_argument("--band", type=float, metavar="HZ", help="vibrations faster than this do not count")
    advice.add_argument(
        "--budget", type=float, default=1.0, metavar="S", help="CPU time that one run may take [s]; default: 1"
    )
    advice.add_argument("-o", "--out", type=Path, help="write the scene with this model, ready to run (.toml)")


def _of_compare(check: argparse.ArgumentParser) -> None:
    """Options of `compare`."""
    check.add_argument("scene", type=Path, help="scene file (.toml)")
    check.add_argument(
        "--engines", nargs="+",
        help="default: pinocchio mujoco, of a file the one for its format; also drake, exudyn; of --trajectory all",
    )  # fmt: skip
    check.add_argument("--file", type=Path, help="MJCF, URDF or SDF of the same arm: what is wrong in it, if anything")
    for option, text in (("samples", f"number of states (default: {SAMPLES})"), ("seed", "of them (default: 0)")):
        check.add_argument(f"--{option}", type=int, help=text)
    check.add_argument(
        "--trajectory", action="store_true",
        help="compare the scene's run, step by step, with that of every engine that is installed and can run it",
    )  # fmt: skip
    check.add_argument("--duration", type=float, help="of --trajectory: simulated time [s]; default: the scene's")


if __name__ == "__main__":
    sys.exit(main())
