"""The command `flexarm-bench`, also `python -m flexarm_bench`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from flexarm_bench import page
from flexarm_bench.benchmark import ROOM, Benchmark, load_benchmarks
from flexarm_bench.case import BenchError
from flexarm_bench.entries import Entry, find, installed, names
from flexarm_bench.files import write_blank
from flexarm_bench.judge import Verdict, judge
from flexarm_bench.units import Units

EXAMPLES = """examples:
  flexarm-bench example > my_solver.py                     a complete solver in 40 lines, for one case
  flexarm-bench list                                       cases and solvers
  flexarm-bench run --solver my_solver.py elastica         judge the function run(case, settings) of a file
  flexarm-bench run --solver mujoco --solver pinocchio     all cases, side by side
  flexarm-bench run --solver mujoco --set hinges=64 statics
  flexarm-bench blank mine elastica                        write mine/elastica.csv, for programs without Python
  flexarm-bench run --solver mine                          judge the values that were filled in
  flexarm-bench sheets -o sheets                           data sheets of all cases
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0 if all answers are accepted, 1 if one is not, 2 if it could not run."""
    options = _parser().parse_args(arguments)
    try:
        benchmarks = load_benchmarks(*options.cases)
        done: int = COMMANDS[options.command](options, benchmarks)
    except (BenchError, OSError) as error:
        print(f"flexarm-bench: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("flexarm-bench: stopped", file=sys.stderr)
        return 130
    return done


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="flexarm-bench",
        description="Judge solvers of arms with flexible links by published beams and motions. "
        "Exit code: 0 all answers are accepted, 1 one is not, 2 an error.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run solvers, judge their answers, write the results")
    run.add_argument(
        "--solver", action="append", required=True, metavar="NAME",
        help="a registered solver, a Python file with run(case, settings), or a folder of filled in files; repeatable",
    )  # fmt: skip
    run.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting for all solvers")
    run.add_argument(
        "--seed", type=int, help="seed of the units in which solvers get the cases (default: by the clock)"
    )
    run.add_argument("-o", "--output", type=Path, metavar="DIR", help="write results.md, results.csv and data sheets")
    blank = commands.add_parser("blank", help="write CSV files to fill in, for programs without Python")
    blank.add_argument("folder", type=Path)
    sheets = commands.add_parser("sheets", help="write a data sheet for each case")
    sheets.add_argument("-o", "--output", type=Path, default=Path("sheets"), metavar="DIR", help="(%(default)s)")
    commands.add_parser("list", help="list cases, with their parts and accepted errors, and solvers")
    commands.add_parser("example", help="print a complete solver, to start from")
    for command in commands.choices.values():
        command.add_argument("cases", nargs="*", metavar="CASE", help="names, globs or kinds of cases (default: all)")
    return parser


def _list(options: argparse.Namespace, benchmarks: Sequence[Benchmark]) -> int:
    print(f"{'case':18} {'asks for':12} parts  accepted error  title")
    for each in benchmarks:
        print(f"{each.name:18} {each.ask:12} {len(each.parts):5}  {each.accepted:<14g}  {each.title}")
    print("solvers: " + ", ".join(f"{name}{'' if installed(name) else ' (not installed)'}" for name in names()))
    return 0


def _example(_options: argparse.Namespace, _benchmarks: Sequence[Benchmark]) -> int:
    print(ROOM.joinpath("examples", "elastica_by_scipy.py").read_text(encoding="utf-8"), end="")
    return 0


def _blank(options: argparse.Namespace, benchmarks: Sequence[Benchmark]) -> int:
    for each in benchmarks:
        print(write_blank(options.folder, each))
    return 0


def _sheets(options: argparse.Namespace, benchmarks: Sequence[Benchmark]) -> int:
    options.output.mkdir(parents=True, exist_ok=True)
    for each in benchmarks:
        path = options.output / f"{each.name}.md"
        path.write_text(page.sheet(each), encoding="utf-8")
        print(path)
    return 0


def _run(options: argparse.Namespace, benchmarks: Sequence[Benchmark]) -> int:
    settings = dict(_setting(text) for text in options.set)
    seed = time.time_ns() % 1_000_000 if options.seed is None else options.seed
    verdicts: list[Verdict] = []
    for entry in map(find, options.solver):
        for each in benchmarks:
            for verdict in judge(entry.name, entry.run, each, settings, _units(entry, seed)):
                _print(verdict)
                verdicts.append(verdict)
        print(f"{entry.name}: {page.summary(entry.name, verdicts)}")
    conditions = f"Units of the arms: seed {seed} (`--seed {seed}` repeats them)."
    print(conditions)
    if options.output:
        print(page.write(options.output, benchmarks, verdicts, conditions))
    return 1 if any(verdict.passed is False for verdict in verdicts) else 0


def _units(entry: Entry, seed: int) -> Units:
    return Units() if entry.stored else Units.drawn(seed)


def _print(verdict: Verdict) -> None:
    error = f"{verdict.error:8.1e}" if verdict.error == verdict.error else " " * 8
    compared = f"{'≤' if verdict.passed else '>'} {verdict.accepted:.1e}" if error.strip() else " " * 9
    name = f"{verdict.case}, {verdict.part}" if verdict.part else verdict.case
    print(f"{verdict.solver:12} {name:36} {error} {compared} {verdict.words}", flush=True)


def _setting(text: str) -> tuple[str, float | str]:
    key, equals, value = text.partition("=")
    if not equals:
        raise BenchError(f"--set {text}: expected KEY=VALUE")
    try:
        return key, float(value)
    except ValueError:
        return key, value


COMMANDS = {"list": _list, "example": _example, "run": _run, "blank": _blank, "sheets": _sheets}


if __name__ == "__main__":
    sys.exit(main())
