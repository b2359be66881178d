"""Two ringing frequencies of a laboratory's two-link arm with both drives at rest, from the arm's recordings."""

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
    """Both frequencies [Hz]: midpoints of the observed ranges."""
    ranges = zip(MODES, reference_array(DATA, "ringing_hz"), strict=True)
    return {
        name: Reading(float(low + high) / 2, standard(float(high - low) / 2), "Hz", "ringing")
        for name, (low, high) in ranges
    }


def derived() -> Iterator[Derived]:
    """No derived quantities."""
    return iter(())


def predicted(scene: Scene) -> dict[str, float]:
    """Frequencies of the chain with locked joints."""
    found = fl.natural_frequencies(fl.lump(scene), locked=LINKS) / (2 * np.pi)
    return {name: float(found[k]) for k, name in enumerate(MODES)}
