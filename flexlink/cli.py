"""`flexlink info | simulate | modes | export | compare`: one line on errors, exit code 2."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from flexlink import __version__, catalogue
from flexlink.chain import Chain
from flexlink.compare import compare
from flexlink.dynamics import SOLVERS
from flexlink.errors import ArgumentError, DivergenceError, FlexlinkError, InterruptedRunError
from flexlink.export import FORMATS
from flexlink.interruption import deferred, finish
from flexlink.modal import Modes, modes
from flexlink.notes import notes
from flexlink.output import write_or_keep, write_text
from flexlink.scene import Run, Scene, load_scene
from flexlink.simulate import SingleRun, override
from flexlink.stability import fastest_eigenvalues, stable_step_of
from flexlink.terminal import Progress, announced
from flexlink.trajectory import Trajectory, output_format, picture_format, plotting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LISTED = 100  # coordinates that `info` names
SLOW = 10_000  # joints beyond which the largest eigenvalues take more than a few seconds
LARGEST_MODAL = 300  # coordinates up to which `info` finds modes, in O(n³)

EXAMPLES = """examples:
  flexlink info models/paper_fig5.toml
  flexlink simulate models/paper_fig5.toml --plot fall.png --out fall.csv
  flexlink simulate models/paper_fig5.toml --method RK10 --step 2e-4 --duration 1
  flexlink modes models/paper_fig5.toml --lock upper fore --plot modes.png
  flexlink export models/paper_fig5.toml --format urdf --out .
  flexlink compare models/paper_fig5.toml --engines pinocchio mujoco
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 engines disagree, 2 error, 130 Ctrl-C, 143 SIGTERM."""
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
        print(f"flexlink: {str(error) or 'interrupted'}", file=sys.stderr)
        return 128 + getattr(error, "signal", signal.SIGINT)
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
        return command

    info = add("info", _info, "Show the chain of a scene: degrees of freedom, masses, frequencies, stable steps.")
    info.add_argument("scene", type=Path, help="scene file (.toml)")

    own = "the scene's"
    run = add("simulate", _simulate, "Simulate a scene with the native solver.")
    run.add_argument("scene", type=Path, help="scene file (.toml)")
    run.add_argument("--method", help=f"{', '.join(catalogue.names('tableaus'))}, or a file (.toml); default: {own}")
    run.add_argument("--step", type=float, help=f"integration step [s]; default: {own}")
    run.add_argument("--duration", type=float, help=f"simulated time [s]; default: {own}")
    run.add_argument("--sample", type=float, help=f"time between samples [s], a multiple of the step; default: {own}")
    run.add_argument("--dynamics", help=f"forward dynamics: {', '.join(SOLVERS)}; default: {own}")
    run.add_argument(
        "--insist", action="store_const", const="allow", dest="unstable",
        help="run in spite of a step beyond the largest stable one, or an energy that does not balance",
    )  # fmt: skip
    run.add_argument("--out", type=Path, help="write the samples to this .npz or .csv file")
    run.add_argument(
        "--plot", type=Path, help="draw angles [deg], tip [m] and energy [J] to this .png, .svg or .pdf file"
    )

    shapes = add("modes", _modes, "Natural frequencies and mode shapes about the initial posture, with gravity.")
    shapes.add_argument("scene", type=Path, help="scene file (.toml)")
    shapes.add_argument(
        "--lock", nargs="+", default=[], metavar="NAME", help="links, or joints (boom.2.z), that are held"
    )
    shapes.add_argument("--count", type=int, default=8, help="how many modes to show, slowest first (default: 8)")
    shapes.add_argument("--plot", type=Path, help="draw the mode shapes to this .png, .svg or .pdf file")

    export = add("export", _export, "Write the chains of scenes as files that other engines load exactly.")
    export.add_argument("scenes", type=Path, nargs="+", help="scene files (.toml)")
    export.add_argument("--format", choices=FORMATS, action="append", help="default: all")
    export.add_argument("--out", type=Path, default=Path(), help="folder to write to (default: here)")

    check = add("compare", _compare, "Compare the native solver with other engines on a scene.")
    check.add_argument("scene", type=Path, help="scene file (.toml)")
    check.add_argument("--engines", nargs="+", default=["pinocchio", "mujoco"], help="default: pinocchio mujoco")
    check.add_argument("--samples", type=int, default=200, help="number of states (default: 200)")
    check.add_argument("--seed", type=int, default=0, help="seed of the random states (default: 0)")
    return parser


@contextlib.contextmanager
def _about(path: Path) -> Iterator[None]:
    """Let what goes wrong with a scene after it was read name its file, too."""
    try:
        yield
    except FlexlinkError as error:
        error.args = (f"{path}: {error}",)
        raise


def _info(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene)
    with _about(options.scene):
        _show(scene)
        for note in notes(scene):
            print(f"note: {note}", file=sys.stderr)
    return 0


def _show(scene: Scene) -> None:
    chain = scene.chain()
    q0, _ = scene.initial_state(chain)
    print(f"{scene.name}: {scene.about}")
    print(f"{chain.n} degrees of freedom, {len(chain.active)} driven; mass {chain.bodies['mass'].sum():.6g} kg")
    for k in range(min(chain.n, LISTED)):
        spring = f"k = {chain.stiffness[k]:.6g} N m/rad" if chain.coordinate(k).axis else "driven"
        print(f"  {k:4d}  {chain.joint_name(k):<16} {spring}")
    if chain.n > LISTED:
        print(f"  … {chain.n - LISTED} more")
    if chain.n > SLOW:
        print(f"finding the fastest modes of {chain.n} joints …", file=sys.stderr)
    λ = fastest_eigenvalues(chain, q0)
    hertz = np.unique(np.abs(λ).round(9)) / (2 * np.pi)
    elastic = hertz[hertz > 1e-6 * hertz.max()] if hertz.any() else hertz
    print(f"elastic frequencies at the start [Hz]: {_some(elastic)}")
    bare = _without_structural_damping(chain)
    free = λ if bare is chain else fastest_eigenvalues(bare, q0)
    for method in catalogue.names("tableaus"):
        cost = "" if bare is chain else f"; {stable_step_of(free, method):.4g} s without structural damping"
        print(f"largest stable step, {method:<5} {stable_step_of(λ, method):.4g} s{cost}")
    if bare is not chain and chain.n <= LARGEST_MODAL:
        found = modes(chain, q0, tip_wrench=scene.tip_wrench)
        print("structural damping about the start, with gravity:")
        _print_modes(scene, found, np.flatnonzero(found.eigenvalues.imag)[:4])


def _without_structural_damping(chain: Chain) -> Chain:
    """The chain with Kelvin-Voigt's law left out; the same chain where there is none."""
    hinges = chain.hinges.copy()
    hinges["damping"][[k for k, c in enumerate(chain.coordinates) if c.axis]] = 0.0
    return chain if np.array_equal(hinges, chain.hinges) else dataclasses.replace(chain, hinges=hinges)


