"""hints(scene): reports numbers that were likely given in another unit, one line each."""

from __future__ import annotations

import math
from collections.abc import Iterator

from flexlink.common.errors import Diagnostic
from flexlink.common.memo import keep_last
from flexlink.describe.plausibility.angles_and_times import of_angles, of_times
from flexlink.describe.plausibility.loads import of_bodies, of_gravity, of_joints, of_loads, of_places
from flexlink.describe.plausibility.ranges import hint_if_outside
from flexlink.describe.plausibility.situation import situation_of
from flexlink.describe.plausibility.sizes import largest_dimension, of_materials, of_sections
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names


@keep_last(64)
def hints(scene: Scene) -> tuple[Diagnostic, ...]:
    """Find numbers that were probably given in another unit, each with plausible values and the likely unit.

    It never raises, and only does arithmetic on the scene's numbers, without lumping. Units are inferred from ranges of
    material properties, slenderness, sizes relative to the arm, strains under its load, and the digits of angles.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    tuple of Diagnostic
        One line each; empty if all numbers are plausible.
    """
    try:
        return tuple(_hints(scene))
    except ArithmeticError:  # overflow is refused when the chain is built
        return ()


def _hints(scene: Scene) -> Iterator[Diagnostic]:
    arm, about = scene.arm, situation_of(scene)
    causes = [*of_materials(arm), *of_sections(arm), *of_gravity(scene), *of_places(scene, about)]
    yield from causes
    yield from of_bodies(scene, about)
    yield from of_angles(scene)
    yield from of_times(scene, about)
    yield from of_sensors(scene)
    if not causes:  # these hints depend on the numbers checked above
        loads = list(of_loads(scene, about))
        yield from loads or of_joints(scene, about)


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
