"""Where the joints of a robot are: what is stated of them, and what follows for the others."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flexlink.common.errors import ArgumentError
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.spec import to_builtin
from flexlink.robots.kinematic_tree import Robot, TreeJoint


def positions_of(robot: Robot, stated: Mapping[str, float]) -> dict[str, float]:
    """Of every joint; what is not stated is 0, or in the middle of limits that exclude 0."""
    leaders = dict(stated)
    for joint in robot.joints.values():
        if joint.limits is not None and joint.mimic is None and joint.name not in leaders:
            lower, upper = joint.limits
            leaders[joint.name] = 0.0 if lower <= 0 <= upper else (lower + upper) / 2
    return {joint.name: robot.position(joint, leaders) for joint in robot.joints.values()}


def check_stated(robot: Robot, posture: Mapping[str, float], locked: Mapping[str, float]) -> None:
    """Positions that a user states are of joints that have one, and within their limits.

    Raises
    ------
    ArgumentError
        The message names the joint, its value and what is allowed.
    """
    for key, stated in (("posture", posture), ("locked", locked)):
        for name, value in stated.items():
            _check(robot, key, name, value)
    for name in locked:
        if name in posture:
            raise ArgumentError(
                f"joint {truncated(name)}: is in posture and in locked; leave it out of posture", id="both-given"
            )


def known(key: str, name: object, names: Mapping[str, object]) -> str:
    """A name that is among some.

    Raises
    ------
    ArgumentError
        It is not.
    """
    if not isinstance(name, str) or name not in names:
        allowed = f"{short_list(list(names))}{did_you_mean(name, names)}"
        raise ArgumentError(f"{key} = {truncated(name)}: unknown; allowed are {allowed}", id="unknown-name")
    return name


def finite(value: object) -> float | None:
    """A number, NumPy's or Python's, that is finite; None for anything else."""
    number = to_builtin(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return None
    return float(number) if math.isfinite(number) else None


def _check(robot: Robot, key: str, name: object, value: object) -> None:
    joint = robot.joints[known(key, name, robot.joints)]
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
        given, low, high = (_said(joint, position) for position in (number, lower, upper))
        raise ArgumentError(f"{key}: {truncated(name)} = {given}: must be between {low} and {high}", id="out-of-range")


def _said(joint: TreeJoint, position: float) -> str:
    """A position with its unit, of a hinge in degrees, too, in which the command line takes it."""
    return f"{position!r} rad ({math.degrees(position):.6g}°)" if joint.turns else f"{position!r} m"