def _print_modes(scene: Scene, found: Modes, which: Iterable[int]) -> None:
    """Frequency, damping ratio, and beside it what the links' damping asks for at that frequency, η ω/2."""
    η = [scene.arm.loss_time(link) for link in scene.arm.links if link.flex != "rigid"]
    asks = any(η)
    print("mode  frequency [Hz]  damping ratio" + "  asked" * asks)
    for k in which:
        line = f"{k + 1:4d}  {found.hertz[k]:14.6g}  {found.damping_ratios[k]:13.4g}"
        bounds = [f"{bound(η) * found.frequencies[k] / 2:.4g}" for bound in (min, max)] if asks else []
        print("  ".join([line, " … ".join(dict.fromkeys(bounds))]).rstrip())


def _some(values: np.ndarray) -> str:
    shown = [f"{value:.4g}" for value in values]
    return ", ".join(shown if len(shown) <= 8 else [*shown[:4], "…", *shown[-2:]])


def _simulate(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene)
    overrides = {name: getattr(options, name) for name in Run.__struct_fields__ if getattr(options, name) is not None}
    if options.out is not None:
        output_format(options.out)
        _require_place(options.out)
    _require_picture(options.plot)
    with _about(options.scene):
        ready = SingleRun(override(scene, overrides))  # compiled: a signal need not wait, and no run is timed by it
        for note in notes(scene):
            print(f"note: {note}", file=sys.stderr)
    with deferred() as stop, contextlib.ExitStack() as last:
        last.callback(finish)
        bar = Progress(scene.name)
        started = time.perf_counter()
        try:
            with _about(options.scene):
                run = ready.finish(stop, bar)
            seconds = time.perf_counter() - started
        except (DivergenceError, InterruptedRunError) as error:
            bar.clear()
            _deliver(error.trajectory, options)
            error.args = (f"{error}{_place(options)}",)
            raise
        bar.clear()
        _deliver(run, options)
        _summary(scene, run, seconds)
        if stop.signal is not None:
            raise InterruptedRunError(run, stop.signal, _place(options))
    return 0


