"""python -m validation: run the study, store the results, write the report, print the verdicts. Needs a checkout."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.output import write_text
from flexlink.common.progress import Progress
from validation.case import ALL, CASES, MODELS, Case, load_cases
from validation.judgement import correctness, judged_rows, passing, quiet, speed
from validation.store import Row, Store

try:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from validation.kinds import TIMED
    from validation.measuring import ROWS_OF
    from validation.runner import run_cases
except ImportError as missing:
    print(f"validation: {missing}; install with: python -m pip install -e '.[validation]'", file=sys.stderr)
    sys.exit(2)

HERE = Path(__file__).parent
REPORT = HERE.parent / "reports" / "latest"

EXAMPLES = """examples:
  python -m validation                      run cases not stored, touched by a change, or timed on a busy machine
  python -m validation speed                every case whose name or kind is speed or speed_…
  python -m validation pointwise 'traj*'    cases by name, kind or glob
  python -m validation --force --no-report  measure again, keep the old report
  python -m validation other_solvers_long   a case that takes minutes: it runs only if named
  python -m validation --full               all cases, two hours; if stopped, the next call continues
  python -m validation --full --untimed     only its first pass, while the machine is in use
  python -m validation --stale reports/full which cases of the stored study are not of the present code
  python -m validation --same reports/full  compare stored and published numbers; measures nothing
  python -m validation --list               list all cases
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; return 0 if every check of correctness passes, 1 if one fails, 2 if the study could not run."""
    options = _parser().parse_args(arguments)
    console = Console()
    try:
        _demand_checkout()
        if options.full and options.cases:
            raise ArgumentError(f"--full {options.cases[0]}: --full runs all cases; specify only one of the two")
        if options.stale:
            return _stale(console, options.stale)
        if options.same:
            return _same(console, options.results, options.same)
        cases = load_cases(*(options.cases or (ALL if options.list or options.full else ())))
        if options.list:
            _print_cases(console, cases)
            return 0
        if options.untimed:
            cases = [case for case in cases if case.kind not in TIMED]
        store = Store(options.results)
        store.prepare({case.name for case in load_cases(*ALL)})
        failed = _run(console, cases, store, options)
        rows = [row for row in store.rows() if row.case in {case.name for case in cases}]
        _print_verdict(console, rows, store)
        for case, why in failed.items():
            print(f"validation: {case}: {why}", file=sys.stderr)
        page = None if options.no_report else _report(store.path, options.full and not options.untimed)
    except FlexlinkError as error:
        print(f"validation: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("validation: stopped; finished results are stored and will be skipped next time", file=sys.stderr)
        return 130
    if page is not None:
        console.print(f"report: {page}", soft_wrap=True)
    return 2 if failed else 1 if correctness(rows).failed else 0


def _demand_checkout() -> None:
    for folder in (CASES, MODELS):
        if not folder.is_dir():
            raise FlexlinkError(
                f"{folder}: no such folder; the study needs a checkout of the project with its cases and scenes: "
                "clone it, then run python -m pip install -e '.[validation]' in it"
            )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m validation",
        description="Validate the library: identities, other engines, 50-digit arithmetic, convergence, speed. "
        "Runs in a checkout of the project. Exit code: 0 all checks pass, 1 a check of correctness fails (with --same: "
        "a number differs), 2 an error; speed has a separate verdict, which depends on the machine.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help="names, kinds or globs of cases (default: all)")
    parser.add_argument(
        "--full",
        action="store_true",
        help="run every case, including those that run only if named, and write reports/full, which is under version "
        "control: first untimed cases on all cores, then timed cases alone; a stored case runs again only if something "
        "that it depends on has changed, or if its limits were timed on a busy machine",
    )
    parser.add_argument("--untimed", action="store_true", help="leave out timed cases, and do not write reports/full")
    parser.add_argument("--force", action="store_true", help="measure stored cases again")
    parser.add_argument("--list", action="store_true", help="list all cases and stop")
    parser.add_argument(
        "--same",
        type=Path,
        metavar="DIR",
        help="measure nothing; report whether the stored numbers equal those of DIR (for example reports/full): "
        "bit for bit, within rounding, or different (exit code 1)",
    )
    parser.add_argument(
        "--stale",
        type=Path,
        metavar="DIR",
        help="measure nothing; list the cases of the full study in DIR (for example reports/full) that are missing or "
        "were measured before a change that can have touched them (exit code 1)",
    )
    parser.add_argument("--no-report", action="store_true", help="do not write the report")
    parser.add_argument(
        "--results", type=Path, default=HERE / "results", metavar="DIR", help="store of the results (%(default)s)"
    )
    return parser


def _run(
    console: Console, cases: Sequence[Case], store: Store, options: argparse.Namespace
) -> dict[str, FlexlinkError]:
    bar, started = Progress("reading stored results"), 0

    def report(case: str, row: Row | None) -> None:
        nonlocal started
        if row is None:
            bar(started / len(cases), case)
            started += 1
            if not console.is_terminal:  # a progress bar is useless in a log file
                console.print(f"{case} …", highlight=False)
            return
        bar((started - 1) / len(cases), f"{case}: {row.quantity}")
        if row.passed is False and not row.timed:
            bar.clear()
            console.print(f"[red]FAILED[/red] {escape(_describe(row))}", highlight=False)

    def notify(sentence: str) -> None:
        console.print(escape(sentence), highlight=False, soft_wrap=True)

    try:
        failed = run_cases(cases, store, options.force, report, full=options.full, notify=notify)
    finally:
        bar.clear()
    notify(f"{len(cases) - len(failed)} of {len(cases)} cases stored")
    if options.full:
        notify(quiet(store.finished()))
    return failed


def _report(results: Path, full: bool) -> Path | None:
    """Write the report with the package `reports`, if it is there."""
    if importlib.util.find_spec("reports") is None:
        return None
    module, make = ("reports.full", "save") if full else ("reports.build", "build")
    page: Path = getattr(importlib.import_module(module), make)(results, REPORT)
    return page


def _same(console: Console, results: Path, folder: Path) -> int:
    """Compare the stored numbers with published ones; return 0 if they are the same, 1 if not."""
    same = importlib.import_module("reports.same")
    found = same.compare(importlib.import_module("reports.results").Results.read(results), folder)
    if not found.pairs:
        raise FlexlinkError(f"{results} and {folder}: no number in common; run python -m validation first")
    for line in same.differences(found):
        console.print(f"[red]DIFFERENT[/red] {escape(line)}", highlight=False, soft_wrap=True)
    for sentence in reversed(found.sentences()):
        console.print(escape(sentence), highlight=False, soft_wrap=True)
    table = found.table()
    REPORT.mkdir(parents=True, exist_ok=True)
    write_text(REPORT / f"{table.name}.csv", table.csv)
    console.print(f"case by case: {REPORT / table.name}.csv", soft_wrap=True)
    return 0 if found.same else 1


def _stale(console: Console, folder: Path) -> int:
    """List the cases of a stored study that are not of the present code; return 0 if there are none, 1 otherwise."""
    found = importlib.import_module("reports.stale").check(folder)
    for line in found.lines():
        console.print(escape(line), highlight=False, soft_wrap=True)
    console.print(escape(found.sentence()), highlight=False, soft_wrap=True)
    return 0 if found.current else 1


def _print_cases(console: Console, cases: Sequence[Case]) -> None:
    table = Table("case", "kind", "title", box=None)
    for case in cases:
        table.add_row(case.name, case.kind, case.title)
    console.print(table)


def _print_verdict(console: Console, rows: Sequence[Row], store: Store) -> None:
    rows = judged_rows(rows, store.finished())
    table = Table("case", "passed", "failed", "information", "speed", box=None)
    for case in dict.fromkeys(row.case for row in rows):
        own = [row for row in rows if row.case == case]
        right = correctness(own)
        failed = len(right.failed)
        informing = sum(row.passed is None for row in own)
        colour = "red" if failed else "green"
        fast = speed(own).brief()
        table.add_row(case, str(right.judged - failed), f"[{colour}]{failed}[/]", str(informing), fast)
    console.print(table)
    right = correctness(rows)
    for row in right.failed:
        console.print(f"[red]FAILED[/red] {escape(_describe(row))}", highlight=False, soft_wrap=True)
    for row in rows:
        if row.state == "missed":
            console.print(f"[yellow]missed[/yellow] {escape(_describe(row))}", highlight=False, soft_wrap=True)
    console.print(f"correctness: {passing(right.judged - len(right.failed), right.judged)}")
    console.print(f"speed: {escape(speed(rows).sentence())}", soft_wrap=True)


def _describe(row: Row) -> str:
    text = f"{row.case}: {row.quantity} ({row.where}) = {row.value} {row.unit}, limit {row.bound} {row.tolerance}"
    return f"{text}. {row.note}" if row.quantity.startswith(ROWS_OF) else text


if __name__ == "__main__":
    sys.exit(main())
