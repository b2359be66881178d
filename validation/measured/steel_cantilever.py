"""Frequencies of a clamped steel bar with an accelerometer at its end: peaks of the spectrum after an impulse."""

from __future__ import annotations

import flexlink as fl
from flexlink.describe.scene import Scene
from validation.measured.readings import Reading
from validation.measured.uncertainty import standard
from validation.reference_values import look_up

DATA = "measured/steel_cantilever"


def readings() -> dict[str, Reading]:
    """The eight bending frequencies [Hz]; a peak is known to half a line of the spectrum."""
    u = standard(look_up(DATA, "resolution_hz") / 2)
    return {
        f"mode {k}": Reading(value, u, "Hz", "frequency") for k, value in enumerate(look_up(DATA, "frequency_hz"), 1)
    }


def predicted(scene: Scene) -> dict[str, float]:
    """Bending frequencies of the chain."""
    found = fl.modes(fl.lump(scene), count=len(look_up(DATA, "frequency_hz"))).hertz
    return {f"mode {k}": float(value) for k, value in enumerate(found, 1)}
