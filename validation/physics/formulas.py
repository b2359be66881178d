"""Torques and motions that benchmarks define by formulas, as interpolated tables with negligible error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.actions import PrescribedMotion
from flexlink.describe.drive import Drive
from flexlink.describe.scene import Scene
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.motion.inputs.actuation import motion_arrays
from flexlink.motion.inputs.initial_state import initial_state


def pulse(t: ArrayLike) -> Array:
    """4 sin³(2πt / 1.2 s) N m for 1.2 s, then 0."""
    return np.where(np.asarray(t) < 1.2, 4 * np.sin(2 * np.pi * np.asarray(t) / 1.2) ** 3, 0.0)


def torque_pulse(scene: Scene, knots: int = 241) -> Scene:
    """Apply the torque `pulse` to the first joint; the spline error is (5 ms)⁴/384 · max|T⁗|, 1e-7 N m."""
    t = np.linspace(0, 1.2, knots)
    torque = pulse(t)
    drive = Drive(kind="table", smooth=True, times=tuple(t.tolist()), torques=tuple((x,) for x in torque.tolist()))
    return scene.varied({"drive": drive})


def spin_up_angle(t: ArrayLike) -> tuple[Array, Array, Array]:
    """Angle θ = (6/15) [t²/2 + (15/2π)² (cos(2πt/15) − 1)] for 15 s, then 6 rad/s, with its rate and acceleration.

    Kane, Ryan & Banerjee (1987).
    """
    t, ω = np.asarray(t, dtype=float), 2 * np.pi / 15
    within = np.minimum(t, 15.0)
    angle = 6 / 15 * (within**2 / 2 + (np.cos(ω * within) - 1) / ω**2) + 6 * (t - within)
    rate = 6 / 15 * (within - np.sin(ω * within) / ω)
    return angle, rate, 6 / 15 * (1 - np.cos(ω * within))


def spin_up(scene: Scene, knots: int = 151) -> Scene:
    """Prescribe `spin_up_angle`: quintic pieces of 0.1 s approximate it to (0.05)⁶/720 · max|θ⁽⁶⁾|, 3e-13 rad."""
    t = np.linspace(0, 15, knots)
    columns = [tuple(np.degrees(column).tolist()) for column in spin_up_angle(t)]
    motion = PrescribedMotion(
        link=scene.arm.links[0].name, times=tuple(t.tolist()), angle_deg=columns[0], rate_deg=columns[1],
        acceleration_deg=columns[2],
    )  # fmt: skip
    return scene.varied({"motion": [motion]})


def torques_of_motion(scene: Scene, step: float = 0.02) -> Scene:
    """Replace the scene's prescribed motions by the drive torques that produce these motions in a rigid arm."""
    chain = lump(scene)
    motion = motion_arrays(scene, chain)
    q, qd = initial_state(scene, chain)
    times, torques = np.arange(round(scene.run.duration / step) + 1) * step, []
    for t in times:
        qdd = np.zeros(chain.n)
        follow(motion, t, q, qd, qdd)
        torque = inverse_dynamics(chain, q, qd, qdd, tip_wrench=scene.tip_wrench)
        torques.append(tuple(torques_of_links(scene, chain, torque)))
    drive = Drive(kind="table", smooth=True, times=tuple(times.tolist()), torques=tuple(torques))
    return scene.varied({"motion": (), "drive": drive})


def torques_of_links(scene: Scene, chain: Chain, tau: Array) -> Array:
    """Torques of the active joints, one number per link; 0 for a locked joint."""
    found = np.zeros(len(scene.arm.links))
    for k in chain.active:
        found[chain.coordinate(int(k)).link - 1] = tau[k]
    return found


def nothing(scene: Scene) -> Scene:
    """Return the scene without an input."""
    return scene


INPUTS: dict[str, Callable[[Scene], Scene]] = {
    "none": nothing, "torque_pulse": torque_pulse, "spin_up": spin_up, "torques_of_motion": torques_of_motion,
}  # fmt: skip
