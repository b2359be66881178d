"""The command `flexlink fit`."""

import argparse
import math
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from flexlink.cli.shared import command_line, prefix_errors, print_hints, print_lines, print_path, varied
from flexlink.common.errors import ArgumentError, Diagnostic, IdentifiabilityError
from flexlink.common.output import make_folder, or_keep, write_text
from flexlink.common.progress import Progress
from flexlink.describe.plausibility.hints import hints
from flexlink.identification.compared_fits import FitComparison, compare_fits, folds
from flexlink.identification.coordinates import hints_on_bounds
from flexlink.identification.experiments import Experiments
from flexlink.identification.fit import check_fit, fit
from flexlink.identification.fitted import Fitted, building
from flexlink.identification.identifiability import WIDE, Check, document
from flexlink.identification.prediction import predictions
from flexlink.identification.problem import FitProblem
from flexlink.identification.propose import propose
from flexlink.pages.tables import Table


def run_command(options: argparse.Namespace) -> int:
    """Check, fit and write results; exit with 1 if a parameter is not identifiable or inaccurate, or the fit worse."""
    if len(options.problem) > 1 or options.folds:
        return run_comparison(options)
    (options.problem,) = options.problem
    problem = _problem(options.problem, options)
    if options.experiments is not None:
        Experiments.load(options.experiments)  # reports mistakes before the fit
    print_hints([*hints(problem.scene), *hints_on_bounds(problem)], options)
    if options.out is not None:
        building()  # reports a missing package before the fit
        make_folder(options.out)
    with prefix_errors(options.problem):
        found: Check | Fitted
        bar = Progress("fit")
        if options.check:
            found = check_fit(problem)
        else:
            try:
                how = {"starts": options.starts, "profile": options.profile, "grid": options.grid}
                found = fit(problem, **how, progress=bar.report, bar=bar)
            except IdentifiabilityError as error:
                assert isinstance(error.check, Check)
                found = error.check
            finally:
                bar.clear()
        return _report(found, problem, options)


def _report(found: Check | Fitted, problem: FitProblem, options: argparse.Namespace) -> int:
    """Print the result, then the proposals, and write its page on request."""
    command, out, proposals = command_line(), options.out, None
    if isinstance(found, Fitted):
        options.document = found.document()
        _print_fit(found)
        if options.predict:
            _predict(found, options)
    else:
        options.document = document(found)
        _print_check(found)
    if options.propose:
        proposals = propose(found if isinstance(found, Fitted) else problem, options.experiments)
        options.document |= {"proposals": proposals.document()}
        print("", *proposals.lines(), sep="\n")
    if isinstance(found, Fitted):
        page = None if out is None else or_keep(out, lambda folder: building().build(found, folder, command, proposals))
    else:
        page = None if out is None else building().build_check(problem, found, out, command, proposals)
    if page is not None:
        print_path("page", page.page)
    return 0 if found.passed and not (isinstance(found, Check) and found.coarse) else 1


def _print_check(check: Check) -> None:
    """Print the expected intervals and what is not identifiable."""
    for note in check.notes:
        print(note)
    width = max(map(len, check.names))
    rest = len(check.names) - len(check.grid)
    errors = [*(f", grid error {100 * u:.2g} %" for u in check.grid.tolist()), *[""] * rest]
    for name, expected, of_grid in zip(check.names, check.expected.tolist(), errors, strict=True):
        known = f"expected ± {100 * WIDE * expected:.2g} % (95 %)" if np.isfinite(expected) else "not identifiable"
        print(f"{name:<{width}}  {known}{of_grid}")
    values = ", ".join(f"{s:.3g}" for s in check.singular_values)
    print(f"singular values of the scaled Jacobian: {values}")
    for direction in check.directions:
        print(f"{'not identifiable' if direction.lost else 'weak'}: {direction.text}")


