"""Fit problems in few words, files of measured columns, and the strips that several tests of fits measure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import flexlink as fl


def problem(scene: fl.Scene, paths: Sequence[str], *runs: fl.fits.FitRun, **data: Any) -> fl.fits.FitProblem:
    """The problem of these unknowns and runs; `data` are other measurements and settings."""
    sought = tuple(fl.fits.FitParameter(path=path) for path in paths)
    return fl.fits.FitProblem(scene=scene, parameter=sought, **({"run": runs} if runs else {}), **data)


def write_csv(path: Path, columns: Mapping[str, Sequence[float]]) -> None:
    """Write columns by their heads."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")


def boom(segments: int = 5, **changes: Any) -> fl.Scene:
    """A strip with a mass at its end that a PD controller turns by 8°."""
    strip = fl.Link(name="boom", length=1.0, flex="z", segments=segments, material="steel", section="strip",
                    joint=fl.Joint(armature=0.05))  # fmt: skip
    arm = fl.Arm(links=(strip,), materials={"steel": fl.Material(young=2.1e11, density=7850.0, loss_time=2e-4)},
                 sections={"strip": fl.Section(shape="rectangle", height=0.004, width=0.03)},
                 tip=fl.RigidBody(mass=0.5))  # fmt: skip
    drive = fl.Drive(kind="pd", kp=(40.0,), kd=(4.0,), target_deg=(8.0,))
    run = fl.RunSettings(duration=1.0, sample=0.005)
    return fl.Scene(name="boom", arm=arm, gravity=(0.0, 0.0, 0.0), drive=drive, run=run).varied(changes)


TOGETHER = {"run.method": "RK4", "run.step": 1e-3}
"""Fixed steps of `boom`, with an error of 2e-5 in E: runs of a fit are then computed side by side, in half the time."""

CLAMPED = fl.Scene(
    name="strip", gravity=(0.0, 0.0, 0.0), run=fl.RunSettings(duration=0.2, sample=0.005),
    arm=fl.Arm(
        materials={"steel": fl.Material(young=2.1e11, density=7850.0, loss_time=1e-4)},
        sections={"strip": fl.Section(shape="rectangle", height=0.001, width=0.03)}, tip=fl.RigidBody(mass=0.05),
        links=(fl.Link(name="l", length=0.4, flex="z", segments=5, material="steel", section="strip",
                       joint=fl.Joint(locked=True), root_stiffness={"z": 20.0}),),
    ),
)  # fmt: skip
"""A strip on a spring, at rest."""
