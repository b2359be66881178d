"""Are T1, T2 and T3 of low, medium and high precision? The error of each type alone, hinges and steps converged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from flexlink.chain.arguments import choice
from flexlink.describe.spec import Spec
from flexlink.reporting.numbers import number
from validation.benchmarks.error_parts import Fine, Path, Type, apart
from validation.case import Case, Measured
from validation.facts import Facts

TYPES: Mapping[str, Type] = {"rigid": "rigid", "T1": "z", "T2": "yz", "T3": "xyz"}
STEP = 2.0  # times more precise, at least, is another level of precision


class Motion(Spec, frozen=True):
    """What is changed in a scene, and what counts as converged, of flexible links and of rigid ones."""

    fine: Fine
    rigid: Fine
    change: dict[str, Any] = msgspec.field(default_factory=dict)


class Settings(Spec, frozen=True):
    """Scenes by name, of links that bend and twist."""

    scene: dict[str, Motion]


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """The tip's distance from that with T3, by type, and whether every type is a step of precision everywhere."""
    scenes = {scene.name: scene for scene in case.load_scenes()}
    idle: dict[str, float] = {}
    for name, motion in settings.scene.items():
        scene = choice(f"{case.path}: settings.scene", name, scenes).varied(motion.change)
        limits = {t: (motion.rigid if t == "rigid" else motion.fine).limit(scene, flex) for t, flex in TYPES.items()}
        errors = {t: apart(path.tip, limits["T3"].tip) for t, path in limits.items() if t != "T3"}
        for t, error in errors.items():
            facts: Facts = {"type": t}
            yield Measured("error of the type", error, name, varied=facts)
            yield Measured("own error / error", _own(limits, t) / error, name, varied=facts)
        gains = {"T1": errors["rigid"] / errors["T1"], "T2": errors["T1"] / errors["T2"]}
        for t, gain in gains.items():
            yield Measured("gain", gain, name, varied={"type": t})
        idle |= {f"{t} on {name}": gain for t, gain in gains.items() if gain < STEP}
    yield Measured("claim", min(idle.values(), default=STEP), note=_verdict(idle))


def _own(limits: Mapping[str, Path], name: str) -> float:
    return limits[name].own + limits["T3"].own


def _verdict(idle: Mapping[str, float]) -> str:
    if not idle:
        return "holds"
    gains = ", ".join(f"{name} {number(gain)}" for name, gain in idle.items())
    return f"does not hold in general; gains below {number(STEP)}: {gains}"