def _print_fit(found: Fitted) -> None:
    width = max(len(one.name) for one in found.numbers)
    for one in found.numbers:
        unit = f" {one.unit}" if one.unit else ""
        wider = ", wider than the linear estimate" if one.widened else ""
        wider += f", grid error {one.u_num:.2g} included" if one.u_num else ""
        wider += f", input error {one.u_input:.2g} included" if one.u_input else ""
        verdict = "" if one.doubt is None else f"; {one.verdict}"
        ends = f"95 %: {one.low:.6g} … {one.high:.6g}{wider}{verdict}" if np.isfinite(one.half) else "not identifiable"
        print(f"{one.name:<{width}}  {one.value:.6g}{unit}  ({ends}), before {one.start:.6g}")
    for column in found.columns:
        off = f"RMS residual {column.off(column.before):.3g} → {column.off(column.after):.3g} {column.unit}"
        if column.linear is not None:
            off += f", free linear model {column.off(column.linear):.3g} {column.unit}"
        left = f", {column.unexplained:.2g} % of the signal unexplained" if np.isfinite(column.unexplained) else ""
        left += f", noise {column.floor:.3g} {column.unit} {column.floor_from}" if column.floor is not None else ""
        print(f"{column.source}, {column.name} ({column.use}): {off}{left}")
    print_lines("warning", found.warnings)
    if not found.better:
        print_lines("warning", [Diagnostic("the fitted scene has larger residuals than the initial one", "fit-worse")])


def run_comparison(options: argparse.Namespace) -> int:
    """Fit every problem, print and write the comparison; exit with 1 if the preferred model does not pass."""
    for key in ("check", "propose", "profile", "predict"):
        if getattr(options, key):
            raise ArgumentError(f"--{key}: has no effect with several problems or --folds", id="no-effect")
    problems = [_problem(path, options) for path in options.problem]
    short, bar = [path.stem for path in options.problem], Progress("fit")
    names = short if len(set(short)) == len(short) else [str(path) for path in options.problem]
    try:
        if len(problems) > 1:
            found = compare_fits(problems, names, by_folds=options.folds, grid=options.grid, progress=bar.report)
        else:
            with prefix_errors(options.problem[0]):
                one = fit(problems[0], starts=options.starts, grid=options.grid, progress=bar.report)
                found = FitComparison(tuple(names), (one,), (folds(problems[0], progress=bar.report),))
    finally:
        bar.clear()
    if options.out is not None:
        make_folder(options.out)
        for table in found.tables:
            write_text(options.out / f"{table.name}.csv", table.csv)
    options.document = found.document()
    for table in found.tables:
        print(f"{table.title}:", *_lines(table), "", sep="\n")
    for text in found.findings:
        print(text)
    for name, one in zip(found.names, found.fits, strict=True):
        print_lines("warning", [Diagnostic(f"{name}: {warning}", warning.id) for warning in one.warnings])
    return 0 if found.fits[found.names.index(found.preferred)].passed else 1


def _problem(path: Path, options: argparse.Namespace) -> FitProblem:
    problem = FitProblem.load(path)
    return replace(problem, scene=varied(path, problem.scene, options.set))


def _predict(found: Fitted, options: argparse.Namespace) -> None:
    """Print what the fitted scene predicts, with intervals, and whether these contain the readings to check it."""
    names, readings, expected = predictions(found)
    options.document |= {"predictions": expected.document(names)}
    print(*expected.lines(names), sep="\n")
    for k, (y, σ) in enumerate(readings, 1):
        median, low, high = (float(column[k]) for column in (expected.median, expected.low, expected.high))
        below, above = (math.hypot(end - median, WIDE * σ) for end in (low, high))  # the readings are also uncertain
        inside = "inside" if median - below <= y <= median + above else "OUTSIDE"
        print(f"{names[k]}: measured {y:.4g}, median {100 * (median / y - 1):+.2g} % off, {inside} the interval")


def _lines(table: Table) -> list[str]:
    """A table as aligned text."""
    texts = ([c if isinstance(c, str) else "" if c is None else f"{c:.5g}" for c in line] for line in table.lines)
    rows = [table.heads, *texts]
    width = [max(len(row[k]) for row in rows) for k in range(len(table.heads))]
    return ["  ".join(f"{cell:<{w}}" for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]
