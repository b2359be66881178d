"""Natural frequencies of a rotating beam with a swept tip (Epps and Chandra 1996), read from printed figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

import flexlink as fl
from flexlink.describe.scene import Scene
from validation.measured.readings import Derived, Reading
from validation.measured.second_way import deviation, roughness
from validation.measured.uncertainty import standard
from validation.reference_values import look_up

DATA = "measured/rotating_beam"
READ_WITHIN = 0.02  # reading error as a fraction of a figure's full scale, taken as the largest value of a mode
FLAP_MODES = 3
SLOWEST = "flap 1", "0 rpm"
OUT_OF_PLANE = 0.5  # least share of a flap mode's motion along the axis of rotation


def readings() -> dict[str, Reading]:
    """The 36 measured frequencies [Hz] with their reading errors."""
    found = {}
    for mode, speeds in look_up(DATA, "frequency_hz").items():
        u = standard(READ_WITHIN * max(max(values) for values in speeds.values()))
        for speed, values in speeds.items():
            for sweep, value in zip(look_up(DATA, "sweep_deg"), values, strict=True):
                found[_name(mode, speed, sweep)] = Reading(value, u, "Hz", "frequency")
    return found


def u_again(predicted: Mapping[str, float]) -> dict[str, float]:
    """u_D a second way: scatter of D − S over the sweeps about its mean, of all modes and speeds, in units of u_D.

    The error of the model is taken as the same at all sweeps. What it is not adds to the scatter.
    """
    found, rough = readings(), []
    for mode, speeds in look_up(DATA, "frequency_hz").items():
        for speed in speeds:
            names = [_name(mode, speed, sweep) for sweep in look_up(DATA, "sweep_deg")]
            off = [found[name].value - predicted[name] for name in names]
            rough.append(roughness(off, [found[name].u for name in names], range(len(names)), degree=0))
    return {name: each.u * deviation(rough, degree=0) for name, each in found.items()}


def derived() -> Iterator[Derived]:
    """Ratios of frequencies at two sweeps or speeds, except for the slowest mode (1.4 to 1.8 Hz, read to 0.3 Hz)."""
    sweeps = look_up(DATA, "sweep_deg")
    for mode, speeds in look_up(DATA, "frequency_hz").items():
        for speed in speeds:
            if (mode, speed) == SLOWEST:
                continue
            straight = _name(mode, speed, sweeps[0])
            for sweep in sweeps[1:]:
                name = f"{mode}, {speed}, {sweep}° / {sweeps[0]}°"
                yield Derived(name, "trend with sweep", "ratio", _name(mode, speed, sweep), straight)
        slow, fast = list(speeds)[1:]
        for sweep in sweeps:
            name = f"{mode}, {sweep}°, {fast} / {slow}"
            yield Derived(name, "trend with speed", "ratio", _name(mode, fast, sweep), _name(mode, slow, sweep))


def predicted(scene: Scene) -> dict[str, float]:
    """Frequencies of the chain about its steady rotation, in which the swept tip bends the beam."""
    found = {}
    speeds = list(next(iter(look_up(DATA, "frequency_hz").values())))
    for sweep in look_up(DATA, "sweep_deg"):
        swept = scene.varied({"link.tip.mount.rpy_deg": [0.0, 0.0, float(sweep)]})
        for speed in speeds:
            for k, value in enumerate(_flap_frequencies(swept, float(speed.removesuffix(" rpm")))):
                found[_name(f"flap {k + 1}", speed, sweep)] = value
    return found


def _flap_frequencies(scene: Scene, rpm: float) -> list[float]:
    found = fl.small_motion.modes_in_motion(fl.lump(scene), {"hub": rpm * np.pi / 30})
    motion = (np.abs(found.paths) ** 2).sum(axis=1)
    flap = motion[:, 2] > OUT_OF_PLANE * motion.sum(axis=1)
    return [float(f) for f in found.hertz[flap][:FLAP_MODES]]


def _name(mode: str, speed: str, sweep: float) -> str:
    return f"{mode}, {speed}, {sweep}°"
