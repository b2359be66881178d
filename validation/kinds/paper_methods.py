"""Statements of the paper about time steps: which method suffices, and where rounding limits the step."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from msgspec.structs import replace

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.rounding import EPS
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.runs import stable_step_at_start, stable_steps
from validation.store import Series, table
from validation.trade.error_parts import Fine, Path, Setup, Type, rounding
from validation.trade.work_precision import Point, cost

OF_ORDER_2, OF_ORDER_4, OF_ORDER_10 = "RK2", "RK4", "RK10"
OF_STABLE = 0.9  # fraction of the largest stable step at the initial state; later configurations may shorten it


class PaperMethodsSettings(Spec, frozen=True):
    """Situations (changes of the scene) by name, types of links, numbers of segments, target errors.

    Attributes
    ----------
    halvings
        Number of times the largest stable step is halved, by method.
    errors
        Target errors, as fractions of the tip's motion, the largest first.
    exact
        PaperMethodsSettings of the reference, whose time-stepping error is negligible.
    """

    situation: dict[str, dict[str, Any]]
    types: dict[str, Type]
    segments: tuple[int, ...]
    halvings: dict[str, int]
    errors: tuple[Positive, ...]
    exact: Fine


class Need(NamedTuple):
    """Evaluations by method for a target error on one arm."""

    situation: str
    error: float
    evaluations: Mapping[str, float]

    def gain(self, rival: str, method: str = OF_ORDER_4) -> float:
        """Evaluations that `method` needs, divided by the evaluations that `rival` needs."""
        return self.evaluations[method] / self.evaluations[rival]


@kind
def paper_methods(case: Case, settings: PaperMethodsSettings) -> Iterator[Measured]:
    """Is RK4 sufficient in all cases? Number of evaluations that each method needs for a given tip error, on many arms.

    Yield RK4's error at its largest stable step on each arm, the other methods' largest gains, and both claims.
    """
    (base,) = case.load_scenes()
    needs: list[Need] = []
    arms, worst = 0, 0.0
    for situation, name, segments in itertools.product(settings.situation, settings.types, settings.segments):
        cut = Setup(flex=settings.types[name], hinges=segments - 1, method=OF_ORDER_4)
        ladders, own = _ladders(base.varied(settings.situation[situation]), cut, settings)
        facts: Facts = {"situation": situation, "chain": name, "cells": segments}
        yield Measured("error at the largest step", ladders[OF_ORDER_4][0].error, base.name, varied=facts)
        yield Measured("own error / smallest aim", own / min(settings.errors), base.name, varied=facts)
        needs += [Need(situation, error, _costs(ladders, error)) for error in settings.errors]
        arms, worst = arms + 1, max(worst, ladders[OF_ORDER_4][0].error)
    for rival, error in itertools.product((OF_ORDER_2, OF_ORDER_10), settings.errors):
        gain = max(need.gain(rival) for need in needs if need.error == error)
        yield Measured("RK4 / rival", gain, base.name, varied={"method": rival, "error": error})
    yield Measured("claim", worst, base.name, varied={"arms": arms}, note=_of_tenth(needs, arms))
    for method in (OF_ORDER_4, OF_ORDER_10):
        gain = max(need.gain(OF_ORDER_2, method) for need in needs)
        facts = {"claim": f"{method} is more efficient than {OF_ORDER_2}", "arms": arms}
        yield Measured("claim on RK2", gain, base.name, varied=facts, note=_of_second(needs, method))


def _ladders(scene: Scene, cut: Setup, settings: PaperMethodsSettings) -> tuple[dict[str, list[Point]], float]:
    """Runs by method, as points of relative error and evaluations (in place of seconds); also the reference's error."""
    truth = settings.exact.in_time(scene, cut)
    return {m: list(_ladder(scene, cut, m, k, truth)) for m, k in settings.halvings.items()}, truth.own / tip_travel(
        truth.tip
    )


def _ladder(scene: Scene, cut: Setup, method: str, halvings: int, truth: Path) -> Iterator[Point]:
    longest = stable_steps(cut.scene(scene), method, OF_STABLE)
    for halving in range(halvings + 1):
        steps = 2**halving * longest  # number of steps between two samples
        setup = replace(cut, method=method, step=scene.run.spacing / steps)
        evaluations = methods.method(method).stages * steps * (scene.run.samples - 1)
        try:
            error = largest_distance(setup.tip(scene), truth.tip) / tip_travel(truth.tip)
        except fl.FlexlinkError:  # the step is unstable in a later configuration
            error = math.inf
        yield Point(scene.run.spacing / steps, error, evaluations)


def _costs(ladders: Mapping[str, list[Point]], error: float) -> dict[str, float]:
    """Evaluations for an error, by method; extrapolated by the method's order below the smallest measured error."""
    found = {method: cost(points, error, methods.method(method).order) for method, points in ladders.items()}
    return {method: each.seconds if each else math.inf for method, each in found.items()}


