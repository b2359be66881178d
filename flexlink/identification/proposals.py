"""Ranked experiments: text, TOML for the problem file, JSON, and a chapter of a page."""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from msgspec.structs import replace

from flexlink.common.errors import Diagnostic
from flexlink.common.wording import plural
from flexlink.describe.writing import toml_of, without_defaults
from flexlink.identification.candidates import Addition, Candidate
from flexlink.identification.identifiability import WIDE, Check, Direction
from flexlink.identification.problem import FitModes, FitParameter, FitRun
from flexlink.pages.page import Part
from flexlink.pages.tables import Cell, Table


class Change(NamedTuple):
    """Expected standard deviation of a parameter before and after an experiment.

    Attributes
    ----------
    name, unit
        The parameter, and the unit of its value.
    log
        Whether its logarithm is estimated; intervals are then given in percent.
    size
        Change of the value per unit of the deviations.
    before, after
        Standard deviations of its coordinate; inf if it is not identifiable.
    """

    name: str
    unit: str
    log: bool
    size: float
    before: float
    after: float

    def half(self, σ: float) -> str:
        """Half-width of the 95 % interval in words."""
        if not math.isfinite(σ):
            return "not identifiable"
        return f"± {100 * WIDE * σ:.2g} %" if self.log else f"± {WIDE * σ * self.size:.2g} {self.unit}".rstrip()

    def bound(self, σ: float) -> float | None:
        """Half-width of the 95 % interval: a fraction of the value, or in its unit."""
        return WIDE * σ * (1.0 if self.log else self.size) if math.isfinite(σ) else None

    @property
    def text(self) -> str:
        """The change in words."""
        return f"{self.name} {self.half(self.before)} → {self.half(self.after)}"


class Proposal(NamedTuple):
    """One experiment, or a set of experiments, with the intervals that it would give.

    Attributes
    ----------
    candidates
        The experiments.
    changes
        Every parameter, with its expected deviation now and after.
    lost
        Number of combinations that would still not be identifiable.
    """

    candidates: tuple[Candidate, ...]
    changes: tuple[Change, ...]
    lost: int

    @property
    def additions(self) -> tuple[Addition, ...]:
        """Runs, modes, static deflections and parameters with priors to add to the problem, with predicted data."""
        return tuple(one.addition for one in self.candidates)

    @property
    def title(self) -> str:
        """What to measure."""
        return "; and ".join(one.title for one in self.candidates)

    @property
    def text(self) -> str:
        """What to measure, and the change of the widest interval; then the interval that is the widest afterwards."""
        first = max(self.changes, key=lambda one: (one.before, one.after))
        last = max(self.changes, key=lambda one: one.after)
        then = "" if last is first else f"; the widest is then {last.name} {last.half(last.after)}"
        left = f"; {plural(self.lost, 'combination')} still not identifiable" if self.lost else ""
        return f"{self.title}: {first.text}{then}{left}"

    @property
    def toml(self) -> str:
        """Tables for the problem file; values are predictions, to be replaced by measurements."""
        return "\n".join(_toml(one) for one in self.candidates)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Proposals:
    """Experiments, ranked by how much each would narrow the widest 95 % interval of a fit.

    Attributes
    ----------
    check
        Identifiability check of the present data.
    values
        Names and values of the parameters at which all predictions are linear.
    of_fit
        Whether the values and the present intervals are those of a fit, or of the initial guess.
    ranked
        Single experiments, the best first.
    sets
        Sets of two and three experiments, if no single experiment makes every parameter identifiable.
    separating
        For every combination that is not identifiable, the experiment with the largest effect of a change along it.
    skipped
        Experiments that do not apply to this scene, or cannot be simulated, with the reason.
    compared
        Number of compared experiments.
    notes
        Notes on the present intervals.

    Examples
    --------
    >>> sought = fl.fits.FitParameter(path="material.aluminium.young")
    >>> tapped = fl.fits.FitModes(hertz=(5.5,), deviation=(0.2,))
    >>> brief = scene.varied({"run.duration": 0.1})
    >>> found = fl.fits.propose(fl.fits.FitProblem(scene=brief, parameter=(sought,), modes=(tapped,)))
    >>> print(found.check.passed, found.first.lost, "[[" in found.first.toml)
    True 0 True
    """

    check: Check
    values: tuple[tuple[str, float], ...]
    of_fit: bool
    ranked: tuple[Proposal, ...]
    sets: tuple[Proposal, ...]
    separating: tuple[tuple[Direction, Candidate | None], ...]
    skipped: tuple[Diagnostic, ...]
    compared: int
    notes: tuple[Diagnostic, ...] = ()

    def __repr__(self) -> str:
        best = f"; first: {self.first.text}" if self.first is not None else ""
        return f"<Proposals: {plural(self.compared, 'experiment')} compared{best}>"

    @property
    def first(self) -> Proposal | None:
        """The proposal to follow: the best single experiment, or the last set if no single one suffices."""
        if self.sets and (not self.ranked or self.ranked[0].lost):
            return self.sets[-1]
        return self.ranked[0] if self.ranked else None

    @property
    def best(self) -> tuple[Proposal, ...]:
        """The best proposal of each experiment that narrows the widest interval by at least 5 %, best first."""
        found: dict[str, Proposal] = {}
        for one in self.ranked:
            if _helps(one, len(self.check.lost)):
                found.setdefault(one.candidates[0].experiment, one)
        return tuple(found.values())

    @property
    def basis(self) -> str:
        """Where the estimate is linear."""
        at = ", ".join(f"{name} = {value:.4g}" for name, value in self.values)
        return f"linear estimate at {'the solution' if self.of_fit else 'the initial guess'}: {at}"

    def lines(self) -> Iterator[str]:
        """The result as lines of text: ranked experiments, sets, and the tables of the first."""
        most = 10  # largest number of experiments to list
        yield f"What to measure next ({self.basis})"
        yield from self.notes
        for number, one in enumerate(self.best[:most], 1):
            yield f"{number:2}. {one.text}"
        if not self.best:
            yield f"none of {plural(self.compared, 'experiment')} narrows the widest interval by 5 % or more"
        for one in self.sets:
            yield f"together: {one.text}"
        for direction, candidate in self.separating:
            what = candidate.title if candidate is not None else "no compared experiment"
            verb = "separate" if len(direction.names) > 1 else "determine"
            yield f"to {verb} {' and '.join(direction.names)}: {what}"
        left = f"{plural(self.compared, 'experiment')} compared; {len(self.skipped)} left out, which do not apply here"
        yield f"{left} or cannot be simulated (--json lists them)"
        if self.first is not None and (self.best or self.sets):
            yield ""
            yield f"# To add to the problem file for: {self.first.title}"
            yield from self.first.toml.splitlines()

    def document(self) -> dict[str, Any]:
        """The result as plain numbers and texts; None replaces non-finite numbers."""
        return {
            "at": "solution" if self.of_fit else "initial guess",
            "values": dict(self.values),
            "linear": True,
            "notes": [{"id": one.id, "text": str(one)} for one in self.notes],
            "ranked": [_document(one) for one in self.ranked],
            "sets": [_document(one) for one in self.sets],
            "separating": [
                {"names": direction.names, "experiment": None if one is None else one.title}
                for direction, one in self.separating
            ],
            "skipped": [{"id": one.id, "text": str(one)} for one in self.skipped],
            "compared": self.compared,
        }

    def part(self) -> Part:
        """Chapter of a page: a table of the experiments, and the tables for the problem file."""
        listed = (*self.best, *self.sets)
        reasons = ["; ".join(c.reason for c in one.candidates) for one in listed]
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (k, one.title, reason, *(c.half(c.after) for c in one.changes), one.lost)
            for k, (one, reason) in enumerate(zip(listed, reasons, strict=True), 1)
        )
        present = [f"{c.name} {c.half(c.before)}" for one in self.ranked[:1] for c in one.changes]
        left = f"{plural(self.compared, 'experiment')} compared; {len(self.skipped)} left out, which do not apply to "
        left += "this scene or cannot be simulated."
        sentences = (
            f"Expected 95 % intervals after each experiment, {self.basis}.",
            f"Now: {', '.join(present)}.",
            left,
            *(f"Note: {note}." for note in self.notes),
        )
        texts = "\n".join(f"# {one.text}\n{one.toml}" for one in listed)
        heads = ("rank", "experiment", "reason", *(name for name, _ in self.values), "not identifiable")
        return Part(
            sentences, literal=texts, literal_title="Tables for the problem file",
            tables=(Table("proposals", "What to measure next", heads, rows),),
        )  # fmt: skip


