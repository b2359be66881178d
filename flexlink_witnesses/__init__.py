"""Adapters of Drake and Exudyn, further witnesses beside Pinocchio and MuJoCo: an engine needs no place in the library.

`flexlink.engines.ENGINES` names their modules, as it can name those of other packages.
"""

from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene


def refuse_sampled_inputs(engine: str, scene: Scene) -> None:
    """Refuse inputs that engines with their own time stepping do not support; their runs always start at t = 0."""
    unsupported = [f"{name}.hold = True" for name in ("drive", "wrench") if getattr(scene, name).hold]
    unsupported += [] if scene.drive.rate is None else [f"drive.rate = {scene.drive.rate!r}"]
    if (course := scene.course) is not None and (scene.drive.kind != "pd" or course.jumps.size):
        unsupported.append("drive.reference with jumps in its derivatives")
    unsupported += [f"initial.time = {scene.initial.time!r}"] if scene.initial.time else []
    if unsupported:
        why = f"{unsupported[0]}: not supported by {engine}; use native, pinocchio or mujoco"
        raise ArgumentError(why, id="engine-does-not-support")
