"""The driven link by its exact clamped modes: on a rotating hub, to second order in its bending, or in a floating frame.

The torque can be scaled: at a small torque, the beam on a hub with many modes is the reference, and with m modes it
states the error that m modes must have.
"""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.polynomial.legendre import leggauss

from flexlink.common.types import Array
from validation.formulations.task import Task
from validation.oracles import floating_frame, hub_beam

FINER = 200  # steps a sample; the torque is constant within a step, which moves the tip by 3e-7 of its way
POINTS = 4  # of Gauss' rule for the mean torque of a step


def scaled(task: Task, factor: float) -> Task:
    """The task with `factor` times its torque."""
    torque, drive = task.torque, task.scene.drive
    assert torque is not None
    torques = tuple(tuple(factor * one for one in row) for row in drive.torques or ())
    scene = task.scene.varied({"drive": msgspec.structs.replace(drive, torques=torques)})
    return task._replace(scene=scene, torque=lambda t: factor * torque(t))


def on_a_hub(task: Task, count: int) -> Array:
    """Tip in frame 0 of the beam on a hub, with `count` modes."""
    assert task.torque is not None
    times = task.times
    step = float(times[1] - times[0]) / FINER
    begins = step * np.arange(FINER * (len(times) - 1))
    x, weights = leggauss(POINTS)
    means = [
        sum(w / 2 * task.torque(begin + (1 + at) / 2 * step) for at, w in zip(x.tolist(), weights.tolist(), strict=True))
        for begin in begins.tolist()
    ]
    drive = hub_beam.Drive(jumps=tuple(begins.tolist()), torques=tuple(means))
    motion = hub_beam.simulate(_beam(task), drive, times, count=count, finer=FINER)
    return np.asarray(motion.tip() @ task.axes[:, :2].T)


def in_a_frame(task: Task, count: int) -> Array:
    """Tip in frame 0 of the link in a floating frame, with `count` linear modes."""
    assert task.torque is not None
    return np.asarray(floating_frame.tip(_beam(task), task.torque, task.times, count) @ task.axes[:, :2].T)


def _beam(task: Task) -> hub_beam.Beam:
    (rod,) = task.rods
    return hub_beam.Beam(rod.length, rod.bending[1], rod.mass, tip_mass=task.payload, hub=task.rotor)
