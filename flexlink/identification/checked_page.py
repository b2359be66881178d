"""Chapters that the pages of fits and of checks share: identifiability, the problem, and how to reproduce the page."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from flexlink.common.output import begin_page, write_text
from flexlink.common.types import Array
from flexlink.common.wording import plural, truncated
from flexlink.describe.scene import Scene
from flexlink.describe.writing import toml_of, without_defaults
from flexlink.identification.fitted import building
from flexlink.identification.identifiability import WIDE, Check
from flexlink.identification.problem import FitProblem
from flexlink.identification.proposals import Proposals
from flexlink.pages.chapter import Chapter
from flexlink.pages.page import write_page
from flexlink.pages.part import Part, written
from flexlink.pages.tables import Table, columns_csv
from flexlink.pages.verdict import Report, Verdict

START, PROBLEM = "start.toml", "problem.toml"
"""Files next to the page: the scene before the fit, and the problem, which refers to this scene."""


def build_check(
    problem: FitProblem, check: Check, folder: Path, command: str, proposals: Proposals | None = None
) -> Report:
    """Write the page and the files of a check, or of a fit that the check refused; with `proposals` of experiments.

    The page shows the data first: columns beside their prediction at the initial guess, residuals, and spectra.

    Raises
    ------
    FlexlinkError
        The folder or a file in it cannot be written.
    """
    begin_page(folder)
    write_text(folder / "check.json", json.dumps(document(check), indent=1, ensure_ascii=False) + "\n")
    parts = {
        **building("data_page").chapters_of_data(problem),
        "identifiability": ("Identifiability", "Identifiability", identifiability(check)),
        **measure_next(proposals),
        "problem": (
            "Problem",
            "Problem",
            problem_part(problem, (*priors_in_words(problem), *differences_of_runs(problem))),
        ),
        "reproduce": ("How to reproduce this page", "Reproduce", reproduction(problem.scene, START, command)),
    }
    chapters = [written(Chapter(name, title, short), part, folder, {}) for name, (title, short, part) in parts.items()]
    identifiable = f"{plural(len(check.names), 'parameter')} identifiable at the initial guess. Nothing was fitted."
    refused = f"Nothing was fitted: {'; also '.join(one.text for one in check.lost)}."
    verdict = Verdict(
        "Identifiability", "pass" if check.passed else "fail", "identifiable" if check.passed else "refused",
        identifiable if check.passed else refused,
    )  # fmt: skip
    return Report(write_page(folder, problem.scene.name, "fit", chapters, [verdict], [], {}), (verdict,), chapters)


def document(check: Check) -> dict[str, object]:
    """The check as plain numbers and texts; None replaces non-finite numbers."""
    return {
        "passed": check.passed,
        "expected": {
            name: float(WIDE * part) if np.isfinite(part) else None
            for name, part in zip(check.names, check.expected, strict=True)
        },
        "grid_errors": dict(zip(check.names, check.grid.tolist(), strict=False)),
        "singular_values": check.singular_values.tolist(),
        "directions": [{"id": one.text.id, "text": one.text, "lost": one.lost} for one in check.directions],
        "notes": [{"id": note.id, "text": note} for note in check.notes],
    }


def identifiability(check: Check) -> Part:
    """Result of an identifiability check."""
    heads = ("parameter", "± of 95 % [% of value or unit]", "grid error [% of value or unit]")
    lines = tuple(
        (name, 100 * WIDE * float(part) if np.isfinite(part) else None, None if u is None else 100 * float(u))
        for name, part, u in itertools.zip_longest(check.names, check.expected, check.grid)
    )
    sentences = tuple(f"{one.text}." for one in check.directions)
    sentences = sentences or ("Every parameter, and every combination of parameters, is identifiable.",)
    values = tuple((k, float(s)) for k, s in enumerate(check.singular_values, 1))
    return Part((*sentences, *(f"{note}." for note in check.notes)), tables=(
        Table("expected", "Expected 95 % intervals, linear estimate with white noise", heads, lines),
        Table("singular_values", "Singular values of the Jacobian over the noise", ("number", "value"), values,
              to_look_up=True),
    ))  # fmt: skip


def measure_next(proposals: Proposals | None) -> dict[str, tuple[str, str, Part]]:
    """Chapter with proposals of experiments, if there are any."""
    return {} if proposals is None else {"next": ("What to measure next", "Next", proposals.part())}


def problem_part(problem: FitProblem, sentences: Sequence[str] = ()) -> Part:
    """The problem, its scene and its runs, as files."""
    files = {START: problem.scene.to_toml()}
    runs = []
    for k, run in enumerate(problem.run, 1):
        name = f"run_{k}.csv"
        if run.columns:
            files[name] = columns_csv({head: np.array(column) for head, column in run.columns.items()})
        runs.append(replace(run, columns={}, file=run.file or name))
    written_problem = without_defaults(replace(problem, run=tuple(runs))) | {"scene": START}
    text = toml_of({"scene": START, **written_problem})
    about = (f"{problem.about.rstrip('.')}.",) if problem.about else ()
    return Part((*about, *sentences), literal=text, literal_title="Problem file", files={PROBLEM: text, **files})


def priors_in_words(problem: FitProblem) -> tuple[str, ...]:
    """One sentence for each prior."""
    return tuple(
        f"Prior: {one.path} is {one.prior[0]:.6g} ± {one.prior[1]:.2g} (standard deviation)."
        for one in problem.parameter if one.prior
    )  # fmt: skip


def differences_of_runs(problem: FitProblem) -> tuple[str, ...]:
    """One sentence for each run that differs from the scene."""
    return tuple(
        f"Differences of {run.name} from the scene: "
        f"{', '.join(f'{path} = {truncated(value)}' for path, value in run.set.items())}."
        for run in problem.run if run.set
    )  # fmt: skip


def reproduction(scene: Scene, name: str, command: str) -> Part:
    """Part of the page that shows the command and the scene."""
    sentences = (f"Made by: {command}",) if command else ()
    again = f"To repeat it with the files next to this page: flexlink fit {PROBLEM}"
    return Part((*sentences, again), literal=scene.to_toml(), files={name: scene.to_toml()})


def padded(columns: dict[str, Array]) -> str:
    """CSV of columns of different lengths; missing values are nan."""
    longest = max(len(column) for column in columns.values())
    return columns_csv({
        name: np.pad(column.astype(float), (0, longest - len(column)), constant_values=np.nan)
        for name, column in columns.items()
    })  # fmt: skip
