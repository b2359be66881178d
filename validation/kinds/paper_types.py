"""Is the precision of T1, T2 and T3 low, medium and high? Only the type causes errors, since runs are converged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from flexlink.describe.spec import Spec
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.trade.error_parts import TYPES, Fine

LEAST_GAIN = 2.0  # smallest factor of error reduction that counts as a higher level of precision


class Motion(Spec, frozen=True):
    """Changes of a scene, and settings that are converged for flexible and for rigid links."""

    fine: Fine
    rigid: Fine
    change: dict[str, Any] = msgspec.field(default_factory=dict)


def run(case: Case, scene: dict[str, Motion]) -> Iterator[Measured]:
    """Yield each type's distance from the tip by T3, and whether each type is more precise than the one before.

    The links of the scenes bend and twist.
    """
    found: dict[str, float] = {}
    for name, motion in scene.items():
        base = case.varied_scene(name, motion.change)
        limits = {
            t: (motion.rigid if t == "rigid" else motion.fine).limit(base, flex)
            for t, flex in {"rigid": "rigid", **TYPES}.items()
        }
        errors = {t: largest_distance(path.tip, limits["T3"].tip) for t, path in limits.items() if t != "T3"}
        for t, error in errors.items():
            facts: Facts = {"type": t}
            yield Measured("error of the type", error, name, varied=facts)
            yield Measured("own error / error", (limits[t].own + limits["T3"].own) / error, name, varied=facts)
        gains = {"T1": errors["rigid"] / errors["T1"], "T2": errors["T1"] / errors["T2"]}
        for t, gain in gains.items():
            yield Measured("gain", gain, name, varied={"type": t})
        found |= {f"{t} on {name}": gain for t, gain in gains.items()}
    yield Measured("claim", min(found.values()), note=_verdict(found))


def _verdict(gains: Mapping[str, float]) -> str:
    """Verdict from the gain of each type over the previous one, by type and scene; errors are known to a tenth."""
    known = 0.1  # largest error estimate of the references that the case accepts, as a fraction of an error
    worse = _named({name: gain for name, gain in gains.items() if gain < 1.0 - known})
    if worse:
        return f"does not hold: less precise than the previous type: {worse}"
    idle = _named({name: gain for name, gain in gains.items() if gain < LEAST_GAIN})
    if idle:
        return (
            "holds as the paper limits it, by manipulator and task: the error of the previous type is less than "
            f"{number(LEAST_GAIN)} times larger in {idle}"
        )
    return "holds"


def _named(gains: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number(gain)}" for name, gain in gains.items())
