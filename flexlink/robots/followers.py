"""Joints that mimic a free joint: on a fixed base they are inertia and friction of their leader.

A follower moves by k q̇ if its leader moves by q̇. A rigid body on it adds k² J to the inertia of the leader, where J is
its inertia about the axis (or its mass), k² d to viscous and |k| c to dry friction; exact except for its weight.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping

import numpy as np

from flexlink.common.types import Array
from flexlink.common.wording import Diagnostic
from flexlink.describe.spec import Vector3
from flexlink.robots.flexible import payload
from flexlink.robots.kinematic_tree import Mimic, Robot, TreeJoint
from flexlink.robots.paths import Paths, along, folded


def with_followers(
    robot: Robot, way: Paths, locked: Collection[str], armature: Mapping[str, float], gravity: Vector3
) -> tuple[Paths, dict[str, float], list[Diagnostic]]:
    """Return the paths and the armatures with what followers add to their leaders, and a line on each follower."""
    rules, rotors, lines = _rules(robot, way, locked), dict(armature), []
    parts = {part.joint.name: part for part in way.parts}
    moving = {*rules, *parts}
    fixed = robot.outward(robot.root, moving) if way.free_base is None else []
    for name, rule in rules.items():
        joint, leader, k = robot.joints[name], parts[rule.leader].joint, rule.multiplier
        rigid = robot.outward(joint.child, moving) == robot.outward(joint.child)
        if not rigid or joint.parent not in fixed or not joint.axis.any():
            text = f"{name}: mimics {leader.name}, which moves; here {name} does not"
            lines.append(Diagnostic(text, "mimic-fixed"))
            continue
        body = folded(robot, joint.child, (), way.positions)[0]
        inertia = k * k * (payload(body).about(joint.axis) if joint.turns else body.mass)
        rotors[leader.name] = rotors.get(leader.name, 0.0) + inertia
        damping, friction = leader.damping + k * k * joint.damping, leader.friction + abs(k) * joint.friction
        leader = dataclasses.replace(leader, damping=damping, friction=friction)
        parts[rule.leader] = dataclasses.replace(parts[rule.leader], joint=leader)
        R = along(robot.path(robot.root, joint.child) or [], way.positions).R
        weight = abs(k) * body.mass * _lever(joint, body.center, R.T @ np.array(gravity))
        lines.append(_line(name, leader, inertia, weight))
    return dataclasses.replace(way, parts=tuple(parts.values())), rotors, lines


def _rules(robot: Robot, way: Paths, locked: Collection[str]) -> dict[str, Mimic]:
    """Rules of the joints that mimic a free joint; with a free base, only of those beyond the base."""
    free = {part.joint.name for part in way.parts}
    reached = set(robot.outward(robot.root if way.free_base is None else way.base))
    joints = [joint for joint in robot.joints.values() if joint.parent in reached and joint.moves]
    rules = {joint.name: robot.rule(joint, locked) for joint in joints if joint.name not in {*free, *locked}}
    return {name: rule for name, rule in rules.items() if rule.leader in free}


def _lever(joint: TreeJoint, center: Array, gravity: Array) -> float:
    """Largest torque [N m] about a hinge, or force [N] along a slide, by the weight of 1 kg at this centre."""
    if joint.turns:
        return math.hypot(*np.cross(joint.axis, center)) * math.hypot(*np.cross(joint.axis, gravity))
    return abs(float(joint.axis @ gravity))


def _line(name: str, leader: TreeJoint, inertia: float, weight: float) -> Diagnostic:
    kilograms, newtons = ("kg m²", "N m") if leader.turns else ("kg", "N")
    text = f"{name}: mimics {leader.name}, whose armature has its inertia, {inertia:.4g} {kilograms}"
    rounding = 1e-12  # N; right angles of a file are rounded
    if weight <= rounding:
        return Diagnostic(text, "mimic-carried")
    return Diagnostic(f"{text}; its weight, up to {weight:.4g} {newtons} there, is left out", "mimic-weight")
