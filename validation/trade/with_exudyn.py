"""Exudyn's integrators at fixed steps on the exported URDF.

Scenes with a drive, dry friction or load are excluded, since Exudyn would call Python for them. A run is one call, in
which Exudyn stores the outputs. The time of a call with a single step is subtracted from it, as set-up.
"""

from __future__ import annotations

import time

import exudyn as exu
import numpy as np
from exudyn.itemInterface import SensorNode

from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.initial_state import initial_state
from flexlink_witnesses.exudyn import ExudynEngine, _settings
from validation.trade.contestants import stepped
from validation.trade.work_precision import Point, Run

SOLVERS = {
    "GeneralizedAlpha": exu.DynamicSolverType.GeneralizedAlpha,
    "TrapezoidalIndex2": exu.DynamicSolverType.TrapezoidalIndex2,
    "RK44": exu.DynamicSolverType.RK44,
}


def points(name: str, scene: Scene, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators with finer and finer steps; RK44 is only timed if stable steps exceed the budget."""
    return stepped(name, Exudyn(scene), SOLVERS, budget, smallest)


class Exudyn:
    """A scene in Exudyn, with a sensor of its angles."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.chain = scene, lump(scene)
        self.start, self.system = initial_state(scene, self.chain), ExudynEngine(self.chain)._whole
        self.system.load(np.zeros(self.chain.n), None)
        angles = exu.OutputVariableType.Coordinates
        self.sensor = self.system.mbs.AddSensor(SensorNode(nodeNumber=0, storeInternal=True, outputVariableType=angles))
        self.system.mbs.Assemble()
        self.setting_up = 0.0
        self.setting_up = min(self._seconds("RK44", 1e-9, 1)[0] for _ in range(3))

    def run(self, solver: str, steps: float) -> Run:
        """Run with `steps` steps between samples."""
        run, number = self.scene.run, round(steps * (self.scene.run.samples - 1))
        seconds, good = self._seconds(solver, run.spacing / steps, number)
        stored = np.array(self.system.mbs.GetSensorStoredData(self.sensor))
        rows = [int(np.abs(stored[:, 0] - t).argmin()) for t in run.times]
        if not good or np.abs(stored[rows, 0] - run.times).max() > 1e-9 * run.duration:
            raise FlexlinkError(f"{self.scene.name}: Exudyn's {solver} gives up with {steps:g} steps between samples")
        of_a_step = 4 if solver == "RK44" else 1  # 1: Exudyn does not report implicit methods' iterations
        return Run(stored[rows, 1:], seconds, of_a_step * number)

    def seconds_a_step(self, solver: str, steps_per_sample: int) -> float:
        """CPU seconds per step, from the first steps of a run."""
        steps = 200  # long enough for the clock's resolution
        return self._seconds(solver, self.scene.run.spacing / steps_per_sample, steps)[0] / steps

    def _seconds(self, solver: str, step: float, steps: int) -> tuple[float, bool]:
        """CPU seconds of a run, and whether Exudyn completed it."""
        self.system._set_state(*self.start, exu.ConfigurationType.Initial)
        settings, early = _settings(), (1 - 1e-6) * self.scene.run.spacing  # rounding must not skip an output
        settings.solution.sensors.active, settings.solution.sensors.writePeriod = True, early
        settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = step * steps, steps
        begun = time.thread_time()
        try:
            good = bool(self.system.mbs.SolveDynamic(settings, solverType=SOLVERS[solver]))
        except Exception:  # Exudyn raises various types; any of them means no result
            good = False
        seconds = time.thread_time() - begun
        return max(seconds - self.setting_up, 1e-9), good
