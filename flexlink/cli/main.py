"""The command line `flexlink`: each command has a module, which is loaded on use; errors are printed as one line."""

import argparse
import contextlib
import functools
import gc
import importlib
import io
import os
import re
import signal
import sys
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TextIO

from flexlink.common.errors import ALSO, ArgumentError, FlexlinkError
from flexlink.common.interruption import finish, word
from flexlink.common.versions import __version__
from flexlink.common.wording import closest, coloured, did_you_mean, id_of
from flexlink.results.stop_reasons import InterruptedRunError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit code.

    0: done; 1: negative result, such as engines that disagree or no model within the tolerance; 2: error; 130: Ctrl-C;
    143: SIGTERM.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for terminals that cannot show q̈
    with _harmless(sys.stdout or io.StringIO()), _harmless(sys.stderr or io.StringIO()):  # a closed one is None
        return _run(arguments)


@contextlib.contextmanager
def _harmless(stream: TextIO) -> Iterator[None]:
    """Write control characters, also those of the direction of writing, as escapes: a name cannot steer a terminal.

    Exceptions are the colours of `coloured`, and a return to the line's start with which a text begins.
    """
    steering = r"[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]"
    wrong = re.compile(rf"(?!\A\r){steering}|\x1b(?!\[(?:0|1;3\d)m)")
    write = stream.write
    stream.write = lambda text: write(wrong.sub(lambda sign: f"\\u{ord(sign[0]):04x}", text))  # type: ignore[method-assign]
    try:
        yield
    finally:
        stream.write = write  # type: ignore[method-assign]


