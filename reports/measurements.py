"""Validation: the model compared with measurements, one line per group of quantities, for the first screen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from reports.wording import from_to
from validation.measured.uncertainty import VERDICTS
from validation.store import Series

WHAT = "measured"  # `what` of the series of measured cases
HEADS = (
    "measured", "quantities", "error E / D, nothing fitted", "agree, nothing fitted", "error E / D, held out",
    "agree, held out", "accuracy shown, ±", "undecided",
)  # fmt: skip
WORDS = (
    "E = S − D is the error of the simulation S against the measurement D. Its validation uncertainty is u_val, "
    "where u_val² = u_num² + u_input² + u_D²: u_num is the uncertainty of the discretization (grid convergence "
    "index), u_input that of the specimen, by its tolerances, and u_D that of the measurement. A quantity agrees if "
    "|E| ≤ 2 u_val; this shows an accuracy of ± 2 u_val, however small E is. If |E| > 2 u_val, the error of the "
    "model or of the specimen data exceeds the uncertainty. If 2 u_val is larger than the required accuracy, "
    "agreement decides nothing: the quantity counts as undecided. For “held out”, one number of the specimen was "
    "chosen and fitted to one half of the readings, and the model with this number predicts the other half; every "
    "reading is held out once. For the laboratory arm ten numbers are fitted, and u_input is the scatter of four "
    "such fits."
)


LARGE = (
    10.0  # root mean square of E / D [%], the most that a case wants; above, a group that disagrees is not predicted
)


class Line(NamedTuple):
    """How quantities agree, nothing fitted or held out: errors E / D [%] and accuracy 2 u_val / |D| [%] of each.

    Quantities that cannot be decided are left out.
    """

    error: Array
    accuracy: Array
    agrees: NDArray[np.bool_]

    @property
    def rms(self) -> float:
        """Root mean square of the errors [%]."""
        return math.sqrt(float(np.mean(self.error**2)))

    @property
    def counts(self) -> str:
        """How many agree of how many."""
        return f"{self.agrees.sum()} of {len(self.agrees)}"

    @property
    def most_agree(self) -> bool:
        """Whether most of the quantities agree."""
        return bool(2 * self.agrees.sum() > len(self.agrees))


class Group(NamedTuple):
    """Quantities of a case that share a line of the table."""

    case: str
    title: str
    name: str
    columns: dict[str, NDArray[Any]]

    @property
    def error(self) -> Array:
        """E / D [%]."""
        found: Array = 100 * self.columns["E"] / self.columns["D"]
        return found

    @property
    def u_val(self) -> Array:
        """u_val / |D| [%]."""
        found: Array = 100 * self.columns["u_val"] / np.abs(self.columns["D"])
        return found

    @property
    def free(self) -> Line:
        """Quantities with nothing fitted; none if the inputs of the scene were fitted."""
        fitted = np.array_equal(self.columns["held out S"], self.columns["S"])
        verdicts = self.columns["verdict"]
        return _decided(self.error, 2 * self.u_val, np.full_like(verdicts, "") if fitted else verdicts)

    @property
    def held_out(self) -> Line:
        """Quantities predicted by a number that was fitted to others."""
        D, S, u = (self.columns[name] for name in ("D", "held out S", "held out u_val"))
        return _decided(100 * (S - D) / D, 200 * u / np.abs(D), self.columns["held out verdict"])

    @property
    def last(self) -> Line:
        """Quantities held out, or with nothing fitted if none were."""
        return self.held_out if len(self.held_out.error) else self.free

    @property
    def predicted(self) -> bool:
        """Whether most quantities agree, with a number fitted if there is one, or errors are small."""
        return not len(self.last.error) or self.last.most_agree or self.last.rms <= LARGE

    @property
    def undecided(self) -> int:
        """Number of quantities that neither way can decide."""
        none = np.isin(self.columns["verdict"], ("", VERDICTS[2]))
        return int((none & np.isin(self.columns["held out verdict"], ("", VERDICTS[2]))).sum())


def _decided(error: Array, accuracy: Array, verdicts: NDArray[np.str_]) -> Line:
    decided = np.isin(verdicts, VERDICTS[:2])
    return Line(error[decided], accuracy[decided], verdicts[decided] == VERDICTS[0])


class Lines(NamedTuple):
    """Quantities compared with nothing fitted, the same held out, and how many cannot be decided in either way."""

    free: Line
    held_out: Line
    undecided: int

    @property
    def all_agree(self) -> bool:
        """Whether all decided quantities agree with nothing fitted."""
        return bool(self.free.agrees.all()) and not self.undecided

    @property
    def brief(self) -> str:
        """The counts in a few words."""
        parts = [(self.free, "nothing"), (self.held_out, "one number")]
        agreeing = (f"{of.counts} quantities agree with {what} fitted" for of, what in parts if len(of.agrees))
        return ", ".join(agreeing) or "nothing decided"


def lines_of(groups: Iterable[Group]) -> Lines:
    """The lines of some groups together."""
    every = list(groups)
    return Lines(
        _joined(group.free for group in every),
        _joined(group.held_out for group in every),
        sum(group.undecided for group in every),
    )


def _joined(lines: Iterable[Line]) -> Line:
    every = list(lines)
    return Line(*(np.concatenate(part) for part in zip(*every, strict=True)))


def by_case(results: Results) -> dict[str, Lines]:
    """Lines by case."""
    found: dict[str, list[Group]] = {}
    for group in groups(results):
        found.setdefault(group.case, []).append(group)
    return {case: lines_of(of) for case, of in found.items()}


def expectation(every: Sequence[Group]) -> str:
    """What to expect of the prediction of a real arm, each number from the measured cases."""
    predicted = [group for group in every if group.predicted]
    specimens = [
        lines_of(one for one in predicted if one.case == case)
        for case in dict.fromkeys(each.case for each in predicted)
    ]
    free, held_out = (
        [of for lines in specimens if len((of := getattr(lines, name)).error)] for name in Lines._fields[:2]
    )
    whole = lines_of(predicted)
    not_predicted = ", ".join(
        f"{each.name} (error {number(each.last.rms, 2)} %, {each.last.counts} agree)"
        for each in every
        if not each.predicted
    )
    return (
        f"If you model an arm from its drawing, expect root-mean-square errors of {_rms_span(free)}, depending on the "
        f"specimen, and single errors of up to {_largest(free)}. With nothing fitted, {whole.free.counts} measured "
        "quantities agree with the simulation within their uncertainty. If you also fit one number of the arm to a few "
        f"readings, expect root-mean-square errors of {_rms_span(held_out)} and single errors of up to "
        f"{_largest(held_out)}. Then {whole.held_out.counts} quantities that were not used for the fit agree, which "
        f"shows an accuracy of ± {_shown(held_out)}. These counts leave out quantities that are too uncertain to "
        f"decide ({lines_of(every).undecided}), and what the model does not predict: {not_predicted or 'nothing'}."
    )


def _rms_span(lines: Sequence[Line]) -> str:
    return span(np.array([line.rms for line in lines]))


def _largest(lines: Sequence[Line]) -> str:
    return f"{number(max(float(np.abs(line.error).max()) for line in lines), 2)} %"


def _shown(lines: Sequence[Line]) -> str:
    return span(np.array([float(np.median(line.accuracy[line.agrees])) for line in lines if line.agrees.any()]))


def groups(results: Results) -> Iterator[Group]:
    """All groups of the study."""
    for case, series in results.showing(WHAT):
        yield from groups_of(case, results.cases[case][0].title, series)


def groups_of(case: str, title: str, series: Series) -> Iterator[Group]:
    """The groups of a case, in order."""
    of = series.columns["group"]
    for name in dict.fromkeys(of.tolist()):
        yield Group(case, title.partition(":")[0], name, {key: c[of == name] for key, c in series.columns.items()})


def table(groups: Iterable[Group]) -> Table | None:
    """One line per group; None if there is none."""
    lines = tuple(map(_line, groups))
    return Table("measurements", "Validation: comparison with measurements", HEADS, lines, (WORDS,)) if lines else None


def _line(group: Group) -> tuple[str | float, ...]:
    of = group.free, group.held_out
    errors = [span(each.error) if len(each.error) else "" for each in of]
    counts = [each.counts if len(each.error) else "" for each in of]
    last = group.last
    shown = span(last.accuracy[last.agrees]) if last.agrees.any() else ""
    name = f"{group.title}: {group.name}"
    return (
        name,
        float(len(group.columns["E"])),
        errors[0],
        counts[0],
        errors[1],
        counts[1],
        shown,
        float(group.undecided),
    )


def span(percent: Array) -> str:
    """Range of percentages, "smallest to largest"."""
    low, high = (f"{number(float(each), 2)} %" for each in (percent.min(), percent.max()))
    return from_to(low, high)
