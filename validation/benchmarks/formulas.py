"""Torques and motions that a benchmark gives by a formula, as tables fine enough to be exact beside its limit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexlink.describe.scene import Scene
from flexlink.describe.situation import Drive, Motion


def torque_pulse(scene: Scene, knots: int = 241) -> Scene:
    """T = 4 sin³(2πt / 1.2 s) N m for 1.2 s at the first joint; the spline errs by (5 ms)⁴/384 · max|T⁗|, 1e-7 N m."""
    t = np.linspace(0, 1.2, knots)
    torque = 4 * np.sin(2 * np.pi * t / 1.2) ** 3
    torque[-1] = 0.0
    drive = Drive(kind="table", smooth=True, times=tuple(t.tolist()), torques=tuple((x,) for x in torque.tolist()))
    return scene.varied({"drive": drive})


def spin_up(scene: Scene, knots: int = 151) -> Scene:
    """θ = (6/15) [t²/2 + (15/2π)² (cos(2πt/15) − 1)] for 15 s, then 6 rad/s (Kane, Ryan & Banerjee 1987).

    Quintic pieces of 0.1 s follow it to (0.05)⁶/720 · max|θ⁽⁶⁾|, 3e-13 rad.
    """
    t = np.linspace(0, 15, knots)
    ω = 2 * np.pi / 15
    angle = 6 / 15 * (t**2 / 2 + (np.cos(ω * t) - 1) / ω**2)
    rate = 6 / 15 * (t - np.sin(ω * t) / ω)
    acceleration = 6 / 15 * (1 - np.cos(ω * t))
    columns = [tuple(np.degrees(column).tolist()) for column in (angle, rate, acceleration)]
    motion = Motion(
        link=scene.arm.links[0].name, times=tuple(t.tolist()), angle_deg=columns[0], rate_deg=columns[1],
        acceleration_deg=columns[2],
    )  # fmt: skip
    return scene.varied({"motion": [motion]})


def nothing(scene: Scene) -> Scene:
    """No input."""
    return scene


INPUTS: dict[str, Callable[[Scene], Scene]] = {"none": nothing, "torque_pulse": torque_pulse, "spin_up": spin_up}
