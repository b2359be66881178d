"""Joints that mimic a free joint: on a fixed base they are inertia and friction of their leader.

A follower moves by k q̇ if its leader moves by q̇. A rigid body on it adds k² J to the inertia of the leader, where J is
its inertia about the axis (or its mass), k² d to viscous and |k| c to dry friction; exact except for its weight.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping

import numpy as np

from flexlink.chain.rigid import SpatialInertia
from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
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
        kg, newton = ("kg m²", "N m") if leader.turns else ("kg", "N")
        weight = abs(k) * _weight(joint, body, R.T @ np.array(gravity))
        text = f"{name}: mimics {leader.name}, whose armature has its inertia, {inertia:.4g} {kg}"
        # 1e-12 N: right angles of a file are rounded
        lost = f"; its weight, up to {weight:.4g} {newton} there, is left out" if weight > 1e-12 else ""
        lines.append(Diagnostic(text + lost, "mimic-weight" if lost else "mimic-carried"))
    return dataclasses.replace(way, parts=tuple(parts.values())), rotors, lines


def _rules(robot: Robot, way: Paths, locked: Collection[str]) -> dict[str, Mimic]:
    """Rules of the joints that mimic a free joint; with a free base, only of those beyond the base."""
    free = {part.joint.name for part in way.parts}
    reached = set(robot.outward(robot.root if way.free_base is None else way.base))
    joints = [joint for joint in robot.joints.values() if joint.parent in reached and joint.moves]
    rules = {joint.name: robot.rule(joint, locked) for joint in joints if joint.name not in {*free, *locked}}
    return {name: rule for name, rule in rules.items() if rule.leader in free}


def _weight(joint: TreeJoint, body: SpatialInertia, gravity: Array) -> float:
    """Largest torque [N m] of a body's weight about a hinge, or its force [N] along a slide."""
    if joint.turns:
        return body.mass * math.hypot(*np.cross(joint.axis, body.center)) * math.hypot(*np.cross(joint.axis, gravity))
    return body.mass * abs(float(joint.axis @ gravity))
