"""`flexlink fit`: Find numbers of a scene from measurements, and say how well the data hold them.

flexlink fit problem.toml --check
flexlink fit problem.toml --out fitted
flexlink fit problem.toml --starts 5 --profile --set material.steel.young=2e11
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from flexlink.cli.shared import prefix_errors, print_hints, print_lines, varied
from flexlink.common.errors import IdentifiabilityError
from flexlink.common.output import make_folder, or_keep
from flexlink.identification.fit import check_fit, fit
from flexlink.identification.fitted import Fitted, building
from flexlink.identification.identifiability import WIDE, Check
from flexlink.identification.loading import load_fit
from flexlink.identification.problem import FitProblem


def add_options(command: argparse.ArgumentParser) -> None:
    """Options of `fit`."""
    command.add_argument("problem", type=Path, help="problem file (.toml)")
    command.add_argument(
        "--check", action="store_true", help="only say what the data can tell: nothing is fitted; 1 if they cannot"
    )
    command.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="folder for a page, fitted.toml, fit.json, tables; of a check, too",
    )
    command.add_argument("--starts", type=int, default=1, metavar="N", help="number of starts; default: 1")
    command.add_argument(
        "--profile", action="store_true", help="also find each interval with all other numbers fitted anew"
    )


def run_command(options: argparse.Namespace) -> int:
    """Check, fit, and write; 1 where the data do not hold a number, or the fit is worse than the scene before."""
    problem = load_fit(options.problem)
    problem = replace(problem, scene=varied(options.problem, problem.scene, options.set))
    print_hints(problem.scene, options)
    if options.out is not None:
        building()  # what is missing is said before the work
        make_folder(options.out)
    with prefix_errors(options.problem):
        found: Check | Fitted
        if options.check:
            found = check_fit(problem)
        else:
            try:
                found = fit(problem, starts=options.starts, profile=options.profile, progress=_tell)
            except IdentifiabilityError as error:
                assert isinstance(error.check, Check)
                found = error.check
        return _told(found, problem, options.out)


def _told(found: Check | Fitted, problem: FitProblem, out: Path | None) -> int:
    """Print what was found, and write its page."""
    command = shlex.join(["flexlink", *sys.argv[1:]])
    if isinstance(found, Fitted):
        _print_fit(found)
        page = None if out is None else or_keep(out, lambda folder: found.report(folder, command=command))
    else:
        _print_check(found)
        page = None if out is None else building("checked_page").build_check(problem, found, out, command)
    if page is not None:
        print(f"page: {page.page}")
    return 0 if found.passed else 1


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _print_check(check: Check) -> None:
    """What the data can tell."""
    for note in check.notes:
        print(note)
    width = max(map(len, check.names))
    for name, expected in zip(check.names, check.expected.tolist(), strict=True):
        known = f"expected ± {100 * WIDE * expected:.2g} % (95 %)" if np.isfinite(expected) else "not identifiable"
        print(f"{name:<{width}}  {known}")
    values = ", ".join(f"{s:.3g}" for s in check.singular_values)
    print(f"singular values of the slopes over the noise: {values}")
    for direction in check.directions:
        print(f"{'refused' if direction.lost else 'weak'}: {direction.text}")


def _print_fit(found: Fitted) -> None:
    width = max(len(one.name) for one in found.numbers)
    for one in found.numbers:
        unit = f" {one.unit}" if one.unit else ""
        wider = ", wider than the linear estimate" if one.widened else ""
        verdict = "" if one.doubt is None else f"; {one.verdict}"
        ends = f"95 %: {one.low:.6g} … {one.high:.6g}{wider}{verdict}" if np.isfinite(one.half) else "not identifiable"
        print(f"{one.name:<{width}}  {one.value:.6g}{unit}  ({ends}), before {one.start:.6g}")
    for column in found.columns:
        off = f"RMS residual {column.off(column.before):.3g} → {column.off(column.after):.3g} {column.unit}"
        if column.linear is not None:
            off += f", free linear model {column.off(column.linear):.3g} {column.unit}"
        print(f"{column.source}, {column.name} ({column.use}): {off}")
    print_lines("warning", found.warnings)
    if not found.better:
        print_lines("warning", ["the fitted scene is further from the data than the one before"])
