"""hints(scene): numbers that are likely given in another unit, a line each."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.common.memo import keep_last
from flexlink.describe.plausibility.angles_and_times import of_angles, of_times
from flexlink.describe.plausibility.loads import of_bodies, of_gravity, of_joints, of_loads, of_places
from flexlink.describe.plausibility.sensors import of_sensors
from flexlink.describe.plausibility.situation import situation_of
from flexlink.describe.plausibility.sizes import of_materials, of_sections
from flexlink.describe.scene import Scene


@keep_last(64)
def hints(scene: Scene) -> tuple[str, ...]:
    """Numbers that are likely mistaken by a factor of units, each with what is plausible and the likely unit.

    Never an error: arithmetic on what the scene says, nothing is built or solved. A unit is found by ranges of
    materials, slenderness, sizes beside the arm's own, strains under its load; angles in radians by their digits.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    tuple of str
        One line each, empty if there is nothing to say.
    """
    try:
        return tuple(_hints(scene))
    except ArithmeticError:  # numbers beyond float64 are refused where the chain is made of them
        return ()


def _hints(scene: Scene) -> Iterator[str]:
    arm, about = scene.arm, situation_of(scene)
    causes = [*of_materials(arm), *of_sections(arm), *of_gravity(scene), *of_places(scene, about)]
    yield from causes
    yield from of_bodies(scene, about)
    yield from of_angles(scene)
    yield from of_times(scene, about)
    yield from of_sensors(scene)
    if not causes:  # what follows from a mistaken number is mistaken, too
        loads = list(of_loads(scene, about))
        yield from loads or of_joints(scene, about)
