"""Describe a scene's drive as an actuator record, and find the actuator fields that a file does not specify."""

import dataclasses
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene
from flexlink.engines.read_back import ACTUATOR_FIELDS, ReadBack, no_actuators
from flexlink.motion.inputs.drives import effort_of, of_joints


def with_drive(read: ReadBack, scene: Scene | None, chain: Chain) -> ReadBack:
    """Add a scene's drive to the record of its chain: motors with gear 1, gains of a PD drive, torque limits."""
    fields: dict[str, Any] = no_actuators(chain.n)
    joints = chain.active
    fields["gear"][joints] = 1.0
    drive_range = np.zeros((chain.n, 2))
    if scene is None or scene.drive.kind == "none":
        return dataclasses.replace(read, **fields, drive_range=drive_range, unspecified=read.unspecified | {"gear"})
    if scene.drive.kind == "pd":
        fields["servo_stiffness"][joints] = of_joints(chain, scene.drive.kp)
        fields["servo_damping"][joints] = of_joints(chain, scene.drive.kd)
    effort = effort_of(scene, chain)
    fields["effort"][joints] = np.stack([-effort, effort], axis=1)
    drive_range[joints] = _drive_range(scene, chain)
    return dataclasses.replace(read, **fields, drive_range=drive_range)


def _drive_range(scene: Scene, chain: Chain) -> Array:
    """Smallest and largest commanded torque, or 0, of all driven joints; ±inf for controllers and smooth tables."""
    drive = scene.drive
    rows = drive.torques or ((drive.torque,) if drive.torque else ())
    if not rows or drive.smooth or drive.controls:
        return np.tile([-np.inf, np.inf], (len(chain.active), 1))
    torques = np.array([of_joints(chain, row) for row in rows])
    return np.stack([np.minimum(torques.min(axis=0), 0), np.maximum(torques.max(axis=0), 0)], axis=1)


def mark_unspecified(read: ReadBack) -> ReadBack:
    """Add to `unspecified` the fields that no actuator of a file specifies: gear, servo, torque limit."""
    servo = ("servo_stiffness", "servo_damping", "constant_torque")
    unspecified = set() if read.gear.any() else {"gear"}
    unspecified |= set() if any(getattr(read, field).any() for field in servo) else set(servo)
    unspecified |= set() if np.isfinite(read.effort).any() else {"effort"}
    return dataclasses.replace(read, unspecified=read.unspecified | unspecified)


def taken_from_scene(ours: ReadBack, read: ReadBack) -> frozenset[str]:
    """Actuator fields that the scene specifies but the file does not."""
    nothing = no_actuators(ours.n)
    given = {field for field in ACTUATOR_FIELDS if not np.array_equal(getattr(ours, field), nothing[field])}
    return (read.unspecified - ours.unspecified) & given


def not_compared(ours: ReadBack, read: ReadBack, order: Indices) -> str:
    """Describe a file's actuators, by joints in flexlink's `order`, if the scene has no drive; "" if plain motors."""
    if "gear" not in ours.unspecified:
        return ""
    gear, effort, actuators = read.gear[order], read.effort[order], []
    plain = bool((gear == 1).all())  # some file formats put a motor at every joint
    geared = np.flatnonzero((gear != 0) & (gear != ours.gear) & (not plain))
    if len(geared):
        actuators.append("motors at " + _listed([f"{ours.names[k]!r} (gear {gear[k]:g})" for k in geared]))
    limited = np.flatnonzero(np.isfinite(effort).any(axis=1))
    if len(limited):
        named = [f"{ours.names[k]!r} ({limits(effort[k], slides=bool(ours.slides[k]))})" for k in limited]
        actuators.append("torque limits at " + _listed(named))
    return "; ".join(actuators)


def limits(effort: Array, *, slides: bool) -> str:
    """Format the smallest and largest torque (force for a prismatic joint) with its unit."""
    (least, most), unit = effort.tolist(), "N" if slides else "N m"
    if np.isinf([least, most]).all():
        return "none"
    return f"±{most:.6g} {unit}" if least == -most else f"{least:.6g} … {most:.6g} {unit}"


def _listed(parts: list[str]) -> str:
    return ", ".join(parts[:3]) + (f" and {len(parts) - 3} more" if len(parts) > 3 else "")
