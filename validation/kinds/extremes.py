"""Runs at extreme parameters, and what a tolerance promises."""

from __future__ import annotations

import collections
import functools
import itertools
import operator
from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

import numpy as np

import flexlink as fl
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.case import Case, Measured
from validation.extremes.cells import Cell as Corner
from validation.extremes.cells import Map, recipe
from validation.extremes.families import Family, Moving, moving
from validation.extremes.outcomes import OUTCOMES, Outcome, RunOutcome, Truth, outcome_beside, outcome_of, truth_of
from validation.facts import Fact, Facts, in_words
from validation.kinds import kind
from validation.store import Series, table

NATIVE = "native"

COLUMNS = (
    "cell", "recipe", "situation", "varied", "axes",
    "engine", "method", "steps", "outcome", "error / tolerance", "said",
)  # fmt: skip

JUDGED_OUTCOMES: tuple[Outcome, ...] = ("within", "near", "warned", "false doubt", "silent wrong")


class HowTo(NamedTuple):
    """Settings of a run; `key` is "relative_tolerance", "step" or "of_limit", and `number` is the number of steps."""

    engine: str
    method: str
    key: str
    value: float
    number: int

    @property
    def words(self) -> str:
        """Step or tolerance in words."""
        return in_words({self.key: self.value})

    def scene(self, scene: Scene) -> Scene:
        """Return the scene with these settings.

        Raises
        ------
        FlexlinkError
            The settings are not possible for this scene.
        """
        changes: dict[str, object] = {"run.method": "RK4" if self.engine != NATIVE else self.method}
        if self.key == "relative_tolerance":
            return scene.varied(changes | {"run.relative_tolerance": self.value})
        step = self.value
        if self.key == "of_limit":
            longest = 0.02  # step [s] if every step is stable
            chain = lump(scene)
            step *= min(stable_step(chain, *initial_state(scene, chain), tip_wrench=scene.tip_wrench), longest)
        changes["run.step"] = step
        if self.number:
            samples = 20
            changes |= {"run.sample": step * (self.number // samples), "run.duration": step * self.number}
        return scene.varied(changes)


class Steps(Spec, frozen=True):
    """Settings of runs: every method with every tolerance (a fraction of the arm's reach) or every fixed step.

    engine
        "native", or another engine with "RK4"; MuJoCo also with "implicitfast".
    steps, of_limit
        Fixed steps [s], or fractions of RK4's largest stable step at the initial state.
    count
        Number of steps of each run; 0 for the scene's full duration.
    """

    methods: tuple[str, ...]
    tolerances: tuple[Positive, ...] = ()
    steps: tuple[Positive, ...] = ()
    of_limit: tuple[Positive, ...] = ()
    engine: Literal["native", "mujoco", "pinocchio"] = "native"
    count: int = 0

    def runs(self) -> Iterator[HowTo]:
        """Yield all combinations."""
        choices = ("relative_tolerance", self.tolerances), ("step", self.steps), ("of_limit", self.of_limit)
        for key, values in choices:
            yield from (
                HowTo(self.engine, method, key, value, self.count) for method in self.methods for value in values
            )


class ExtremesSettings(Map, frozen=True):
    """The map, the settings of each plan's runs, and the budget [s of CPU] beyond which a run is not classified."""

    budget: Positive
    steps: dict[str, Steps]

    def runs(self) -> Iterator[tuple[Corner, HowTo]]:
        """Yield all runs, in the order of the plans."""
        for corner in self.cells():
            for steps in corner.plan.steps:
                yield from ((corner, how) for how in self.steps[steps].runs())


class Cell(NamedTuple):
    """One run of the map and its outcome."""

    scene: str
    axes: dict[str, float]
    how: HowTo
    found: RunOutcome


def cell_in_words(_: Case, settings: ExtremesSettings, number: int) -> Iterator[str]:
    """Describe one cell and its result, line by line."""
    corner, how = list(settings.runs())[number]
    found = next(_outcomes(settings, corner, [how])).found
    yield f"{corner.scene}, {in_words(corner.values)}, {how.engine}, {how.method}, {how.words}"
    yield f"{found.outcome}: error {found.error:.3g} tolerances"
    yield found.words


@kind(long=True, cell_in_words=cell_in_words)
def extremes(case: Case, settings: ExtremesSettings) -> Iterator[Measured | Series]:
    """Outcomes of runs at extreme parameters, for each scene, varied keys, method and tolerance.

    No run may be wrong without a warning. Other engines take the same steps in the same cells; they issue no warnings.

    Yield counts of the outcomes, overall and by varied key, and the cells.
    """
    found: list[Cell] = []
    for corner, runs in itertools.groupby(settings.runs(), operator.itemgetter(0)):
        found += _outcomes(settings, corner, (how for _, how in runs))
    for engine in dict.fromkeys(cell.how.engine for cell in found):
        own = [cell for cell in found if cell.how.engine == engine]
        groups = _groups(own) if engine == NATIVE else {("", ""): own}
        for (head, value), members in groups.items():
            yield from _counts(engine, {head: value} if head else {}, members)
    yield _series(case, found)


def _outcomes(settings: ExtremesSettings, corner: Corner, runs: Iterable[HowTo]) -> Iterator[Cell]:
    """Yield the runs of one cell of the map; those of equal duration share the reference."""
    truths: dict[tuple[float, float], Truth] = {}

    def truth(scene: Scene) -> Truth:
        run = scene.run.duration, scene.run.spacing
        if run not in truths:
            truths[run] = truth_of(scene, budget=3.0 * settings.budget)  # computed once for many runs
        return truths[run]

    whole: Scene | None = None
    for how in runs:
        try:
            whole = whole or settings.situation(corner)[0]
            scene = how.scene(whole)
        except FlexlinkError as error:
            found = RunOutcome("error", np.nan, str(error), 0.0)
        else:
            known = functools.partial(truth, scene)
            if how.engine == NATIVE:
                found = outcome_of(scene, known, settings.budget)
            else:
                found = outcome_beside(scene, how.engine, how.method, known)
        yield Cell(corner.scene, corner.values, how, found)


def _counts(engine: str, facts: Facts, members: list[Cell]) -> Iterator[Measured]:
    """Yield the number of runs with each outcome; numbers of other engines are only information."""
    counts = collections.Counter(cell.found.outcome for cell in members)
    for outcome in OUTCOMES:
        note = _worst(members) if outcome == "silent wrong" else ""
        name = outcome if engine == NATIVE else f"{outcome}, beside"
        yield Measured(name, counts[outcome], engine=engine, varied=facts, note=note)
    if engine == NATIVE and not facts:
        judged = sum(counts[each] for each in JUDGED_OUTCOMES)
        yield Measured("cells", len(members))
        yield Measured("judged", judged)
        yield Measured("share of false doubts", counts["false doubt"] / max(judged, 1))


def _groups(found: list[Cell]) -> dict[tuple[str, Fact], list[Cell]]:
    """Group cells that share a scene, a method, a step or tolerance, or a value of an axis; one group has all cells."""
    groups: dict[tuple[str, Fact], list[Cell]] = collections.defaultdict(list)
    for cell in found:
        groups["", ""].append(cell)
        facts: Facts = {"situation": cell.scene, "method": cell.how.method, cell.how.key: cell.how.value, **cell.axes}
        for head, value in facts.items():
            groups[head, value].append(cell)
    return groups


def _worst(members: list[Cell]) -> str:
    wrong = [cell for cell in members if cell.found.outcome == "silent wrong"]
    if not wrong:
        return ""
    cell = max(wrong, key=lambda cell: cell.found.error)
    where = f"{cell.scene}, {in_words(cell.axes)}, {cell.how.method}, {cell.how.words}"
    return f"worst: {where}: {cell.found.error:.3g} tolerances"


def _series(case: Case, found: list[Cell]) -> Series:
    rows = [
        (number, recipe(case, number), cell.scene, in_words(cell.axes), " and ".join(cell.axes), *cell.how[:2],
         cell.how.words, *cell.found[:3])
        for number, cell in enumerate(found)
    ]  # fmt: skip
    columns, (x, *_, y, _) = table(COLUMNS, rows), COLUMNS
    return Series("outcomes", "Outcome of every run", columns, x, x, y, "linear", "log", group="outcome")


PROMISES = ("family", "seed", "tolerance, of the reach", "method", "error / tolerance", "stated / true error", "warned")
FAR, SURE, COUNTS = 0.1, 0.05, 0.1  # smallest travel [reach]; largest doubt of a reference, smallest error [tolerances]
NEAR = 0.3, 5.0  # stated over true error of an honest estimate


class Found(NamedTuple):
    """A run: its error in tolerances, the error that it states relative to that, and whether it warns."""

    family: str
    seed: int
    tolerance: float
    method: str
    error: float
    stated: float
    warned: bool


@kind(long=True)
def promises(
    case: Case, families: tuple[Family, ...], scenes: int, tolerances: tuple[Positive, ...], first: int = 0
) -> Iterator[Measured | Series]:
    """What a tolerance promises: error of the tip and stated error of random arms that move, by family.

    The reference is a run on which two methods agree: Radau9, whose steps follow the vibrations, and explicit DOP853.
    The scenes of a family are drawn with `scenes` consecutive seeds from `first` on.

    Yield shares of runs beyond their tolerance, with and without a warning, and of honest stated errors.
    """
    seeds = range(first, first + scenes)
    found = [each for family in families for seed in seeds for each in _runs(family, seed, tolerances)]
    yield Measured("runs", len(found))
    for family in families:
        own = [each for each in found if each.family == family]
        yield Measured(
            "largest error", max((each.error for each in own), default=0.0), varied={"family of arms": family}
        )
    beyond = [each for each in found if each.error > Thresholds.tolerable]
    yield Measured("beyond 3 tolerances", len(beyond) / max(len(found), 1))
    yield Measured("silent beyond 10 tolerances", sum(each.error > 10.0 and not each.warned for each in found))
    yield Measured("warned needlessly", sum(each.warned and each.error <= 1.0 for each in found) / max(len(found), 1))
    stated = np.array([each.stated for each in found if each.error > COUNTS])
    yield Measured("stated error near the true one", float(np.mean((stated >= NEAR[0]) & (stated <= NEAR[1]))))
    yield Measured("smallest stated error", float(stated.min(initial=np.inf)))
    columns, (x, *_, y, _, _) = table(PROMISES, found), PROMISES
    yield Series("runs", "Error of every run", columns, PROMISES[2], PROMISES[2], y, "log", "log", group=x)


def _runs(family: Family, seed: int, tolerances: tuple[float, ...]) -> Iterator[Found]:
    arm = moving(family, seed)
    size = fl.lump(arm.scene).size
    try:
        tip, apart = _reference(arm)
    except fl.FlexlinkError:
        return
    for tolerance in tolerances:
        if tip_travel(tip) < FAR * size or apart > SURE * tolerance * size:
            continue
        run = fl.simulate(arm.scene, relative_tolerance=tolerance, **arm.arguments)
        assert run.error is not None
        assert run.steps is not None
        error = largest_distance(run.tip, tip)
        warned = any(each.startswith("doubtful") for each in run.warnings)
        stated = float(run.error.max()) / max(error, 1e-300)
        yield Found(family, seed, tolerance, run.steps.method, error / (tolerance * size), stated, warned)


def _reference(arm: Moving) -> tuple[Array, float]:
    """Path of the tip, and its distance from that by another method [m]."""
    elastic = any(link.elastic or link.joint.gear_stiffness for link in arm.scene.arm.links)
    strict = {"relative_tolerance": 1e-10, "max_evaluations": 3e6, **arm.arguments}
    tip = fl.simulate(arm.scene, method="Radau9", accuracy="deflection" if elastic else "tip", **strict).tip
    return tip, largest_distance(tip, fl.simulate(arm.scene, method="DOP853", **strict).tip)
