"""Check the error estimates and costs of advice, on random scenes and robots that were not used for tuning."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flexlink.advice.advise import Advisor
from flexlink.advice.goal import goal_of
from flexlink.advice.verdict import Advice
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene, scene_from
from flexlink.describe.spec import NonNegative, Positive, Spec
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.tip_motion import largest_distance
from validation.advice.scenes import SAMPLES, random_scene, released_scene, robot_scene, tumbling_scene
from validation.advice.truth import Truth, cheapest, naive_cost, truth
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind

REPEATS = 5
"""Largest number of repetitions of a timed run; the shortest counts."""

LONG = 5.0
"""CPU time [s] of all repetitions after which a run is not repeated again: what disturbs it is then small beside it."""

TIME_KNOWN_TO = 1.3
"""Largest accepted ratio between estimated and measured CPU time."""

TRUTH_KNOWN_TO = 0.1
"""Largest uncertainty of the reference, as a fraction of the tolerance, for a verdict."""


class Settings(Spec, frozen=True):
    """Seeds of the random scenes, tolerances as fractions of the motion, and the budget of the references.

    `durations` [s] belong to the case's scenes; `robot` [s] is the duration for the robot from a URDF file, 0 to leave
    it out. `grid` lists seeds for which every model of a grid is tried, `tumbling` seeds of scenes with sensitive
    motion, `released` seeds of arms released from a bent state.
    """

    first: int
    scenes: int
    tolerances: tuple[Positive, ...]
    known_to: Positive  # fraction of the smallest tolerance
    budget: Positive
    durations: dict[str, Positive]
    robot: NonNegative = 0.0
    grid: tuple[int, ...] = ()
    tumbling: tuple[int, ...] = ()
    released: tuple[int, ...] = ()
    few: NonNegative = 0.0


class Cell(NamedTuple):
    """Advice on a scene for one tolerance, with the reference."""

    scene: str
    tolerance: float  # fraction of the motion
    advice: Advice
    error: float  # true error of the advised scene [m]
    own: float  # cost of the advised run [s]
    work: float  # cost of all runs of the advice [s]
    naive: float  # cost of the naive model [s]
    seconds: float  # CPU time of the run, including set-up
    true: Truth
    tip: Array  # path of the advised scene (samples, 3) [m]; empty if its run diverged


@kind(timed=True)
def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Yield rows of every cell, then statistics over all cells."""
    cells: list[Cell] = []
    optimum: list[float] = []
    refused: list[str] = []
    for scene, seed in _scenes(case, settings):
        true = truth(scene, settings.known_to * min(settings.tolerances), settings.budget)
        judged = []
        for tolerance in settings.tolerances:
            facts: Facts = {"tolerance": tolerance}
            try:
                cell = _cell(scene, tolerance, true)
            except FlexlinkError as error:
                refused.append(f"{scene.name} {tolerance:g}: {type(error).__name__}: {error}")
                continue
            yield from _rows(cell, facts)
            judged.append(cell)
        cells += judged
        if seed in settings.grid:
            for ratio, tolerance in _beside_the_grid(scene, true, judged):
                optimum.append(ratio)
                yield Measured("cost over the grid's cheapest", ratio, scene.name, varied={"tolerance": tolerance})
    yield Measured("cells refused", len(refused), note="; ".join(refused))
    yield from _summary(cells, optimum)


def _scenes(case: Case, settings: Settings) -> Iterator[tuple[Scene, int]]:
    for scene in case.load_scenes():
        duration = settings.durations[scene.name]
        every = duration / SAMPLES
        changes = {"run.step": every, "run.sample": every, "run.duration": duration}
        yield scene.varied(changes), -1
    if settings.robot:
        yield robot_scene(settings.robot), -1
    for seed in range(settings.first, settings.first + settings.scenes):
        yield random_scene(seed), seed
    for seed in settings.tumbling:
        yield tumbling_scene(seed), -1
    for seed in settings.released:
        yield released_scene(seed), -1


def _cell(scene: Scene, tolerance: float, true: Truth) -> Cell:
    advisor = Advisor(scene, goal_of(tolerance, deflection=False, band=None, run=scene.run), budget=1.0)
    advice, error, own, tip = advisor.advice(), np.inf, np.inf, np.zeros((0, 3))
    try:
        run = simulate(advice.scene)
    except DivergenceError:
        pass
    else:
        tip, error = run.tip, largest_distance(run.tip, true.tip)
        own = run_cost(run.chain, run.steps.method, run.steps.evaluations) if run.steps else np.inf
    naive, seconds = naive_cost(scene), _seconds(advice.scene)
    return Cell(scene.name, tolerance, advice, error, own, advisor.runner.seconds, naive, seconds, true, tip)


def _seconds(scene: Scene) -> float:
    """CPU time of a run of a newly read scene [s]."""
    text, taken = scene.to_toml(), list[float]()
    while len(taken) < REPEATS and sum(taken) < LONG:
        read = scene_from(tomllib.loads(text))
        started = time.thread_time()
        try:
            simulate(read)
        except DivergenceError:
            return np.inf
        taken.append(time.thread_time() - started)
    return min(taken)


def _is_known(cell: Cell) -> bool:
    """Whether the reference is known well enough for a verdict: to a tenth of the tolerance."""
    return cell.true.error <= TRUTH_KNOWN_TO * cell.advice.tolerance


