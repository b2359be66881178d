"""The driven link by its exact clamped modes: on a rotating hub, or in a floating frame.

The hub's equations hold to second order in the bending. At a small torque, they are the reference with many modes, and
with m modes they state the error that m modes must have.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.polynomial.legendre import leggauss

from flexlink.common.types import Array
from validation.formulations.task import Task
from validation.oracles import floating_frame, hub_beam

FINER = 200  # steps a sample; the torque is constant within a step, which moves the tip by 3e-7 of its way
POINTS = 2  # of Gauss' rule for the mean torque of a step


def scaled(task: Task, factor: float) -> Task:
    """The task with `factor` times its torque."""
    torque, drive = task.torque, task.scene.drive
    assert torque is not None
    torques = tuple(tuple(factor * one for one in row) for row in drive.torques or ())
    scene = task.scene.varied({"drive": msgspec.structs.replace(drive, torques=torques)})
    return task._replace(scene=scene, torque=functools.partial(_times, factor, torque))


def _times(factor: float, torque: Callable[[float], float], t: float) -> float:
    return factor * torque(t)


def on_a_hub(task: Task, count: int) -> Array:
    """Tip in frame 0 of the beam on a hub, with `count` modes."""
    assert task.torque is not None
    return np.asarray(hub_tip(_beam(task), task.torque, task.times, count) @ task.axes[:, :2].T)


def hub_tip(beam: hub_beam.Beam, torque: Callable[[float], float], times: Array, count: int) -> Array:
    """Tip of the beam on a hub in the plane of motion."""
    step = float(times[1] - times[0]) / FINER
    begins = step * np.arange(FINER * (len(times) - 1))
    x, weights = leggauss(POINTS)
    means = np.vectorize(torque)(begins[:, None] + (1 + x) / 2 * step) @ weights / 2
    drive = hub_beam.Drive(jumps=tuple(begins.tolist()), torques=tuple(means.tolist()))
    return hub_beam.simulate(beam, drive, times, count=count, finer=FINER).tip()


def in_a_frame(task: Task, count: int) -> Array:
    """Tip in frame 0 of the link in a floating frame, with `count` linear modes."""
    assert task.torque is not None
    return np.asarray(floating_frame.tip(_beam(task), task.torque, task.times, count) @ task.axes[:, :2].T)


def _beam(task: Task) -> hub_beam.Beam:
    (rod,) = task.rods
    return hub_beam.Beam(rod.length, rod.bending[1], rod.mass, tip_mass=task.payload, hub=task.rotor)
