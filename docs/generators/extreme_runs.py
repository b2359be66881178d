"""Runs at extreme parameters in the stored study: what was varied, and how every run ended."""

from __future__ import annotations

import csv
import functools
import gzip
import io
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from docs.generators.study import FULL
from flexlink.pages.colours import BLUE, GREEN, GREY, ORANGE, PALE, SKY, VERMILION
from validation.facts import WORDS

NATIVE = "native"
REFUSALS = Path(__file__).with_name("extremes.toml")
WRONG, RIGHT, WARNED = "wrong without a warning", "right", "warned"
NOT_FINITE, REFUSED = "not finite", "refused"
LOOKS = {
    RIGHT: GREEN,
    "up to ten times": SKY,
    WARNED: BLUE,
    REFUSED: GREY,
    NOT_FINITE: ORANGE,
    "not judged": PALE,
    WRONG: VERMILION,
}
"""Ends of a run in the order of the figure, with their colours."""
ENDS = {
    "within": RIGHT, "near": "up to ten times", "warned": WARNED, "false doubt": WARNED, "error": REFUSED,
    "dear": "not judged", "unknown": "not judged", "silent wrong": WRONG,
}  # fmt: skip
"""Outcome in the stored study → end of the run on the page."""
STEPS = {
    head: re.sub(r"\{.*?\}", r"(\\S+)", text)
    for head, text in (WORDS[name] for name in ("of_limit", "step", "relative_tolerance"))
}
"""Parameter → pattern of its value in the words for a step or tolerance."""
SINGULAR = 1e16  # cond(M) above which the rounded M may be singular, as in the case extremes_digits


class Run(NamedTuple):
    """A run: its case and command, program and method, its end, the values of its extreme parameters, its message."""

    case: str
    recipe: str
    engine: str
    method: str
    end: str
    values: dict[str, float]
    message: str


class Digits(NamedTuple):
    """Errors of q̈ by engine in one cell, relative to the largest element; refused cells have none."""

    case: str
    recipe: str
    values: dict[str, float]
    condition: float
    errors: dict[str, float]


@functools.cache
def runs(folder: Path = FULL) -> tuple[Run, ...]:
    """Every run of every stored map of extremes, once; the cases with several programs come first."""
    found = [_run(case, row) for case, row in _rows(folder, "extremes*.outcomes")]
    several = {run.case for run in found if run.engine != NATIVE}
    return tuple(sorted(found, key=lambda run: run.case not in several))


@functools.cache
def digits(folder: Path = FULL) -> tuple[Digits, ...]:
    """Every stored cell in which the digits of q̈ were counted."""
    return tuple(
        Digits(
            case, row["recipe"], values_of(row["axes"], row["varied"]), float(row["cond(M)"]),
            {key.removesuffix(" q̈"): float(text) for key, text in row.items() if key.endswith(" q̈") and text != "nan"},
        )
        for case, row in _rows(folder, "extremes*.map")
    )  # fmt: skip


def most_steps(folder: Path = FULL) -> float | None:
    """Number of steps of the longest run in the stored study."""
    return max((float(row["steps [1]"]) for _, row in _rows(folder, "long_runs*.long_run")), default=None)


def values_of(axes: str, varied: str, steps: str = "") -> dict[str, float]:
    """Parameters of a run with their values, from their names and the words of the stored study.

    >>> values_of("density, times and load [N]", "density, times 1e-15, load [N] 3.0", "h = 0.1 s")
    {'density, times': 1e-15, 'load [N]': 3.0, 'step [s]': 0.1}
    """
    found = {name: re.search(rf"(?:^|, ){re.escape(name)} ([^,\s]+)", varied) for name in axes.split(" and ") if name}
    found |= {name: re.fullmatch(pattern, steps) for name, pattern in STEPS.items()}
    return {_without_variant(name): float(text[1]) for name, text in found.items() if text}


def counts(of: Iterable[Run]) -> Counter[str]:
    """Number of runs with each end."""
    return Counter(run.end for run in of)


def message_id(message: str) -> str:
    """Id of the message of a refused run; "" if its text is not known."""
    return next((name for name, pattern in _refusals().items() if re.search(pattern, message)), "")


@functools.cache
def _refusals() -> dict[str, str]:
    return tomllib.loads(REFUSALS.read_text(encoding="utf-8"))


def _run(case: str, row: dict[str, str]) -> Run:
    end = ENDS.get(row["outcome"], row["outcome"])
    if end == REFUSED and row["engine"] != NATIVE and "no longer finite" in row["said"]:
        end = NOT_FINITE
    values = values_of(row["axes"], row["varied"], row["steps"])
    return Run(case, row["recipe"], row["engine"], row["method"], end, values, row["said"])


def _without_variant(name: str) -> str:
    """Name of a parameter without the part of the map that has other values: "segments a link, in a plane"."""
    plain, comma, rest = name.partition(", ")
    return name if not comma or rest == "times" or rest.startswith("of the") else plain


def _rows(folder: Path, series: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Case and row of the stored series that match a pattern."""
    for path in sorted(folder.glob(f"{series}.csv*")):
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
        yield from ((path.name.partition(".")[0], row) for row in csv.DictReader(io.StringIO(text, newline="")))
