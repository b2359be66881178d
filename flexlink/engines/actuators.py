"""What a scene's drive asks of its joints, as a record of actuators, and what of a file's actuators it leaves open."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.describe.scene import Scene
from flexlink.engines.read_back import ACTUATORS, Array, Indices, ReadBack, no_actuators
from flexlink.inputs.drives import effort_of, of_joints

SERVO = ("servo_stiffness", "servo_damping", "push")
OPEN = frozenset({"control"})
"""What a scene without a drive does not say."""


def with_drive(read: ReadBack, scene: Scene | None, chain: Chain) -> ReadBack:
    """The record of a chain with its scene's drive: motors whose command is the torque, gains of a PD drive, limits."""
    fields: dict[str, Any] = no_actuators(chain.n)
    joints = chain.active
    fields["control"][joints] = 1.0
    asked = np.zeros((chain.n, 2))
    if scene is None or scene.drive.kind == "none":
        return dataclasses.replace(read, **fields, asked=asked, unsaid=read.unsaid | OPEN)
    if scene.drive.kind == "pd":
        fields["servo_stiffness"][joints] = of_joints(chain, scene.drive.kp)
        fields["servo_damping"][joints] = of_joints(chain, scene.drive.kd)
    effort = effort_of(scene, chain)
    fields["effort"][joints] = np.stack([-effort, effort], axis=1)
    asked[joints] = _asked(scene, chain)
    return dataclasses.replace(read, **fields, asked=asked)


def _asked(scene: Scene, chain: Chain) -> Array:
    """Least and largest torque of every driven joint, before limits; of laws, and between smooth rows, any."""
    drive = scene.drive
    rows = drive.torques or ((drive.torque,) if drive.torque else ())
    if not rows or drive.smooth:
        return np.tile([-np.inf, np.inf], (len(chain.active), 1))
    torques = np.array([of_joints(chain, row) for row in rows])
    return np.stack([np.minimum(torques.min(axis=0), 0), np.maximum(torques.max(axis=0), 0)], axis=1)


def said(read: ReadBack) -> ReadBack:
    """The record of a file, and in `unsaid` what its actuators leave open: all, a law of their own, limits."""
    servo = any(getattr(read, field).any() for field in SERVO)
    open_ends = {"control"} if not read.control.any() else set()
    open_ends |= set() if servo else set(SERVO)
    open_ends |= set() if np.isfinite(read.effort).any() else {"effort"}
    return dataclasses.replace(read, unsaid=read.unsaid | open_ends)


def taken_from_scene(ours: ReadBack, read: ReadBack) -> frozenset[str]:
    """Fields of actuators that a file leaves open and the scene does not."""
    nothing = no_actuators(ours.n)
    return frozenset(
        field
        for field in ACTUATORS
        if field in read.unsaid - ours.unsaid and not np.array_equal(getattr(ours, field), nothing[field])
    )


def not_compared(ours: ReadBack, read: ReadBack, order: Indices) -> str:
    """In words, what a file's actuators are beside a scene without a drive; nothing of plain motors at its joints.

    `order` are our joints among those of the file.
    """
    if "control" not in ours.unsaid:
        return ""
    control, effort, told = read.control[order], read.effort[order], []
    everywhere = bool((control == 1).all())  # motors that a format gives to every joint say nothing
    geared = np.flatnonzero((control != 0) & (control != ours.control) & (not everywhere))
    if len(geared):
        told.append("motors at " + _listed([f"{ours.names[k]!r} (gear {control[k]:g})" for k in geared]))
    limited = np.flatnonzero(np.isfinite(effort).any(axis=1))
    if len(limited):
        told.append("torque limits at " + _listed([f"{ours.names[k]!r} ({limits(effort[k])})" for k in limited]))
    return "; ".join(told)


def limits(effort: Array) -> str:
    """Least and largest torque in words."""
    least, most = effort.tolist()
    if np.isinf([least, most]).all():
        return "none"
    return f"±{most:.6g} N m" if least == -most else f"{least:.6g} … {most:.6g} N m"


def _listed(parts: list[str]) -> str:
    return ", ".join(parts[:3]) + (f" and {len(parts) - 3} more" if len(parts) > 3 else "")
