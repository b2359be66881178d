"""method = "auto": what makes an arm stiff, and what keeps the highest order away."""

from __future__ import annotations

import dataclasses
import functools
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from conftest import flexible, make_scene

import flexlink as fl
from flexlink.common.memo import Kept
from flexlink.dynamics.vibration.extremes import fastest_frequency
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.method_choice import SMALL, STIFF, cheapest

SCENE = make_scene(flexible("a", segments=3))
CHAIN = fl.lump(SCENE)


@functools.cache
def fastest() -> float:
    """Of its springs; asked by tests, not where they are collected: it compiles."""
    return fastest_frequency(CHAIN, np.zeros(CHAIN.n))


def chosen(duration: float, part: float = 1e-4, drive: dict[str, Any] | None = None, **hinges: float) -> str:
    """The method for a run of this length with an error of this part of the reach, springs like those of `CHAIN`."""
    scene = SCENE if drive is None else SCENE.varied({"drive": drive})
    changed = CHAIN.hinges.copy()
    for name, value in hinges.items():
        changed[name][CHAIN.stiffness > 0] = value
    chain = dataclasses.replace(CHAIN, hinges=changed)
    record = SimpleNamespace(
        chain=chain,
        q=np.zeros((1, chain.n)),
        qd=np.zeros((1, chain.n)),
        run=SimpleNamespace(duration=duration),
        inputs=problem_of(scene, CHAIN).inputs,
        kept=Kept(),
    )
    return cheapest(cast("Any", record), part * chain.reach, 10.0)[0]


def test_dampers_alone_make_an_arm_stiff() -> None:
    """A short run, for an explicit method by its springs; dampers a million times as strong as critical ones."""
    duration = 0.1 * STIFF / fastest()
    assert chosen(duration) == "DOP853"
    assert chosen(duration, damping=1e6 * float(CHAIN.stiffness.max()) / fastest()) == "Radau5"


def test_high_order_is_for_small_tolerances_and_not_for_dry_friction() -> None:
    duration = 0.9 * STIFF / fastest()
    assert chosen(duration, 10 * SMALL) == "Radau5"
    assert chosen(duration, 0.1 * SMALL) == "Radau9"
    assert chosen(duration, 0.1 * SMALL, coulomb=1e-3, coulomb_width=1.0) == "Radau5"


def test_a_stiff_run_does_not_begin_with_high_order() -> None:
    """Vibration that its start excites asks for short steps of any order."""
    assert chosen(1.1 * STIFF / fastest(), 0.1 * SMALL) == "Radau5"
    assert chosen(10 * STIFF / fastest(), 0.1 * SMALL) == "Radau5"


def test_gains_of_a_drive_and_dry_friction_make_an_arm_stiff() -> None:
    duration = 0.1 * STIFF / fastest()
    stiff, braked = 1e6 * float(CHAIN.stiffness.max()), 1e6 * float(CHAIN.stiffness.max()) / fastest()
    pd = {"kind": "pd", "kp": [0.0], "kd": [0.0], "target_deg": [0.0]}
    assert chosen(duration, drive=pd) == "DOP853"
    assert chosen(duration, drive={**pd, "kp": [stiff]}) == "Radau5"
    assert chosen(duration, drive={**pd, "kd": [braked]}) == "Radau5"
    assert chosen(duration, coulomb=braked, coulomb_width=1.0) == "Radau5"


def test_a_run_without_duration_takes_no_steps_and_any_method_does() -> None:
    assert fl.simulate(SCENE, duration=0.0, method="auto", relative_tolerance=1e-4).t.tolist() == [0.0]