def _of_tenth(needs: Sequence[Need], arms: int) -> str:
    """Verdict on RK4 against RK10, with the smallest error down to which RK4 is cheaper on every arm."""
    if any(math.isinf(need.evaluations[OF_ORDER_4]) for need in needs):
        return "does not hold: RK4 fails on an arm with every step tried"
    held = ""
    for error in dict.fromkeys(need.error for need in needs):
        gains = [need.gain(OF_ORDER_10) for need in needs if need.error == error]
        cheaper = [gain for gain in gains if gain > 1.0]
        if cheaper:
            most = number(max(cheaper), 2)
            limit = f"at {number(error)} RK10 is cheaper on {len(cheaper)} of {arms} arms, by up to {most} times"
            return f"holds down to errors of {held} of the motion; {limit}" if held else f"does not hold: {limit}"
        held = number(error)
    return "holds"


def _of_second(needs: Sequence[Need], method: str) -> str:
    """Verdict on `method` against RK2, with the situations in which RK2 takes fewer evaluations, and how often."""
    exceptions, valid = [], []
    for situation in dict.fromkeys(need.situation for need in needs):
        gains = [need.gain(OF_ORDER_2, method) for need in needs if need.situation == situation]
        lost = [gain for gain in gains if gain > 1.0]
        if lost:
            most = number(max(lost), 2)
            exceptions.append(
                f"{situation} (in {len(lost)} of {len(gains)} pairs of arm and error it needs more, up to {most} times)"
            )
        else:
            valid.append(situation)
    if not exceptions:
        return "holds"
    return (
        f"holds for arms: {', '.join(valid)}; not for all: {', '.join(exceptions)}"
        if valid
        else f"does not hold: {', '.join(exceptions)}"
    )


class Errors(NamedTuple):
    """Errors of one run [m]: total error of the steps, and its part due to rounding."""

    step: float
    steps: float
    rounding: float


@kind
def paper_rounding(
    case: Case, hinges: int, steps: dict[str, tuple[Positive, ...]], exact: Fine, change: dict[str, Any] | None = None
) -> Iterator[Measured | Series]:
    """Does rounding error limit the step? Truncation and rounding errors, down to the step at which both are equal.

    Yield both errors for every step [s], and the step at which they are equal, relative to the largest stable one.

    The links have `hinges` hinges by the paper's rule; `exact` defines the reference that is exact in time.
    """
    (full,) = case.load_scenes()
    scene = full.varied(change or {})
    setups = {m: [Setup(flex="z", hinges=hinges, method=m, step=h) for h in sizes] for m, sizes in steps.items()}
    found = {method: list(_errors(scene, each, exact)) for method, each in setups.items()}
    parts: dict[str, float] = {}
    for method, errors in found.items():
        for e in errors:
            facts: Facts = {"method": method, "step": e.step}
            yield Measured("error of the steps", e.steps, scene.name, varied=facts)
            yield Measured("rounding", e.rounding, scene.name, varied=facts)
            linear = scene.run.duration / e.step * EPS * fl.lump(scene).reach
            yield Measured("rounding / steps", e.rounding, scene.name, varied=facts, scale=linear)
        meeting = _meeting(errors, methods.method(method).order)
        parts[method] = meeting / stable_step_at_start(scene, method)
        yield Measured("step where they meet", meeting, scene.name, varied={"method": method})
    yield Measured("claim", min(parts.values()), scene.name, note=_verdict(parts))
    yield _series(scene, found)


def _verdict(parts: Mapping[str, float]) -> str:
    """Verdict from the fraction of the largest stable step at which rounding and truncation errors are equal."""
    limits = ", ".join(f"{number(100 * part, 2)} % for {method}" for method, part in parts.items())
    return f"holds up to these fractions of the largest stable step: {limits}; above, the truncation error is larger"


def _errors(scene: Scene, setups: Sequence[Setup], exact: Fine) -> Iterator[Errors]:
    truth = exact.in_time(scene, setups[0])
    for setup in setups:
        tip, step = setup.tip(scene), setup.step or 0.0
        yield Errors(step, largest_distance(tip, truth.tip), rounding(scene, setup, tip))


def _meeting(errors: Sequence[Errors], order: int) -> float:
    """The step at which truncation equals rounding, extrapolated by order from the finest step with little rounding."""
    floor = max(e.rounding for e in errors)
    least = 10.0 * floor  # smallest error that is hardly affected by rounding
    clear = min((e for e in errors if e.steps >= least), key=lambda e: e.step, default=errors[0])
    return float(clear.step * (floor / clear.steps) ** (1.0 / order))


def _series(scene: Scene, found: Mapping[str, Sequence[Errors]]) -> Series:
    rows = [(method, *errors) for method, each in found.items() for errors in each]
    columns = table(("method", "step [s]", "steps", "rounding"), rows)
    title = f"Total error and rounding error: {scene.name}, {scene.run.duration:g} s"
    labels = "step [s]", "step [s]", "error of the tip [m]"
    return Series("rounding", title, columns, *labels, "log", "log", group="method", scene=scene.name)
