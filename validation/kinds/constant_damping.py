"""Damping with an equal ratio in every mode: decrements of free vibrations in the first modes.

The logarithmic decrement is ln(A_k / A_k+1) = 2π ζ / √(1 − ζ²) per period. Each run starts in one mode with an
amplitude in the linear range; its peaks are found by parabolas through samples of the tip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.describe.spec import Positive
from validation.case import Case, Measured

PERIODS, OF_A_PERIOD = 8, 200  # periods of a run, samples per period


def run(case: Case, ratio: Positive, modes: int, amplitude: Positive) -> Iterator[Measured]:
    """Yield each mode's damping ratio, from its decrement, relative to the target; tips start at `amplitude` [m]."""
    for scene in case.load_scenes():
        damped = scene.varied({"link.*.damping": {"ratio": ratio, "law": "constant"}})
        found = fl.modes(fl.lump(scene), count=modes)
        for k in range(modes):
            ζ = _ratio(_ringing(damped, found.shapes[k].real, 2 * math.pi / found.frequencies[k], amplitude))
            note = f"Found {ζ:.6g}, asked for {ratio:g}."
            yield Measured(f"ratio of mode {k + 1}", abs(ζ / ratio - 1), scene.name, note=note)


def _ringing(scene: fl.Scene, shape: np.ndarray, period: float, amplitude: float) -> fl.Trajectory:
    chain = fl.lump(scene)
    tip = fl.jacobian(chain, np.zeros(chain.n)).linear[1] @ shape
    every = period / OF_A_PERIOD
    settings = {"method": "Radau9", "tolerance": 1e-6 * amplitude, "sample": every, "duration": PERIODS * period}
    return fl.simulate(scene.varied({"initial.q": (amplitude / tip * shape).tolist(), "run": settings}))


def _ratio(run: fl.Trajectory) -> float:
    """Damping ratio from the slope of the logarithms of the maxima."""
    y = run.tip[:, 1]
    i = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    before, here, after = y[i - 1], y[i], y[i + 1]
    peaks = here - ((after - before) / 2) ** 2 / (2 * (before - 2 * here + after))
    decrement = -float(np.polyfit(np.arange(len(peaks)), np.log(peaks), 1)[0])
    return decrement / math.hypot(2 * math.pi, decrement)
