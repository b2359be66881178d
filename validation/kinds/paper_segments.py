"""Precision and cost against the number of segments per link, in the paper's layout, by RK4 at its stability limit."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.runs import stable_step_at_start
from validation.speed.families import of_steps
from validation.speed.races import processor_time
from validation.trade.error_parts import Fine, Setup, Type

TIMED = True
BESIDE = True


class Arm(Spec, frozen=True):
    """Type and increasing numbers of segments per link; settings that converge in the number of hinges, and in time."""

    segments: tuple[int, ...]
    flex: Type
    fine: Fine
    in_time: Fine
    change: dict[str, Any] = msgspec.field(default_factory=dict)


class Price(NamedTuple):
    """Error and cost of a chain with this number of segments per link."""

    scene: str
    segments: int
    error: float  # error of the tip with exact time integration [m]
    cost: float  # CPU seconds per second of motion


def run(case: Case, scene: dict[str, Arm]) -> Iterator[Measured]:
    """Yield error and cost of every chain of the scenes by name, and the verdict on the claim."""
    found: list[Price] = []
    for name, arm in scene.items():
        base = case.varied_scene(name, arm.change)
        limit = arm.fine.limit(base, arm.flex)
        for segments in arm.segments:
            setup = Setup(flex=arm.flex, hinges=segments - 1, method="RK4")
            path = arm.in_time.in_time(base, setup)
            found.append(Price(name, segments, largest_distance(path.tip, limit.tip), _cost(setup.scene(base))))
            facts: Facts = {"cells": segments}
            yield Measured("error", found[-1].error, name, varied=facts)
            yield Measured("own error / error", (path.own + limit.own) / found[-1].error, name, varied=facts)
            yield Measured("cost", 1e3 * found[-1].cost, name, varied=facts, timed=True)
    gains = {name: _gain([price for price in found if price.scene == name]) for name in scene}
    yield Measured("claim", max(cost for _, cost in gains.values()), note=_verdict(found, gains), timed=True)


def _cost(scene: Scene) -> float:
    """CPU seconds per second of motion, by RK4 near its largest stable step, without the set-up of a run."""
    stable = stable_step_at_start(scene, "RK4")
    timed = 0.01 * stable  # step of the timed runs, stable in every configuration
    numbers = 500, 3500
    runs = [functools.partial(fl.simulate, of_steps(scene, n, timed)) for n in numbers]
    few, many = (min(processor_time(run) for _ in range(5)) for run in runs)
    return (many - few) / (numbers[1] - numbers[0]) / (0.9 * stable)  # at RK4's largest usable step


def _gain(prices: Sequence[Price]) -> tuple[float, float]:
    """Decrease of the error and increase of the cost from the fewest segments to the most, as ratios."""
    first, last = prices[0], prices[-1]
    return first.error / last.error, last.cost / first.cost


def _verdict(found: Sequence[Price], gains: Mapping[str, tuple[float, float]]) -> str:
    spans = {name: [price.segments for price in found if price.scene == name] for name in gains}
    gained = "; ".join(
        f"{name}, {spans[name][0]} to {spans[name][-1]} segments: error ÷ {number(error, 2)}, cost × {number(cost, 2)}"
        for name, (error, cost) in gains.items()
    )
    worse = [
        f"{b.segments} segments on {a.scene}, which are less precise than {a.segments}"
        for a, b in itertools.pairwise(found)
        if a.scene == b.scene and b.error > a.error
    ]
    return f"holds except for {', '.join(worse)}; {gained}" if worse else f"holds; {gained}"
