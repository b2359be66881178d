"""Positions of a robot's joints: check given positions, and compute all others."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import ArgumentError
from flexlink.common.wording import truncated
from flexlink.describe.spec import to_builtin
from flexlink.robots.kinematic_tree import Robot, TreeJoint


def positions_of(robot: Robot, stated: Mapping[str, float]) -> dict[str, float]:
    """Return the position of every joint; by default 0, or the middle of the limits if they exclude 0."""
    leaders = dict(stated)
    for joint in robot.joints.values():
        if joint.limits is not None and joint.mimic is None and joint.name not in leaders:
            lower, upper = joint.limits
            leaders[joint.name] = 0.0 if lower <= 0 <= upper or lower > upper else (lower + upper) / 2
    return {joint.name: robot.position(joint, leaders) for joint in robot.joints.values()}


def check_stated(robot: Robot, posture: Mapping[str, float], locked: Mapping[str, float]) -> None:
    """Check that the given positions are within the limits and belong to joints that have a position.

    Raises
    ------
    ArgumentError
        A position is invalid; the message names the joint, its value and the allowed range.
    """
    for key, stated in (("posture", posture), ("locked", locked)):
        for name, value in stated.items():
            _check(robot, key, name, value)
    for name in locked:
        if name in posture:
            raise ArgumentError(
                f"joint {truncated(name)}: in posture and in locked; remove it from posture", id="both-given"
            )


def finite(value: object) -> float | None:
    """Return a finite NumPy or Python number as float; None for anything else."""
    number = to_builtin(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return None
    return float(number) if math.isfinite(number) else None


def _check(robot: Robot, key: str, name: object, value: object) -> None:
    joint = require_one_of(key, name, robot.joints)
    if joint.kind in {"fixed", "floating", "planar"}:
        raise ArgumentError(
            f"{key}: joint {truncated(name)} is {joint.kind}; only hinges and slides have a position",
            id="joint-type-in-file",
        )
    if joint.mimic is not None and key == "posture":
        raise ArgumentError(
            f"{key}: joint {truncated(name)} mimics {truncated(joint.mimic.leader)}; give the position of that joint",
            id="mimic",
        )
    number = finite(value)
    if number is None:
        raise ArgumentError(
            f"{key}: {truncated(name)} = {truncated(value)}: expected a finite number [rad; m for a slide]",
            id="out-of-range",
        )
    lower, upper = joint.limits or (-math.inf, math.inf)
    if not lower <= number <= upper and lower < upper:
        given, low, high = (_with_unit(joint, position) for position in (number, lower, upper))
        raise ArgumentError(f"{key}: {truncated(name)} = {given}: must be between {low} and {high}", id="out-of-range")


def _with_unit(joint: TreeJoint, position: float) -> str:
    """Format a position with its unit; positions of hinges also in degrees, as on the command line."""
    return f"{position!r} rad ({math.degrees(position):.6g}°)" if joint.turns else f"{position!r} m"
