"""Error of a model of an arm: what causes it, and what it costs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.wording import plural
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.runs import stable_steps
from validation.store import Series, table
from validation.trade.error_parts import TYPES, Fine, Setup, Split, Splitter, Type
from validation.trade.scenes import seen
from validation.trade.with_flexlink import OF_STABLE, timed_run

COLUMNS = ("type", "rule", "hinges", "method", "setting", "error", "CPU time [s]")
NAMES = {"rigid": "rigid"} | {flex: name for name, flex in TYPES.items()}


class Grid(Spec, frozen=True):
    """Settings of one scene: its changes, the reference, and the grid of runs.

    Attributes
    ----------
    true, fine
        Type of links of the reference, and its converged settings.
    flex, hinges
        Types of the links; numbers of hinges per link for each rule.
    tolerances
        Tolerances of adaptive methods, as fractions of the motion.
    stepped
        Methods that take the largest stable step at the initial state.
    """

    true: Type
    fine: Fine
    flex: tuple[Type, ...]
    hinges: dict[str, tuple[int, ...]]
    tolerances: dict[str, tuple[Positive, ...]]
    stepped: tuple[str, ...] = ()
    change: dict[str, Any] = msgspec.field(default_factory=dict)

    def cuts(self) -> Iterator[Setup]:
        """Yield types, rules and hinges (a rigid arm once), without methods."""
        for flex in self.flex:
            ways = [(rule, k) for rule, counts in self.hinges.items() for k in counts]
            for rule, hinges in [("paper", 0)] if flex == "rigid" else ways:
                yield Setup(flex=flex, rule=rule, hinges=hinges, method="")

    def setups(self, scene: Scene, motion: float) -> Iterator[Setup]:
        """Yield all runs for a scene, with `motion` [m] the travel of its tip."""
        for cut in self.cuts():
            for method, parts in self.tolerances.items():
                yield from (replace(cut, method=method, tolerance=part * motion) for part in parts)
            for method in self.stepped:
                steps = stable_steps(cut.scene(scene), method, OF_STABLE)
                yield replace(cut, method=method, step=scene.run.spacing / steps)


class Run(NamedTuple):
    """A run: its setup, its error relative to the motion, CPU seconds."""

    setup: Setup
    error: float
    seconds: float

    @property
    def in_words(self) -> str:
        """The setup in words."""
        flex, rule, hinges, method, setting, *_ = self.row
        cut = flex if flex == "rigid" else f"{flex}, {plural(hinges, 'hinge')} (rule {rule})"
        return f"{cut}, {method}, {'step' if self.setup.step else 'tolerance'} {setting:.2g}"

    @property
    def row(self) -> tuple[Any, ...]:
        """Values of the table's columns."""
        setup = self.setup
        return NAMES[setup.flex], setup.rule, setup.hinges, setup.method, setup.step or setup.tolerance, *self[1:]


@kind(timed=True)
def speed_models(
    case: Case, scene: dict[str, Grid], errors: tuple[Positive, ...], budget: Positive
) -> Iterator[Measured | Series]:
    """Cost of a model against its total error at the tip: type of the links, rule, hinges, method and steps.

    The error is the distance from the tip of a chain with infinitely many hinges, exact in time, relative to the tip's
    motion; only the time of the steps counts, as in `speed_trade`.

    Yield the reference's error, the cheapest run for each error, and a series of all runs.

    `errors` are fractions of the motion; `budget` is the longest run [s of CPU].
    """
    for name, grid in scene.items():
        base = case.varied_scene(name, grid.change)
        truth = grid.fine.limit(base, grid.true)
        motion = tip_travel(truth.tip)
        yield Measured("own error / smallest error", truth.own / (motion * min(errors)), base.name)
        setups = grid.setups(base, motion)
        made = [run for setup in setups if (run := _made(base, setup, truth.tip, motion, budget))]
        for error in errors:
            met = [run for run in made if run.error <= error]
            if met:
                best = min(met, key=lambda run: run.seconds)
                yield Measured(
                    "CPU time", 1e3 * best.seconds, base.name, varied={"error": error}, note=best.in_words, timed=True
                )
        columns = table(COLUMNS, [run.row for run in made])
        title = f"{base.name}: error and cost of each model"
        x, y = COLUMNS[-2:]
        yield Series("models", title, columns, x, x, y, "log", "log", group="type", scene=base.name)


def _made(scene: Scene, setup: Setup, truth: Any, motion: float, longest: float) -> Run | None:
    """The timed run of a setup; None if it fails or takes longer than `longest` [s of CPU]."""
    changes = {"run.method": setup.method, "run.step": setup.step, "run.tolerance": setup.tolerance}
    cut = setup.scene(scene).varied({key: value for key, value in changes.items() if value is not None})
    try:
        runs = [timed_run(cut, longest) for _ in range(3)]
    except FlexlinkError:
        return None
    tip = seen(lump(cut), runs[0].q).tip
    return Run(setup, largest_distance(tip, truth) / motion, min(each.seconds for each in runs))


PARTS = ("model", "space", "time", "rounding")


class Errors(Spec, frozen=True):
    """Settings of one scene: its changes, the reference, and the runs by name.

    Attributes
    ----------
    true
        Type of links of the reference.
    fine, in_time
        Settings whose result is converged in space and time; settings that integrate a run's own chain exactly in time.
    """

    true: Type
    fine: Fine
    in_time: Fine
    run: dict[str, Setup]
    change: dict[str, Any] = msgspec.field(default_factory=dict)


@kind(long=True)
def errors_split(case: Case, scene: dict[str, Errors]) -> Iterator[Measured | Series]:
    """Contributions to a run's error: type of the links, lumping, time steps, rounding.

    Yield the error of every run, its parts and their uncertainties, and a series per scene.
    """
    for name, errors in scene.items():
        base = case.varied_scene(name, errors.change)
        splitter = Splitter(base, errors.true, errors.fine, errors.in_time)
        splits = {label: splitter.split(setup) for label, setup in errors.run.items()}
        for label, split in splits.items():
            yield from _rows(base, label, split)
        yield _series(base, splits)


def _rows(scene: Scene, label: str, split: Split) -> Iterator[Measured]:
    facts: Facts = {"run": label}
    yield Measured("error", split.total, scene.name, varied=facts)
    yield Measured("reference's own error / error", split.own / split.total, scene.name, varied=facts)
    total = split.rounding + sum(part.size for part in split.parts.values())
    yield Measured("error / sum of parts", split.total / total, scene.name, varied=facts)
    for name, part in split.parts.items():
        yield Measured("part", part.size, scene.name, varied={**facts, "part": name})
        if part.size:
            negligible = 1e-6 * split.total  # smaller parts are irrelevant
            judged = max(part.size, negligible)
            yield Measured("own error / part", part.own / judged, scene.name, varied={**facts, "part": name})
    yield Measured("part", split.rounding, scene.name, varied={**facts, "part": "rounding"})


def _series(scene: Scene, splits: dict[str, Split]) -> Series:
    rows = [
        (label, *(part.size for part in split.parts.values()), split.rounding, split.total)
        for label, split in splits.items()
    ]
    columns = table(("run", *PARTS, "total"), rows)
    title = f"{scene.name}: error of the tip in {scene.run.duration:g} s"
    return Series("errors", title, columns, "run", "run", "error of the tip [m]", y_scale="log", scene=scene.name)
