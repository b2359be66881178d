"""Rigid pendulums and the paper's link against trajectories known to at least 18 digits; the same runs in MuJoCo.

With RK10 only rounding error remains. MuJoCo has no such method and is compared with flexlink's RK4 at the same step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink import engines
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.physics.variant import Rule, Variant
from validation.reference_values import look_up
from validation.runs import run_facts
from validation.store import Series


class Trial(Spec, frozen=True):
    """A run, its reference file, and the step [s] of RK4 for the comparison with MuJoCo."""

    reference: str
    variant: Variant
    rk4_step: Positive


def run(case: Case, run: tuple[Trial, ...], chain: Rule) -> Iterator[Measured | Series]:
    """Yield tip errors, changes of the tip with half the step, and differences from MuJoCo; `chain` lumps the links."""
    for trial in run:
        scene = trial.variant.build(case, chain)
        name = trial.variant.name or scene.name
        times, exact = _exact(trial)
        ours, half = fl.simulate(scene), fl.simulate(scene, step=scene.run.fixed_step / 2)
        rows = np.searchsorted(ours.t, times - 1e-9)  # rows at the reference times; k·step is rounded
        error = np.linalg.norm(ours.tip[rows, :2] - exact, axis=1)
        yield Measured("tip error", float(error.max()), name, varied=run_facts(scene.run))
        change = float(np.abs(half.tip - ours.tip).max())
        yield Measured("time integration error", change, name, varied=run_facts(scene.run))
        yield _parity(scene.varied({"run.method": "RK4", "run.step": trial.rk4_step}), name)


def _exact(trial: Trial) -> tuple[Array, Array]:
    """Times (m,) and tip positions (m, 2)."""
    found = look_up(trial.reference, *trial.variant.keys)
    rows = found["rows"] if "rows" in found else [(entry["t"], entry["tip_x"], entry["tip_y"]) for entry in found]
    table = np.array(rows, dtype=np.float64)
    return table[:, 0], table[:, 1:]


def _parity(scene: Scene, name: str) -> Measured:
    ours = fl.simulate(scene)
    _, q, _ = engines.load("mujoco", ours.chain).integrate(scene)
    return Measured("MuJoCo's motion", float(np.abs(q - ours.q).max()), name, "mujoco", run_facts(scene.run))
