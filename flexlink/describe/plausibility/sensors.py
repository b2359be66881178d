"""Hints on strain gauges outside their section, delays in milliseconds, and resolutions in degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator

from flexlink.common.wording import Diagnostic
from flexlink.describe.plausibility.ranges import hint_if_outside
from flexlink.describe.plausibility.sizes import largest_dimension
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names


def of_sensors(scene: Scene) -> Iterator[Diagnostic]:
    """Hints on gauges far outside their link's section, on delays, and on resolutions of joint angles."""
    arm = scene.arm
    for sensor in scene.sensor:
        path = f"sensor.{sensor.name}"
        yield from hint_if_outside(f"{path}.delay", sensor.delay, "delay", sensor.delay)
        if sensor.resolution is not None and column_names((sensor,), arm) == (f"{sensor.name} [rad]",):
            yield from hint_if_outside(f"{path}.resolution", sensor.resolution, "resolution", sensor.resolution)
        if sensor.fibre is None:
            continue
        section = arm.sections.get(arm.links[arm.number(sensor.link) - 1].section or "")
        if section is not None:
            part = math.hypot(*sensor.fibre) / (largest_dimension(section)[1] / 2)
            yield from hint_if_outside(f"{path}.fibre", sensor.fibre, "fibre", part)