def _deliver(run: Trajectory, options: argparse.Namespace) -> None:
    """All that was asked for of the samples that are there."""
    for warning in run.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    _save(run, options.out)
    if options.plot is not None:
        _draw(run.plot(), options.plot)


def _place(options: argparse.Namespace) -> str:
    return f" in {options.out}" if options.out else ", but not saved, for want of --out"


def _modes(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene)
    _require_picture(options.plot)
    if options.count < 1:
        raise ArgumentError(f"--count = {options.count}: must be at least 1")
    with _about(options.scene):
        chain = scene.chain()
        names = {*chain.link_names, *(chain.joint_name(k) for k in range(chain.n))}
        locked = [int(name) if name.isdecimal() and name not in names else name for name in options.lock]
        found = modes(chain, scene.initial_state(chain)[0], locked=locked, tip_wrench=scene.tip_wrench)
    _print_modes(scene, found, range(min(options.count, len(found.eigenvalues))))
    if options.plot is not None:
        _draw(plotting().plot_modes(found, scene.name, options.count), options.plot)
    return 0


def _draw(figure: Figure, path: Path) -> None:
    write_or_keep(path, lambda place: figure.savefig(place, dpi=150))
    print(f"plot: {path}")


def _summary(scene: Scene, run: Trajectory, seconds: float) -> None:
    x, y, z = run.tip[-1]
    total = np.asarray(run.energy.total)
    print(f"{scene.name}: {run.t[-1]:g} s simulated in {seconds:.2f} s ({run.t[-1] / seconds:.1f} × real time)")
    print(f"tip at the end: x = {x:.6f}, y = {y:.6f}, z = {z:.6f} m (frame 0)")
    print(f"energy: {total[0]:.9g} J at the start, {total[-1]:.9g} J at the end")
    worst, exchanged = float(np.abs(run.imbalance).max()), float(run.exchanged[-1])
    share = f", {worst / exchanged:.2g} of the {exchanged:.4g} J exchanged" if exchanged > 0 else ""
    print(f"power balance: E − E(0) − W is at most {worst:.2g} J{share}")


def _save(run: Trajectory, out: Path | None) -> None:
    if out is not None:
        write_or_keep(out, run.writer(out))
        print(f"samples: {out}")


def _require_place(path: Path) -> None:
    """What can be known before the work: that the folder is there, and that no folder has the file's name."""
    if not path.parent.is_dir():
        raise ArgumentError(f"{path}: the folder {str(path.parent)!r} does not exist")
    if path.is_dir():
        raise ArgumentError(f"{path}: is a folder; name a file")


def _require_picture(path: Path | None) -> None:
    if path is not None:
        picture_format(path)
        _require_place(path)
        plotting()


def _export(options: argparse.Namespace) -> int:
    texts: dict[Path, str] = {}
    for path in options.scenes:
        scene = load_scene(path)
        for name in dict.fromkeys(options.format or FORMATS):
            convert, ending = FORMATS[name]
            target = options.out / (path.stem + ending)
            if target in texts:
                raise ArgumentError(f"{path}: a scene before it is written to {target}, too; export one at a time")
            with _about(path):
                texts[target] = convert(scene.chain())
    for path, text in texts.items():
        _require_place(path)
        write_text(path, text)
        print(path)
    return 0


def _compare(options: argparse.Namespace) -> int:
    scene = load_scene(options.scene)
    bar = Progress(scene.name)
    with _about(options.scene):
        comparison = compare(scene, tuple(options.engines), options.samples, options.seed, bar)
    bar.clear()
    print(comparison)
    return 0 if comparison.passed else 1


if __name__ == "__main__":
    sys.exit(main())
