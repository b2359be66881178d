"""Figures of the strip's decays: from the recordings of a robot's joint torques to a frequency per window.

The recordings are in the public repository shamilmamedov/beam_handling, folder `data/param_estimation_ICRA` (54 CSV
files, 1 kHz). It has no licence file, so the files are not part of the project; the figures that this module computes
from them are, in `validation/reference/measured/steel_strip_on_flange.json`, part `decays`:

    python -m validation.measured.strip_decays FOLDER

In each window, one frequency f and one decay rate d are fitted to the seven torques at once by least squares,

    τ_i(t) = a_i + b_i t + e^(−d t) (c_i cos 2πf t + s_i sin 2πf t),

weighted with the noise of each joint, which is the deviation of the differences of successive samples over √2. While
the joints rub, they stop and slip during a period, which no decaying sine describes: the residual exceeds the noise.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array

HEADS = (
    "run", "window", "frequency_hz", "standard_error_hz", "torque_amplitude_nm", "damping_ratio", "residual_of_noise",
)  # fmt: skip
JOINTS = 7
WINDOW = 2.0  # s, six periods
WINDOWS = 4  # from the end of the recording backwards; window 0 is the last
FIRST_HZ = {"Xdown": 3.05, "Xup": 2.8, "Z": 2.96}  # by the part of the name that states the orientation


class Decay(NamedTuple):
    """A decaying sine: frequency and its standard error [Hz], amplitude of all torques [N m], ζ, residual / noise."""

    frequency: float
    error: float
    amplitude: float
    damping_ratio: float
    residual: float


def read_torques(path: Path) -> tuple[Array, Array]:
    """Times [s] and the (samples, 7) torques of the joints [N m] of a recording.

    Raises
    ------
    DataFileError
        A column is missing.
    """
    with path.open(encoding="utf-8") as file:
        heads = [each.strip() for each in file.readline().split(",")]
    names = ["duration", *(f"tau_J[{k}]" for k in range(JOINTS))]
    if missing := [name for name in names if name not in heads]:
        raise DataFileError(f"{path.name}: column {missing[0]!r} is missing")
    found = np.loadtxt(path, delimiter=",", skiprows=1, usecols=[heads.index(name) for name in names], ndmin=2)
    return (found[:, 0] - found[0, 0]) / 1000.0, found[:, 1:]


def fit_decay(t: Array, torques: Array, noise: Array, first_hz: float) -> Decay:
    """Fit one decaying sine to all torques; t [s], torques (samples, joints) [N m], noise of each joint [N m]."""
    middle = t - (t[0] + t[-1]) / 2
    seen = torques / noise

    def design(f: float, d: float) -> Array:
        decay, phase = np.exp(-d * middle), 2 * math.pi * f * middle
        return np.column_stack([np.ones_like(middle), middle, decay * np.cos(phase), decay * np.sin(phase)])

    def off(p: Array) -> Array:
        columns = design(*p)
        found: Array = columns @ np.linalg.lstsq(columns, seen, rcond=None)[0] - seen
        return found

    best = least_squares(lambda p: off(p).ravel(), [first_hz, 0.2], x_scale=[0.01, 0.1])
    f, d = best.x
    weights = np.linalg.lstsq(design(f, d), seen, rcond=None)[0]
    amplitude = float(np.linalg.norm(np.hypot(weights[2], weights[3]) * noise))
    residual = float(np.sqrt((off(best.x) ** 2).mean(axis=0)).max())
    error = float(np.sqrt(np.linalg.inv(best.jac.T @ best.jac)[0, 0]))
    return Decay(float(f), error, amplitude, float(d / (2 * math.pi * f)), residual)


def decays_of(path: Path) -> Iterator[Decay]:
    """Fits of the windows of a recording, the last window first."""
    t, torques = read_torques(path)
    noise = np.std(np.diff(torques[t > t[-1] / 2], axis=0), axis=0) / math.sqrt(2)
    (first,) = (hertz for part, hertz in FIRST_HZ.items() if f"_{part}_" in path.name)
    for k in range(WINDOWS):
        end = t[-1] - k * WINDOW
        inside = (t > end - WINDOW) & (t <= end)
        yield fit_decay(t[inside], torques[inside], noise, first)


def figures(folder: Path) -> list[list[str | float]]:
    """Rows of `HEADS` for all recordings in a folder, in the order of their names.

    Raises
    ------
    DataFileError
        The folder has no recording, or a column is missing.
    """
    if not (paths := sorted(folder.glob("ocp_*.csv"))):
        raise DataFileError(f"{folder}: no recording ocp_*.csv")
    rows: list[list[str | float]] = []
    for path in paths:
        for k, each in enumerate(decays_of(path)):
            numbers = zip(each, (5, 5, 4, 4, 2), strict=True)
            rows.append([path.stem, k, *(round(value, digits) for value, digits in numbers)])
    return rows


if __name__ == "__main__":
    print(json.dumps({"heads": HEADS, "rows": figures(Path(sys.argv[1]))}))
