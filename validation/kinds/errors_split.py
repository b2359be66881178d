"""Contributions to a run's error: type of the links, lumping, time steps, rounding."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series, table
from validation.trade.error_parts import Fine, Setup, Split, Splitter, Type

LONG = True

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


def run(case: Case, scene: dict[str, Errors]) -> Iterator[Measured | Series]:
    """Yield the error of every run, its parts and their uncertainties, and a series per scene."""
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
