"""Gauges that are not on their section, delays in milliseconds."""

from __future__ import annotations

import math
from collections.abc import Iterator

from flexlink.describe.plausibility.ranges import told
from flexlink.describe.plausibility.sizes import largest_dimension
from flexlink.describe.scene import Scene


def of_sensors(scene: Scene) -> Iterator[str]:
    """Fibres of gauges beside the sections of their links, and delays."""
    arm = scene.arm
    for sensor in scene.sensor:
        path = f"sensor.{sensor.name}"
        yield from told(f"{path}.delay", sensor.delay, "delay", sensor.delay)
        if sensor.fibre is None:
            continue
        section = arm.sections.get(arm.links[arm.number(sensor.link) - 1].section or "")
        if section is not None:
            part = math.hypot(*sensor.fibre) / (largest_dimension(section)[1] / 2)
            yield from told(f"{path}.fibre", sensor.fibre, "fibre", part)
