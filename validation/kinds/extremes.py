"""Right at extremes, or said not to be: scene × varied keys × method × tolerance → outcome, none silently wrong."""

from __future__ import annotations

import collections
import functools
import itertools
from collections.abc import Iterable, Iterator
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.analysis.extremes import fastest_frequency
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.motion.start import initial_state
from validation.benchmarks.outcomes import OUTCOMES, Found, Outcome, outcome_of, truth_of
from validation.benchmarks.trade import Varied, varied_scene
from validation.case import Case, Measured
from validation.facts import Fact, Facts, said
from validation.store import Series, table

LONG = True

HowTo = tuple[str, str, float]
"""Method, key of `Run` and its value."""

OF_A_TRUTH = 3.0
"""Budgets that a reference may take: it is found once for many runs."""

LABELS = "cell", "situation", "varied", "method", "steps", "outcome", "error / tolerance", "said"
JUDGED: tuple[Outcome, ...] = ("within", "near", "warned", "false doubt", "silent wrong")


class Axis(Spec, frozen=True):
    """One key, or a few that go together, and their values.

    Attributes
    ----------
    values
        Each times what stands at a path of `paths`, a number or a list, is the value there.
    paths
        As `Scene.varied` takes them.
    given
        Changes made before: what the key is a part of.
    unit
        "fastest mode": values are damping ratios of the fastest mode, and become loss times η = 2 ζ / ω.
    """

    values: tuple[float, ...]
    paths: dict[str, Any]
    given: dict[str, Any] = msgspec.field(default_factory=dict)
    unit: Literal["one", "fastest mode"] = "one"

    def at(self, scene: Scene, value: float) -> Scene:
        """The scene with one of the values."""
        if self.given:
            scene = scene.varied(self.given)
        if self.unit == "fastest mode":
            chain = lump(scene)
            value *= 2.0 / fastest_frequency(chain, initial_state(scene, chain)[0])
        return scene.varied({path: np.multiply(value, weight).tolist() for path, weight in self.paths.items()})


class Steps(Spec, frozen=True):
    """How runs advance: every method with every tolerance, a part of the reach, or with every fixed step [s]."""

    methods: tuple[str, ...]
    tolerances: tuple[Positive, ...] = ()
    steps: tuple[Positive, ...] = ()

    def runs(self) -> Iterator[HowTo]:
        """All combinations."""
        for key, values in (("relative_tolerance", self.tolerances), ("step", self.steps)):
            yield from ((method, key, value) for method in self.methods for value in values)


class Plan(Spec, frozen=True):
    """Scenes, one or two axes whose values are combined, and names of `Settings.steps`."""

    scenes: tuple[str, ...]
    axes: tuple[str, ...]
    steps: tuple[str, ...]


class Settings(Spec, frozen=True):
    """What is combined with what; `budget` is the longest run [s of CPU], beyond which it is not judged."""

    budget: Positive
    scene: dict[str, Varied]
    axis: dict[str, Axis]
    steps: dict[str, Steps]
    plan: tuple[Plan, ...]
    change: dict[str, Any] = msgspec.field(default_factory=dict)  # of all scenes, such as their duration


class Cell(NamedTuple):
    """One run: where it stands, and what became of it."""

    scene: str
    axes: dict[str, float]
    method: str
    key: str
    value: float
    found: Found

    @property
    def how(self) -> str:
        """Step or tolerance, in words."""
        return said({self.key: self.value})


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Counts of the outcomes in all and by what was varied, and the cells themselves."""
    found = list(cells(settings))
    for (head, value), members in _groups(found).items():
        counts = collections.Counter(cell.found.outcome for cell in members)
        facts: Facts = {head: value} if head else {}
        for outcome in OUTCOMES:
            note = _worst(members) if outcome == "silent wrong" else ""
            yield Measured(outcome, counts[outcome], varied=facts, note=note)
        if not head:
            judged = sum(counts[each] for each in JUDGED)
            yield Measured("judged", judged)
            yield Measured("share of false doubts", counts["false doubt"] / max(judged, 1))
    yield _series(found)


def cells(settings: Settings) -> Iterator[Cell]:
    """Run by run, in the order of the plans."""
    for plan in settings.plan:
        axes = [settings.axis[name] for name in plan.axes]
        for name in plan.scenes:
            for values in itertools.product(*(axis.values for axis in axes)):
                runs = itertools.chain(*(settings.steps[steps].runs() for steps in plan.steps))
                told = dict(zip(plan.axes, values, strict=True))
                for run, found in _outcomes(settings, name, axes, values, runs):
                    yield Cell(name, told, *run, found)


def _outcomes(
    settings: Settings, name: str, axes: list[Axis], values: tuple[float, ...], runs: Iterable[HowTo]
) -> Iterator[tuple[HowTo, Found]]:
    """What becomes of all runs of a scene, for which its truth is found once."""
    try:
        scene = varied_scene(settings.scene[name], name).varied(settings.change)
        for axis, value in zip(axes, values, strict=True):
            scene = axis.at(scene, value)
    except FlexlinkError as error:
        yield from ((run, Found("error", np.nan, str(error), 0.0)) for run in runs)
        return
    truth = functools.cache(functools.partial(truth_of, scene, OF_A_TRUTH * settings.budget))
    for run in runs:
        method, key, value = run
        yield run, outcome_of(scene.varied({"run.method": method, f"run.{key}": value}), truth, settings.budget)


def _groups(found: list[Cell]) -> dict[tuple[str, Fact], list[Cell]]:
    """Cells by what they have in common: all, one scene, one method, one step or tolerance, one value of an axis."""
    groups: dict[tuple[str, Fact], list[Cell]] = collections.defaultdict(list)
    for cell in found:
        groups["", ""].append(cell)
        facts: Facts = {"situation": cell.scene, "method": cell.method, cell.key: cell.value, **cell.axes}
        for head, value in facts.items():
            groups[head, value].append(cell)
    return groups


def _worst(members: list[Cell]) -> str:
    wrong = [cell for cell in members if cell.found.outcome == "silent wrong"]
    if not wrong:
        return ""
    cell = max(wrong, key=lambda cell: cell.found.error)
    return f"worst: {cell.scene}, {said(cell.axes)}, {cell.method}, {cell.how}: {cell.found.error:.3g} tolerances"


def _series(found: list[Cell]) -> Series:
    rows = [
        (number, cell.scene, said(cell.axes), cell.method, cell.how, *cell.found[:3])
        for number, cell in enumerate(found)
    ]
    columns, (x, *_, y, _) = table(LABELS, rows), LABELS
    return Series("outcomes", "What became of every run", columns, x, x, y, "linear", "log", group="outcome")
