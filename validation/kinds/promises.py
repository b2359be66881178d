"""What a tolerance promises: error of the tip and stated error of random arms that move, by family.

The reference is a run on which two methods agree: Radau9, whose steps follow the vibrations, and explicit DOP853.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.spec import Positive
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.case import Case, Measured
from validation.extremes.families import Family, Moving, moving
from validation.store import Series, table

LONG = True
COLUMNS = ("family", "seed", "tolerance, of the reach", "method", "error / tolerance", "stated / true error", "warned")
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


def run(
    case: Case, families: tuple[Family, ...], scenes: int, tolerances: tuple[Positive, ...]
) -> Iterator[Measured | Series]:
    """Yield shares of runs beyond their tolerance, with and without a warning, and of honest stated errors."""
    found = [each for family in families for seed in range(scenes) for each in _runs(family, seed, tolerances)]
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
    columns, (x, *_, y, _, _) = table(COLUMNS, found), COLUMNS
    yield Series("runs", "Error of every run", columns, COLUMNS[2], COLUMNS[2], y, "log", "log", group=x)


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