def _run(arguments: Sequence[str] | None) -> int:
    alone = arguments is None  # the process ends when this command ends
    with contextlib.ExitStack() as loaded:
        if alone:  # scanning the modules that are loaded would take 0.2 s
            gc.disable()
            loaded.callback(gc.enable)
            loaded.callback(gc.freeze)
        words = list(sys.argv[1:] if arguments is None else arguments)
        options = build_parser(words).parse_args([] if words == ["help"] else words)
        if options.command is None:
            build_parser(words=()).print_help()
            return 0
        from flexlink.cli.terminal import announced  # noqa: PLC0415  loads the compiler: 0.4 s, not needed for help
    try:
        with announced():
            code = _run_command(options)
        print(end="", flush=True)  # detect a full disk or a closed pipe here
        return code
    except BrokenPipeError:  # the reading process has ended, as in `flexlink info scene.toml | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (FlexlinkError, OSError, MemoryError) as error:
        reasons = ["not enough memory"] if isinstance(error, MemoryError) else []
        mistakes = "\n  also: ".join(" ".join(each.split()) for each in str(error).split(ALSO))
        text = ": ".join([*reasons, *filter(None, [mistakes + _copied_by(error, options)])])
        print(f"{coloured('flexlink')}: {text}{id_of(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        number = getattr(error, "signal", signal.SIGINT)
        lost = isinstance(error, InterruptedRunError) and options.command != "simulate"  # only simulate keeps samples
        print(f"flexlink: {word(number) if lost else str(error) or 'interrupted'}", file=sys.stderr)
        return 128 + number
    finally:
        finish()
        if alone:
            gc.freeze()  # avoids the last garbage collection, which takes 0.1 s


def _run_command(options: argparse.Namespace) -> int:
    """Run the command; with `--json`, print one document: its own, and the lines that it would print beside it."""
    _check(options)
    if not options.json:
        return int(options.module.run_command(options))
    from flexlink.data.documents import in_json  # noqa: PLC0415  loads NumPy, not needed for help

    options.document, lines = {}, io.StringIO()
    with contextlib.redirect_stdout(lines):
        code = int(options.module.run_command(options))
    print(in_json({"lines": lines.getvalue().splitlines()} | options.document))
    return code


def _check(options: argparse.Namespace) -> None:
    """Refuse options without effect beside the others that are given, and outputs that cannot be written."""
    table = {name: about for name, about in _arguments_of(options.command).items() if name.startswith("--")}
    values = {name: vars(options)[about.get("dest", name[2:].replace("-", "_"))] for name, about in table.items()}
    given = [name for name in table if values[name] not in (None, False, [], table[name].get("default"))]
    for name in given:
        if (needs := table[name].get("needs", name)) not in given:
            raise ArgumentError(f"{name}: has no effect without {needs}; add it, or leave {name} out", id="no-effect")
        if (without := table[name].get("without")) in given:
            raise ArgumentError(f"{name}: has no effect with {without}; leave one of them out", id="no-effect")
        if "is" in table[name]:
            getattr(importlib.import_module("flexlink.cli.shared"), f"require_{table[name]['is']}")(values[name])


def _copied_by(error: Exception, options: argparse.Namespace) -> str:
    """The command that copies the scene, if it is missing here but one of the examples."""
    path = getattr(options, "scene", None)
    if getattr(error, "id", "") != "cannot-read" or not isinstance(path, Path) or path.exists():
        return ""
    if near := did_you_mean(path.name, [one.name for one in path.parent.glob("*.toml")]):
        return near
    folders = [one.name for one in path.parent.parent.glob("*/") if (one / path.name).is_file()]
    if not path.parent.exists() and (folder := closest(path.parent.name, folders)):
        return f"; did you mean {str(path.parent.with_name(folder) / path.name)!r}?"
    names = [Path(name) for name in importlib.import_module("flexlink.cli.examples").bundled()]
    if here := [str(name) for name in names if name.name == path.name and name.is_file()]:
        return f"; did you mean {here[0]!r}?"
    return "".join(f"; get {name} by: flexlink examples {name}" for name in names if name.name == path.name)


COMMANDS = {
    "plot": "simulate SCENE --plot run.png", "run": "simulate", "animate": "show", "film": "show",
    "convert": "export", "validate": "compare", "identify": "fit", "optimise": "advise", "frequencies": "modes",
}  # fmt: skip
"""What commands of other programs are called here; in code, since a wrong command loads nothing, no TOML either."""


class _Parser(argparse.ArgumentParser):
    """A parser that reports a wrong option in one line, and reads 1mm where an option's help names its unit, [m]."""

    def add_argument(self, *names: str, **about: Any) -> argparse.Action:
        """Add an argument; every `--out` is also `-o`."""
        unit = re.search(r"\[(m|s)\]", about.get("help", ""))
        if about.get("type") is float and unit:
            about["type"] = functools.partial(_in_si, unit[1])
        return super().add_argument(*(("-o", "--out") if "--out" in names else names), **about)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse words; unknown ones are refused here, where the options of the command are known."""
        if sum(word == "--out" or word.startswith(("-o", "--out=")) for word in args or ()) > 1:
            self.error("argument -o/--out: given twice, but one place is written; run the command for each")
        found, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f"unrecognized arguments: {' '.join(rest)}{self._instead_of(rest[0])}")
        return found, rest

    def _instead_of(self, given: str) -> str:
        """End of the message on a word that no argument takes: what was probably meant, or what the command takes."""
        names = {name.strip("-"): name for name in self._option_string_actions}
        word = given.partition("=")[0].strip("-")
        word = meant if (meant := _table("meant")["option"].get(word)) in names else word
        near = names.get(closest(word, names) or "", "")
        near = next((f"{one.option_strings[-1]} {word}" for one in self._actions if word in (one.choices or ())), near)
        if "--file" in self._option_string_actions and Path(given).is_file():
            if Path(given).suffix == ".toml":
                return f"; to compare two scenes, export one: flexlink export {given} --format mjcf, then --file"
            near = f"--file {given}"
        if near:
            return f"; did you mean {near!r}?"
        takes = [one.dest for one in self._actions if not one.option_strings]
        if given.startswith("-"):
            options = ", ".join(name for name in self._option_string_actions if name.startswith("--"))
            return f"; give the {word} without --{word}" if word in takes else f"; its options are {options}"
        in_one = "; write a value in one piece, such as --set tip.mass=3 or --tip 2mm"
        is_part = re.match(r"[+.\d]|[a-zµ]{1,3}$", given) is not None  # a number or a unit
        return f"; {self.prog} takes {' and '.join(takes) or 'no names'}{in_one * is_part}"

    def error(self, message: str) -> NoReturn:
        if wrong := re.search(r"invalid choice: '?(.*?)'? \(choose from (.*)\)", message):
            known, where = [name.strip("' ") for name in wrong[2].split(",")], message.partition(": invalid")[0]
            is_command = where == "argument command"
            what = "unknown command" if is_command else f"{where}: unknown"
            meant = COMMANDS.get(wrong[1]) if is_command else None
            near = f"; did you mean {meant!r}?" if meant else did_you_mean(wrong[1], known)
            message = f"{what} {wrong[1]!r}{near or '; allowed are ' + ', '.join(known)}"
        for row in () if wrong else _table("meant")["message"]:
            message = re.sub(row["pattern"], row["text"], message)
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _in_si(unit: str, text: str) -> float:
    """A number in m or s, or with a unit that converts to it, such as 1mm."""
    from flexlink.data.csv_table import conversion, units_like  # noqa: PLC0415  loads NumPy, not needed for help

    number, given = re.fullmatch(r"(.*?)\s*([^\W\d_]*)", text).groups()  # type: ignore[union-attr]
    try:
        return float(number) * conversion(given or unit, unit)  # type: ignore[operator]
    except (TypeError, ValueError):  # another unit, or no number
        why = f"{text!r}: expected a number in {unit}, such as 0.5, or with a unit: {', '.join(units_like(unit))}"
        raise argparse.ArgumentTypeError(why) from None


def build_parser(words: Container[str] | None = None) -> argparse.ArgumentParser:
    """Build the parser; with `words`, only the commands among them get options, and only their modules are loaded."""
    known = _known_commands()
    keys = (
        "keys of a scene, with their units and defaults:",
        '  python -c "import flexlink; help(flexlink.Link)"   also Joint, Material, Section, Drive, Reference, ...',
        "  flexlink examples models                           copies complete scenes to start from\n",
    )
    shown = [f"  {known[name][1][0]}" for name in ("simulate", "advise", "show", "import", "fit")]
    parser = _Parser(
        prog="flexlink",
        description="Robot arms with flexible links: simulate, find modes, export, compare. SI units.",
        epilog="\n".join([*keys, "examples, more by `flexlink COMMAND --help`:", *shown]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flexlink {__version__}")
    commands = parser.add_subparsers(metavar="command", dest="command")
    for name, (about, examples) in known.items():
        command = commands.add_parser(
            name, help=about.replace("%", "%%"), description=about,
            epilog="\n  ".join(["examples:", *examples]), formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        if words is not None and name not in words:
            continue
        file = {"import": "import_robot", "reduce": "advise"}.get(name, name)
        loaded = importlib.import_module(f"flexlink.cli.{file}")
        command.set_defaults(module=loaded)
        _add_arguments(command, name, vars(loaded))
    return parser


def _add_arguments(command: argparse.ArgumentParser, name: str, words: Mapping[str, Any]) -> None:
    """Add the arguments of a command; `words` are those of the help texts."""
    types = {"Path": Path, "float": float, "int": int}
    for argument, given in _arguments_of(name).items():
        about = {key: value for key, value in given.items() if key not in {"needs", "without", "is"}}
        about["help"] = given["help"].format_map(words)
        if "type" in about:
            about["type"] = types[about["type"]]
        if isinstance(about.get("metavar"), list):
            about["metavar"] = tuple(about["metavar"])
        command.add_argument(argument, **about)


@functools.cache
def _known_commands() -> dict[str, tuple[str, list[str]]]:
    """Help text and examples by name, from a file that needs no parser: help comes at once."""
    blocks = Path(__file__).with_name("commands.txt").read_text(encoding="utf-8").strip().split("\n\n")
    headings = [(*block.partition("\n")[0].partition(": ")[::2], block.splitlines()[1:]) for block in blocks]
    return {name: (about, examples) for name, about, examples in headings}


@functools.cache
def _table(name: str) -> dict[str, Any]:
    import tomllib  # noqa: PLC0415  not needed for help

    return tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8"))


def _arguments_of(name: str) -> dict[str, dict[str, Any]]:
    """The arguments of a command, by name."""
    found: dict[str, dict[str, Any]] = {}
    for commands, table in _table("options").items():
        found |= table if {name, "*"} & {*commands.split()} else {}
    return found


if __name__ == "__main__":
    sys.exit(main())
