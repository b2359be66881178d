"""Natural frequencies of a rotating beam with a swept tip (Epps and Chandra 1996), read from printed figures.

Modes are those with most of their motion along the axis of rotation: three flap modes at three speeds, and at 750 rpm
the three above them, in which flap and torsion are coupled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

import flexlink as fl
from flexlink.describe.scene import Scene
from validation.measured.readings import Derived, Reading
from validation.measured.second_way import deviation, roughness
from validation.measured.trends import Trend, pooled
from validation.measured.uncertainty import standard
from validation.reference_values import look_up

DATA = "measured/rotating_beam"
READ_WITHIN = 0.02  # reading error as a fraction of a figure's full scale, taken as the largest value of a mode
FLAP_MODES = 3
COUPLED_AT = "750 rpm"
SLOWEST = "flap 1", "0 rpm"
OUT_OF_PLANE = 0.5  # least share of a flap mode's motion along the axis of rotation
IN_PLACE = 1e-3  # torsion of the straight beam moves its axis by less [m] than this times all hinge angles [rad]


def readings() -> dict[str, Reading]:
    """The 36 + 12 measured frequencies [Hz] with their reading errors."""
    coupled = {mode: {COUPLED_AT: values} for mode, values in look_up(DATA, "coupled_hz").items()}
    found = {}
    for group, modes in (("frequency", look_up(DATA, "frequency_hz")), ("coupled frequency", coupled)):
        for mode, speeds in modes.items():
            u = standard(READ_WITHIN * max(max(values) for values in speeds.values()))
            for speed, values in speeds.items():
                for sweep, value in zip(look_up(DATA, "sweep_deg"), values, strict=True):
                    found[_name(mode, speed, sweep)] = Reading(value, u, "Hz", group)
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
    return {name: each.u * deviation(rough, degree=0) for name, each in found.items() if each.group == "frequency"}


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


def trends(readings: Mapping[str, Reading], computed: Mapping[str, float]) -> Iterator[Trend]:
    """The ratios pooled: over the sweeps in each series of a mode and a speed, and over two speeds at each sweep."""
    sweeps, modes = look_up(DATA, "sweep_deg"), look_up(DATA, "frequency_hz")
    with_sweep = [
        [_name(mode, speed, sweep) for sweep in sweeps]
        for mode, speeds in modes.items()
        for speed in speeds
        if (mode, speed) != SLOWEST
    ]
    with_speed = [
        [_name(mode, speed, sweep) for speed in list(speeds)[1:]] for mode, speeds in modes.items() for sweep in sweeps
    ]
    for name, series in (("trend with sweep", with_sweep), ("trend with speed", with_speed)):
        yield pooled(name, name, series, readings, computed)


def predicted(scene: Scene) -> dict[str, float]:
    """Frequencies of the chain about its steady rotation, in which the swept tip and gravity bend the beam."""
    found = {}
    flap, coupled = list(look_up(DATA, "frequency_hz")), list(look_up(DATA, "coupled_hz"))
    for sweep in look_up(DATA, "sweep_deg"):
        swept = scene.varied({"link.tip.mount.rpy_deg": [0.0, 0.0, float(sweep)]})
        for speed in look_up(DATA, "frequency_hz")[flap[0]]:
            modes = [*flap, *coupled] if speed == COUPLED_AT else flap
            for mode, value in zip(modes, _frequencies(swept, float(speed.removesuffix(" rpm"))), strict=False):
                found[_name(mode, speed, sweep)] = value
    return found


def _frequencies(scene: Scene, rpm: float) -> list[float]:
    """Frequencies [Hz] of the modes that move mostly along the axis of rotation, or twist the beam in place."""
    found = fl.small_motion.modes_in_motion(fl.lump(scene), {"hub": rpm * np.pi / 30})
    motion, turned = (np.abs(found.paths) ** 2).mean(axis=1), np.abs(found.shapes).sum(axis=1)
    flap = motion[:, 2] > OUT_OF_PLANE * motion.sum(axis=1)
    twist = np.sqrt(motion.sum(axis=1)) < IN_PLACE * turned
    values: list[float] = found.hertz[flap | twist].tolist()
    return values


def _name(mode: str, speed: str, sweep: float) -> str:
    return f"{mode}, {speed}, {sweep}°"
