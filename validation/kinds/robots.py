"""Imported arms against their robots' own URDF files in Pinocchio; flexible ones against themselves, rigid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import flexlink as fl
from flexlink.dynamics.rounding import acceleration_error
from flexlink.engines.states import State, random_states
from flexlink.robots.collection import KnownArm, import_arm, known_arm, known_arms
from flexlink.robots.tuning import clamped_frequency
from flexlink.describe.spec import Spec
from validation.benchmarks.original import Original
from validation.case import Case, Measured
from validation.facts import Facts

Array = NDArray[np.float64]


class Settings(Spec, frozen=True):
    """Which arms of the table (default: all), and at how many random states."""

    samples: int
    arms: tuple[str, ...] = ()


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Largest error of each quantity by arm."""
    facts: Facts = {"states": settings.samples}
    for name in settings.arms or known_arms():
        arm = known_arm(name)
        scene, others = (_flexible if arm.flexible else _rigid)
