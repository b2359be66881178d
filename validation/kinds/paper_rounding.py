"""Does rounding error limit the step? Truncation and rounding errors, down to the step at which both are equal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive
from flexlink.dynamics.rounding import EPS
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.runs import stable_step_at_start
from validation.store import Series, table
from validation.trade.error_parts import Fine, Setup, rounding


class Errors(NamedTuple):
    """Errors of one run [m]: total error of the steps, and its part due to rounding."""

    step: float
    steps: float
    rounding: float


def run(
    case: Case, hinges: int, steps: dict[str, tuple[Positive, ...]], exact: Fine, change: dict[str, Any] | None = None
) -> Iterator[Measured | Series]:
    """Yield both errors for every step [s], and the step at which they are equal, relative to the largest stable one.

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
