"""`flexlink`: one command a file, loaded when it is named; one line on errors."""

from __future__ import annotations

import argparse
import contextlib
import functools
import gc
import importlib
import io
import os
import signal
import sys
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from flexlink.common.errors import ALSO, FlexlinkError
from flexlink.common.interruption import finish, word
from flexlink.common.versions import __version__
from flexlink.results.stop_reasons import InterruptedRunError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0 done, 1 engines disagree, no model is good enough or no member of a sweep ran, 2 error, 130 Ctrl-C, 143 SIGTERM.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # q̈ on a terminal that cannot show it
    alone = arguments is None  # the process is this command's, and ends with it
    with _loading() if alone else contextlib.nullcontext():
        words = sys.argv[1:] if arguments is None else arguments
        options = build_parser(words).parse_args(words)
        from flexlink.cli.terminal import announced  # noqa: PLC0415  the compiler, 0.4 s that help does not need
    try:
        with announced():
            code: int = options.module.run_command(options)
        print(end="", flush=True)  # so that a full disk or a closed pipe is noticed here
        return code
    except BrokenPipeError:  # the reader has seen enough: `flexlink info scene.toml | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (FlexlinkError, OSError, MemoryError) as error:
        reasons = ["not enough memory"] if isinstance(error, MemoryError) else []
        print(f"flexlink: {': '.join([*reasons, *filter(None, [_in_lines(error)])])}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        number = getattr(error, "signal", signal.SIGINT)
        lost = isinstance(error, InterruptedRunError) and options.command != "simulate"  # it keeps no samples
        print(f"flexlink: {word(number) if lost else str(error) or 'interrupted'}", file=sys.stderr)
        return 128 + number
    finally:
        finish()
        if alone:
            gc.freeze()  # a last look for garbage would find none that matters, in 0.1 s


def _in_lines(error: Exception) -> str:
    """An error in one line; further mistakes of the same file have a line each."""
    return "\n  also: ".join(" ".join(text.split()) for text in str(error).split(ALSO))


@contextlib.contextmanager
def _loading() -> Iterator[None]:
    """What is loaded stays: Python's collector of garbage looks through it neither meanwhile nor later: 0.2 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


class _Parser(argparse.ArgumentParser):
    """A parser that reports a wrong option in one line, too."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser(words: Container[str] | None = None) -> argparse.ArgumentParser:
    """The whole command line, one command a module; with `words`, only commands among them have their options.

    A module is loaded for its options; its texts are read.
    """
    modules = (
        "info", "simulate", "advise", "modes", "show", "export", "compare", "report", "fit", "import_robot", "robots",
        "sweep", "compile",
    )  # fmt: skip
    texts = {name: (module, text, examples) for module in modules for name, text, examples in [_help_of(module)]}
    parser = _Parser(
        prog="flexlink",
        description="Robot arms with flexible links: simulate, find modes, export, compare. SI units.",
        epilog="\n".join(["examples:", *(examples for _, _, examples in texts.values())]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flexlink {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command", dest="command")
    for name, (module, text, examples) in texts.items():
        command = commands.add_parser(
            name, help=text, description=text, epilog=f"examples:\n{examples}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        if words is None or name in words:
            _add_options(command, importlib.import_module(f"flexlink.cli.{module}"))
    return parser


def _add_options(command: argparse.ArgumentParser, module: ModuleType) -> None:
    """Those of its module, and those that all commands have."""
    command.set_defaults(module=module)
    module.add_options(command)
    command.add_argument(
        "--set", action="append", default=[], metavar="PATH=VALUE",
        help="change a value of the scene, such as run.step=1e-5 or 'link.*.segments=9'; may be repeated",
    )  # fmt: skip
    command.add_argument(
        "--quiet-hints", action="store_true", help="do not tell numbers that are likely given in another unit"
    )


@functools.cache
def _help_of(module: str) -> tuple[str, str, str]:
    """Name, help text and examples of a command, which are the docstring of its module, read and not run."""
    said = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8").split('"""')[1]
    heading, _, examples = said.partition("\n\n")
    name, _, text = heading.removeprefix("`flexlink ").partition("`: ")
    return name, " ".join(text.split()), "\n".join(f"  {line.strip()}" for line in examples.splitlines())


if __name__ == "__main__":
    sys.exit(main())
