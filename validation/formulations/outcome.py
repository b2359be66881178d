"""The result of one run of a formulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from flexlink.common.types import Array
from validation.formulations.task import Task

Setting = Mapping[str, float]
"""Name of a numerical setting → its value."""


class Outcome(NamedTuple):
    """Tip at the samples in frame 0, shape (samples, 3) [m]; CPU seconds of the call; number of coordinates.

    `counted`: the seconds follow from a number of evaluations, so repeating the call is useless. `note`: a remark.
    """

    tip: Array
    seconds: float
    coordinates: int
    counted: bool = False
    note: str = ""


Run = Callable[[Task, str, Setting], Outcome]
"""Computes a task with one kind of element and its settings."""
