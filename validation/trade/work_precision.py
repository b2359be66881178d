"""Work-precision diagrams: points (error, CPU time) of a method on a scene, and the time for a given error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from flexlink.common.types import Array


class Run(NamedTuple):
    """Angles at the samples (samples, n) [rad], nan after a failure; CPU seconds; evaluations of the dynamics."""

    q: Array
    seconds: float
    evaluations: int = 0


class Point(NamedTuple):
    """One run: its setting (step [s] or tolerance), tip error relative to the motion (inf: failed), CPU seconds.

    `bend` is the error relative to the largest deflection, and `evaluations` count forward or inverse dynamics.
    """

    setting: float
    error: float
    seconds: float
    bend: float = math.inf
    evaluations: int = 0

    @property
    def worst(self) -> float:
        """The larger of the two errors."""
        return max(self.error, self.bend)

    @property
    def time_only(self) -> bool:
        """Whether the run was too long, so its time is extrapolated from its first part and its error is unknown."""
        return math.isnan(self.error)


class Cost(NamedTuple):
    """CPU seconds that an integrator needs for a target error.

    `kind` is "measured"; "order", extrapolated beyond the smallest measured error by the method's order; or "limit",
    the time for the smallest stable number of steps, extrapolated from part of a run, whatever its error.
    """

    seconds: float
    kind: str = "measured"


def ladder(run: Callable[[int], Point], first: int, budget: float, smallest: float) -> list[Point]:
    """Run with `first`, 2 `first`, … steps between outputs until both errors are small or the budget would be exceeded.

    Parameters
    ----------
    run
        Makes a run with a number of steps between outputs.
    first
        First number of steps.
    budget
        Longest run [CPU seconds].
    smallest
        The runs end when both errors are at or below this value.
    """
    points: list[Point] = []
    steps, per_step = first, 0.0
    while not points or (per_step * steps <= budget and points[-1].worst > smallest):
        point = run(steps)
        if point.error < math.inf:  # a failed run ended early: its time is meaningless
            point = min(point, run(steps), key=lambda each: each.seconds) if point.seconds < budget / 8 else point
            per_step = point.seconds / steps
        points.append(point)
        steps *= 2
        if steps > MOST_STEPS:
            break
    return points


MOST_STEPS = 1 << 20  # largest number of steps between two outputs


def cost(points: Sequence[Point], target: float, order: float) -> Cost | None:
    """Least CPU time for an error, interpolated between runs with finer and finer settings; None if no run was useful.

    If a run at the stability limit would take too long, its estimated time counts, whatever its error would be.

    Interpolation is linear in logarithms, which favours methods with few points. Beyond the last point the error falls
    with the method's order, or with the order of the last two points if it is higher.
    """
    if len(points) == 1 and points[0].time_only:
        return Cost(points[0].seconds, "limit")
    good = [point for point in points if point.error < 1.0]
    met = [point.seconds for point in good if point.error <= target]
    for coarse, fine in itertools.pairwise(points):
        if coarse.error < 1.0 and fine.error <= target < coarse.error:
            share = math.log(coarse.error / target) / math.log(coarse.error / fine.error)
            met.append(coarse.seconds * (fine.seconds / coarse.seconds) ** share)
    if met:
        return Cost(min(met))
    if not good:
        return None
    last = min(good, key=lambda each: each.error)
    return Cost(last.seconds * (last.error / target) ** (1.0 / max(order, _measured_order(good))), "order")


def _measured_order(good: Sequence[Point]) -> float:
    """Order from the last two points, if the second has twice the steps of the first; 0 if it cannot be computed."""
    if len(good) < 2 or not 0 < good[-1].error < good[-2].error:
        return 0.0
    return math.log2(good[-2].error / good[-1].error)
