"""Ringing of a laboratory's two-link arm with both drives at rest: two frequencies and a damping ratio."""

from __future__ import annotations

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.spec import decode
from flexlink.identification.problem import FitParameter
from validation.case import CASES, load_case
from validation.measured.readings import FittedInputs, Reading
from validation.measured.two_link import Split
from validation.measured.uncertainty import standard
from validation.reference_values import reference_array

DATA = "measured/two_link"
MODES = ("f1", "f2")
RATIO = "damping ratio 1"
LINKS = ("one", "two")
IDENTIFIED_BY = "measured_two_link"


def readings() -> dict[str, Reading]:
    """Both frequencies [Hz] and the damping ratio of the first mode: midpoints of the observed ranges."""
    ranges = zip(MODES, reference_array(DATA, "ringing_hz"), strict=True)
    found = {
        name: Reading(float(low + high) / 2, standard(float(high - low) / 2), "Hz", "ringing")
        for name, (low, high) in ranges
    }
    low, high = reference_array(DATA, "damping_ratio").tolist()
    return found | {RATIO: Reading((low + high) / 2, standard((high - low) / 2), "1", "damping")}


def predicted(scene: Scene) -> dict[str, float]:
    """Frequencies and damping ratio of the chain with locked joints."""
    found = fl.modes(fl.lump(scene), locked=LINKS, count=2)
    return {name: float(found.hertz[k]) for k, name in enumerate(MODES)} | {RATIO: float(found.damping_ratios[0])}


def fitted(scene: Scene) -> FittedInputs:
    """Parameters of the scene that were identified, and the covariance of their estimates, computed at their values."""
    settings = load_case(CASES / f"{IDENTIFIED_BY}.toml").settings
    split: Split = decode(settings["split"][0], Split)
    return split.uncertain(scene, [decode(one, FitParameter) for one in settings["sought"]])
