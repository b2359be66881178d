"""`flexlink fit` with several problem files, or with --folds: comparison of models of the same data."""

from __future__ import annotations

import argparse
from pathlib import Path

from msgspec.structs import replace

from flexlink.cli.shared import prefix_errors, print_lines, varied
from flexlink.common.errors import ArgumentError
from flexlink.common.output import make_folder, write_text
from flexlink.common.progress import Progress
from flexlink.common.wording import Diagnostic
from flexlink.identification.compared_fits import FitComparison, compare_fits
from flexlink.identification.fit import fit
from flexlink.identification.folds import folds
from flexlink.identification.loading import load_fit
from flexlink.identification.problem import FitProblem
from flexlink.pages.tables import Table


def run_comparison(options: argparse.Namespace) -> int:
    """Fit every problem, print and write the comparison; exit with 1 if the preferred model does not pass."""
    for key in ("check", "propose", "profile"):
        if getattr(options, key):
            raise ArgumentError(f"--{key}: has no effect with several problems or --folds", id="no-effect")
    problems = [_problem(path, options) for path in options.problem]
    names, bar = _names(options.problem), Progress("fit")
    try:
        found = _compared(problems, names, options, bar)
    finally:
        bar.clear()
    if options.out is not None:
        make_folder(options.out)
        for table in found.tables:
            write_text(options.out / f"{table.name}.csv", table.csv)
    if options.json:
        options.document = found.document()
    else:
        for table in found.tables:
            print(f"{table.title}:", *_lines(table), "", sep="\n")
        for text in found.findings:
            print(text)
    for name, one in zip(found.names, found.fits, strict=True):
        print_lines("warning", [Diagnostic(f"{name}: {warning}", warning.id) for warning in one.warnings])
    return 0 if found.fits[found.names.index(found.preferred)].passed else 1


def _compared(
    problems: list[FitProblem], names: list[str], options: argparse.Namespace, bar: Progress
) -> FitComparison:
    if len(problems) > 1:
        return compare_fits(problems, names, by_folds=options.folds, grid=options.grid, progress=bar.report)
    with prefix_errors(options.problem[0]):
        one = fit(problems[0], starts=options.starts, grid=options.grid, progress=bar.report)
        return FitComparison(tuple(names), (one,), (folds(problems[0], progress=bar.report),))


def _problem(path: Path, options: argparse.Namespace) -> FitProblem:
    problem = load_fit(path)
    return replace(problem, scene=varied(path, problem.scene, options.set))


def _names(paths: list[Path]) -> list[str]:
    """Names of the files without ending, or their paths if two have the same name."""
    short = [path.stem for path in paths]
    return short if len(set(short)) == len(short) else [str(path) for path in paths]


def _lines(table: Table) -> list[str]:
    """A table as aligned text."""
    rows = [table.heads, *([_cell(cell) for cell in line] for line in table.lines)]
    width = [max(len(row[k]) for row in rows) for k in range(len(table.heads))]
    return ["  ".join(f"{cell:<{w}}" for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]


def _cell(cell: str | float | None) -> str:
    return "" if cell is None else cell if isinstance(cell, str) else f"{cell:.5g}"