def _is_wrong(cell: Cell) -> bool:
    return cell.advice.met and not cell.error <= cell.advice.tolerance


def _rows(cell: Cell, facts: Facts) -> Iterator[Measured]:
    advice, name = cell.advice, cell.scene
    word = "met" if advice.met else "cannot"
    note = f"{word}; {advice.runs} runs; {advice.lines[-3]}" + ("" if _is_known(cell) else "; the truth is not known")
    yield Measured("true error", cell.error / cell.true.motion, name, varied=facts, note=note)
    if advice.met and advice.converged_tip is not None and _is_known(cell):
        yield Measured("stated over true error", advice.error / cell.error, name, varied=facts)
    if advice.met:
        yield Measured("naive over advised cost", cell.naive / cell.own, name, varied=facts)
    yield Measured("advice over naive cost", cell.work / cell.naive, name, varied=facts)
    yield Measured("stated over measured CPU time", advice.run_time / cell.seconds, name, varied=facts, timed=True)


def _beside_the_grid(scene: Scene, true: Truth, cells: list[Cell]) -> Iterator[tuple[float, float]]:
    met = {cell.advice.tolerance: cell for cell in cells if cell.advice.met and _is_known(cell)}
    if not met:
        return
    finest = max(met.values(), key=lambda cell: -cell.tolerance)
    axes = tuple(link.flex for link in finest.advice.scene.arm.links)
    best = cheapest(scene, true, {tolerance: cell.own for tolerance, cell in met.items()}, axes)
    for tolerance, cell in met.items():
        yield cell.own / best[tolerance], cell.tolerance


def _summary(cells: list[Cell], optimum: list[float]) -> Iterator[Measured]:
    known = [cell for cell in cells if _is_known(cell)]
    wrong = [f"{cell.scene} {cell.tolerance:g}" for cell in known if _is_wrong(cell)]
    yield Measured("met, but is not", len(wrong), note=", ".join(wrong))
    yield Measured("cells", len(cells))
    yield Measured("cells judged", len(known))
    yield Measured("cells met", sum(cell.advice.met for cell in cells))
    stated = [c for c in known if c.advice.met and c.advice.converged_tip is not None]
    yield from _spread("stated over true error", [c.advice.error / c.error for c in stated])
    yield Measured("stated too little", sum(c.advice.error < c.error - c.true.error for c in stated))
    promised = [(cell.advice.scene.run.tolerance or 0.0) / cell.advice.tolerance for cell in cells if cell.advice.met]
    yield Measured("tolerance of the steps over the goal, largest", max(promised, default=0.0))
    most = max((c.advice.error / (c.error + c.true.error) for c in stated), default=1.0)
    yield Measured("stated too much", most)
    yield from _spread("advice over naive cost", [cell.work / cell.naive for cell in cells])
    yield from _spread("advice's time over naive cost", [c.advice.compute_time / c.naive for c in cells], timed=True)
    yield from _times([cell.advice.run_time / cell.seconds for cell in cells])
    for tolerance in sorted({cell.tolerance for cell in cells}, reverse=True):
        ratios = [c.naive / c.own for c in cells if c.advice.met and c.tolerance == tolerance]
        if ratios:
            yield Measured(f"naive over advised cost at {tolerance:g}, median", float(np.median(ratios)))
    short = [cell for cell in cells if not cell.advice.met]
    third = 1 / 3  # stated errors may be three times too large, so a third of the tolerance may be stated as all
    horizons = [(cell.advice.horizon, _true_horizon(cell, 1.0), _true_horizon(cell, third)) for cell in short]
    yield from _spread("horizon over true horizon", [stated_end / true for stated_end, true, _ in horizons if true])
    thirds = [stated_end / earlier for stated_end, _, earlier in horizons if earlier]
    if thirds:
        yield Measured("horizon over a third's, smallest", min(thirds), note=f"{len(thirds)} cells")
    yield from _spread("cost over the grid's cheapest", optimum)


def _true_horizon(cell: Cell, part: float) -> float | None:
    """Last time [s] before the advised model's error exceeds `part` of the tolerance; None if never or unknown."""
    scene, allowed = cell.advice.scene, part * cell.advice.tolerance
    beyond = np.flatnonzero(np.linalg.norm(cell.tip - cell.true.tip[: len(cell.tip)], axis=1) > allowed)
    if not beyond.size or cell.true.errors[beyond[0]] > TRUTH_KNOWN_TO * allowed:
        return None
    return float(scene.run.times_from(scene.initial.time)[max(1, beyond[0] - 1)])


def _times(stated: list[float]) -> Iterator[Measured]:
    """Yield statistics of the ratio of estimated to measured CPU time."""
    yield from _spread("stated over measured CPU time", stated, timed=True)
    if stated:
        near = sum(1 / TIME_KNOWN_TO <= ratio <= TIME_KNOWN_TO for ratio in stated)
        yield Measured("cells with the stated CPU time", near / len(stated), note=f"{len(stated)} cells", timed=True)


def _spread(quantity: str, values: list[float], *, timed: bool = False) -> Iterator[Measured]:
    if values:
        for name, q in (("smallest", 0.0), ("median", 0.5), ("upper quartile", 0.75), ("largest", 1.0)):
            value, note = float(np.quantile(values, q)), f"{len(values)} cells"
            yield Measured(f"{quantity}, {name}", value, note=note, timed=timed)
