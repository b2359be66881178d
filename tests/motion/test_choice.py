"""With method = "auto", stiffness and tolerance decide on an explicit, an implicit or a high-order method."""

import dataclasses
import functools
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

import flexlink as fl
from flexlink.common.memo import Kept
from flexlink.dynamics.vibration.extremes import fastest_frequency
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.method_choice import SMALL, STIFF, cheapest
from tests.conftest import flexible, make_scene

SCENE = make_scene(flexible("a", segments=3))
CHAIN = fl.lump(SCENE)


@functools.cache
def fastest() -> float:
    """Highest spring frequency [rad/s] of `CHAIN`; computed within tests, since it compiles code."""
    return fastest_frequency(CHAIN, np.zeros(CHAIN.n))


def chosen(duration: float, part: float = 1e-4, drive: dict[str, Any] | None = None, **hinges: float) -> str:
    """The method chosen for a run of `CHAIN` with this duration [s] and a tolerance of `part` times its reach."""
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
        tied=False,
        inputs=problem_of(scene, CHAIN).inputs,
        kept=Kept(),
    )
    return cheapest(cast("Any", record), part * chain.reach, 10.0)[0]


def test_strong_dampers_alone_lead_to_an_implicit_method() -> None:
    """Without dampers, an explicit method suits this short run; the damping is a million times the critical one."""
    duration = 0.1 * STIFF / fastest()
    assert chosen(duration) == "DOP853"
    assert chosen(duration, damping=1e6 * float(CHAIN.stiffness.max()) / fastest()) == "Radau5"


def test_high_order_is_chosen_for_small_tolerances_without_dry_friction() -> None:
    duration = 0.9 * STIFF / fastest()
    assert chosen(duration, 10 * SMALL) == "Radau5"
    assert chosen(duration, 0.1 * SMALL) == "Radau9"
    assert chosen(duration, 0.1 * SMALL, coulomb=1e-3, coulomb_width=1.0) == "Radau5"


def test_a_stiff_run_does_not_start_with_a_high_order_method() -> None:
    """Vibration excited at the start requires short steps with any order."""
    assert chosen(1.1 * STIFF / fastest(), 0.1 * SMALL) == "Radau5"
    assert chosen(10 * STIFF / fastest(), 0.1 * SMALL) == "Radau5"


def test_drive_gains_and_dry_friction_lead_to_an_implicit_method() -> None:
    duration = 0.1 * STIFF / fastest()
    stiff, braked = 1e6 * float(CHAIN.stiffness.max()), 1e6 * float(CHAIN.stiffness.max()) / fastest()
    pd = {"kind": "pd", "kp": [0.0], "kd": [0.0], "target_deg": [0.0]}
    assert chosen(duration, drive=pd) == "DOP853"
    assert chosen(duration, drive={**pd, "kp": [stiff]}) == "Radau5"
    assert chosen(duration, drive={**pd, "kd": [braked]}) == "Radau5"
    assert chosen(duration, coulomb=braked, coulomb_width=1.0) == "Radau5"
