"""Drift of energy, angular momentum and time over millions of steps of a conservative arm.

Without gravity and friction the energy E is constant, and so is the momentum (M q̇)₁ of the first joint, about which no
torque acts. Each step adds the method's error and a rounding error of at most eps times E or (M q̇)₁. The drift
thus grows at most in proportion to the number of steps, and is compared with the drift in the first hundredth of the
run.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import mass_matrix
from flexlink.motion.simulate import simulate
from flexlink.results.trajectory import Trajectory
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series, table

LONG = True

SAMPLES = 200
SAMPLES_OF_A_HUNDREDTH = SAMPLES // 100


def run(case: Case, number: int, steps: dict[str, Positive]) -> Iterator[Measured | Series]:
    """Yield relative drifts of every method with its step [s], and their ratios to linearly extrapolated drifts."""
    for scene in case.load_scenes():
        rows = list[tuple[str, float, float, float]]()
        for method, step in steps.items():
            facts: Facts = {"method": method, "step": step, "steps": number}
            found = simulate(_long(scene, method, step, number))
            late = float(np.abs(found.t - np.arange(len(found.t)) * (number // SAMPLES) * step).max() / step)
            yield Measured("time", late, scene.name, varied=facts)
            drifts = {"energy": _drift(np.asarray(found.energy.total)), "momentum": _drift(_momentum(found))}
            for what, drift in drifts.items():
                expected = 100 * drift[: SAMPLES_OF_A_HUNDREDTH + 1].max() + number * EPS
                note = f"First hundredth of the run: {drift[: SAMPLES_OF_A_HUNDREDTH + 1].max():.2g}."
                yield Measured(f"{what} drift", float(drift.max()), scene.name, varied=facts, note=note)
                yield Measured(f"{what} drift / expected", float(drift.max() / expected), scene.name, varied=facts)
            counts = np.arange(len(found.t)) * (number // SAMPLES)
            rows += zip([method] * len(counts), counts[1:], drifts["energy"][1:], drifts["momentum"][1:], strict=False)
        columns = table(("method", "steps", "energy", "momentum"), rows)
        title = f"{scene.name}: drift in {number:,} steps"
        yield Series("long run", title, columns, "steps", "steps [1]", "drift [1]", "log", "log", group="method",
                     scene=scene.name)  # fmt: skip


def _long(scene: Scene, method: str, step: float, number: int) -> Scene:
    sample = step * (number // SAMPLES)
    return scene.varied({"run": {"method": method, "step": step, "sample": sample, "duration": SAMPLES * sample}})


def _drift(values: Array) -> Array:
    """Largest change up to each sample, relative to the first value."""
    return np.maximum.accumulate(np.abs(values / values[0] - 1))


def _momentum(run: Trajectory) -> Array:
    """(M q̇)₁ of every sample [kg m²/s]."""
    return np.array([mass_matrix(run.chain, q)[0] @ qd for q, qd in zip(run.q, run.qd, strict=True)])
