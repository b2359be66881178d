"""Ringing of a laboratory's two-link arm with both drives at rest, seen in its recordings: two frequencies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.describe.scene import Scene
from validation.measured.readings import Derived, Reading
from validation.measured.uncertainty import standard
from validation.reference_values import reference_array

DATA = "measured/two_link"
MODES = ("f1", "f2")
LINKS = ("one", "two")


def readings() -> dict[str, Reading]:
    """Both frequencies [Hz]: the middle of the range that was seen."""
    ranges = zip(MODES, reference_array(DATA, "ringing_hz"), strict=True)
    return {
        name: Reading(float(low + high) / 2, standard(float(high - low) / 2), "Hz", "ringing")
        for name, (low, high) in ranges
    }


def derived() -> Iterator[Derived]:
    """Nothing."""
    return iter(())


def predicted(scene: Scene) -> dict[str, float]:
    """The same of the chain, its joints held."""
    found = fl.natural_frequencies(fl.lump(scene), locked=LINKS) / (2 * np.pi)
    return {name: float(found[k]) for k, name in enumerate(MODES)}
