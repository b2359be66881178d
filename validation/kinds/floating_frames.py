"""Strain modes and a floating frame with linear modes, by their number: a driven link that bends little or much.

The frame is Exudyn's, if installed, and the same equations in separate code. Errors are the largest distance of the tip
from the reference at any sample, relative to its largest way from rest. The full torque has the reference of
`formulations`; smaller ones have the exact beam on a hub with many modes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.spec import Positive, Spec
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.formulations.exact_modes import in_a_frame, on_a_hub, scaled
from validation.formulations.ladder import FORMULATIONS, attempt
from validation.formulations.task import Described, Reference, Setting, Task, task_of
from validation.kinds import kind
from validation.store import Series, table

OURS, FRAME, TEXTBOOK = "strain modes", "Exudyn FFRF", "linear modes, separate equations"
MANY = 8  # modes of the reference for small torques: six have an error of 5e-8
FALL, LITTLE = "error / error with fewer modes", "small bending, error"
MUCH, RATIO = "large bending, error", "large bending, error / that of strain modes"
SPUN = "spin-up, error of strain modes"
LOST = 1.0  # error of a tip that is its arm's length away, or farther
COLUMNS = "formulation", "modes", "torque", "error"


class Settings(Spec, frozen=True):
    """The driven link, numbers of modes, factors of its torque, settings of both formulations; the prescribed spin-up.

    `stations` is the error of the link's stations: below it, more modes need not help. `spun` replaces settings in the
    spin-up.
    """

    driven: Described
    spin_up: Described
    modes: tuple[int, ...]
    spun: dict[str, Positive]
    torques: tuple[Positive, ...]
    ours: dict[str, Positive]
    frame: dict[str, Positive]
    stations: Positive


class Point(NamedTuple):
    """Error of a formulation with this number of modes at this part of the torque."""

    formulation: str
    modes: int
    torque: float
    error: float


@kind
def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield errors by number of modes, distances from the same modes by separate equations, and how errors compare."""
    full, points = task_of("torque_pulse", settings.driven), list[Point]()
    shown = [name for name in (OURS, FRAME) if FORMULATIONS[name].installed]
    missing = "" if FRAME in shown else f"{FORMULATIONS[FRAME].package} is not installed."
    yield Measured("programs compared", len(shown), full.name, note=missing)
    for torque in settings.torques:
        task = _with_reference(scaled(full, torque), torque)
        for modes in settings.modes:
            yield from _with_modes(task, settings, shown, Point("", modes, torque, 0.0), points)
    yield from _comparisons(points, settings)
    yield from _spin_up(settings, shown)
    yield Series(
        "errors by modes", f"{full.scene.about}: error against the number of modes", table(COLUMNS, [
            (point.formulation, point.modes, f"torque × {point.torque:g}", point.error) for point in points
        ]), "modes", "modes m [1]", "error [1]", "linear", "log", group="formulation", panel="torque",
        scene=full.name,
    )  # fmt: skip


def _with_modes(task: Task, settings: Settings, shown: list[str], at: Point, points: list[Point]) -> Iterator[Measured]:
    """Yield errors with this number of modes, and distances from the same exact modes in separate equations.

    Those of the beam on a hub hold for small bending only.
    """
    way, textbook = _way(task), in_a_frame(task, at.modes)
    same = {FRAME: textbook} if at.torque == 1 else {FRAME: textbook, OURS: on_a_hub(task, at.modes)}
    tips = {name: _tip(task, name, settings, {"modes": at.modes}, way) for name in shown} | {TEXTBOOK: textbook}
    for name, tip in tips.items():
        points.append(at._replace(formulation=name, error=largest_distance(tip, task.reference.tip) / way))
        yield _row("error", points[-1])
        if name in same:
            apart = at._replace(formulation=name, error=largest_distance(tip, same[name]) / way)
            yield _row("distance from the same modes", apart)


def _with_reference(task: Task, torque: float) -> Task:
    """The task with the exact beam's motion as reference, unless the torque is the full one."""
    return task if torque == 1 else task._replace(reference=Reference(on_a_hub(task, MANY), float("nan")))


def _way(task: Task) -> float:
    """Largest distance of the tip from its place at rest [m]."""
    tip = task.reference.tip
    return float(np.linalg.norm(tip - tip[0], axis=1).max())


def _tip(task: Task, name: str, settings: Settings, own: Setting, way: float) -> Array:
    """Tip of a formulation with its `own` settings; flexlink's tolerance is relative to the tip's way."""
    return FORMULATIONS[name].run(task, FORMULATIONS[name].element, _chosen(task, name, settings, own, way)).tip


def _chosen(task: Task, name: str, settings: Settings, own: Setting, way: float) -> Setting:
    """Settings of a formulation; a tolerance in fractions of `way` [m] becomes one in fractions of the length."""
    chosen: Setting = {**(settings.ours if name == OURS else settings.frame), **own}
    return {**chosen, "tolerance": chosen["tolerance"] * way / task.length} if name == OURS else chosen


def _comparisons(points: list[Point], settings: Settings) -> Iterator[Measured]:
    """Yield how errors fall with modes, and both formulations with the most modes at the full and the least torque."""
    for torque in settings.torques:
        ours = [point for point in points if (point.formulation, point.torque) == (OURS, torque)]
        for fewer, more in pairwise(ours):
            if fewer.error > settings.stations:
                yield _row(FALL, more._replace(error=more.error / fewer.error))
    most, least = max(settings.modes), min(settings.torques)
    last = {(point.formulation, point.torque): point for point in points if point.modes == most}
    for name in dict.fromkeys(point.formulation for point in points):
        yield _row(LITTLE, last[name, least])
        large = last[name, 1.0]
        if name == OURS:
            yield _row(MUCH, large)
        else:
            ratio = large.error / last[OURS, 1.0].error
            yield _row(RATIO, large._replace(error=ratio))


def _spin_up(settings: Settings, shown: list[str]) -> Iterator[Measured]:
    """Yield errors in the spin-up, where a frame that nothing stiffens loses the tip, or cannot be integrated."""
    task = task_of("spin_up", settings.spin_up)
    for name in shown:
        chosen = _chosen(task, name, settings, settings.spun, task.length)
        found = attempt(task, FORMULATIONS[name].run, FORMULATIONS[name].element, chosen)
        error = LOST if found is None else float(np.fmin(task.error(found.tip), LOST))
        point = Point(name, round(settings.spun["modes"]), 1.0, error)
        yield _row("spin-up, error", point, task.name)
        if name == OURS:
            yield _row(SPUN, point, task.name)


def _row(quantity: str, point: Point, scene: str = "torque_pulse") -> Measured:
    facts: dict[str, str | int | float] = {"formulation": point.formulation, "modes": point.modes}
    if scene == "torque_pulse":
        facts["torque"] = point.torque
    program = FORMULATIONS[FRAME].program if point.formulation == FRAME else FORMULATIONS[OURS].program
    return Measured(quantity, point.error, scene, program, facts)
