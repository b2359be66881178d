"""Kinds of measurement: one file each, with its `Settings` and a generator `run(case, settings)`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from flexlink.spec import Spec
from validation.case import Case, Measured
from validation.kinds import (
    accuracy,
    buckling,
    convergence,
    damping,
    energy_drift,
    exact_motion,
    finite_chains,
    frequencies,
    identities,
    integrators,
    judge,
    motion_benchmark,
    order_conditions,
    pointwise,
    rounding_growth,
    speed,
    speed_batch,
    speed_calls,
    speed_start,
    speed_steps,
    statics,
    trajectory,
)
from validation.store import Series


class Kind(Protocol):
    """What a file in this folder provides."""

    @property
    def Settings(self) -> type[Spec]:
        """The case's table `settings`, decoded strictly."""

    def run(self, case: Case, settings: Any, /) -> Iterator[Measured | Series] | Iterator[Measured]:
        """Numbers and series in the order in which they are known."""


KINDS: dict[str, Kind] = {
    "accuracy": accuracy,
    "buckling": buckling,
    "convergence": convergence,
    "damping": damping,
    "energy_drift": energy_drift,
    "exact_motion": exact_motion,
    "finite_chains": finite_chains,
    "frequencies": frequencies,
    "identities": identities,
    "integrators": integrators,
    "judge": judge,
    "motion_benchmark": motion_benchmark,
    "order_conditions": order_conditions,
    "pointwise": pointwise,
    "rounding_growth": rounding_growth,
    "speed": speed,
    "speed_batch": speed_batch,
    "speed_calls": speed_calls,
    "speed_start": speed_start,
    "speed_steps": speed_steps,
    "statics": statics,
    "trajectory": trajectory,
}

TIMED = {name for name in KINDS if name.startswith("speed")} | {"integrators"}
"""Kinds that measure time: nothing else may run meanwhile."""