def _helps(one: Proposal, lost: int) -> bool:
    least = 0.05  # smallest reduction of the widest interval
    before, after = (max(getattr(change, key) for change in one.changes) for key in ("before", "after"))
    unknown = [sum(math.isinf(getattr(change, key)) for change in one.changes) for key in ("before", "after")]
    return one.lost < lost or unknown[1] < unknown[0] or (one.lost <= lost and after <= (1 - least) * before)


def _document(one: Proposal) -> dict[str, Any]:
    return {
        "text": one.text,
        "experiments": [{"title": c.title, "experiment": c.experiment, "reason": c.reason} for c in one.candidates],
        "intervals": [
            {"name": c.name, "unit": c.unit, "relative": c.log, "before": c.bound(c.before), "after": c.bound(c.after)}
            for c in one.changes
        ],
        "lost": one.lost,
        "toml": one.toml,
    }


def _toml(candidate: Candidate) -> str:
    addition = candidate.addition
    if isinstance(addition, FitParameter):
        text = toml_of({"parameter": [without_defaults(addition)]}).lstrip()
        return f"# Replace this parameter's table; prior: measured value and its standard deviation\n{text}"
    if isinstance(addition, FitRun):
        if candidate.recorded is not None:
            text = toml_of({"run": [without_defaults(candidate.recorded)]}).lstrip()
            return f"# The file already contains this column\n{text}"
        heads, t = ", ".join(addition.columns), addition.columns["t [s]"]
        span = f"{plural(len(t), 'sample')} from {t[0]:.4g} to {t[-1]:.4g} s"
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in addition.name)
        run = replace(addition, columns={}, file=f"{name}.csv")
        text = toml_of({"run": [without_defaults(run)]}).lstrip()
        return f"# {run.file}: record with the columns {heads}, {span}\n{text}"
    key = "modes" if isinstance(addition, FitModes) else "static"
    values = "hertz" if key == "modes" else "value"
    return f"# Replace {values} by the measurement\n{toml_of({key: [without_defaults(addition)]}).lstrip()}"
