"""Characteristic length of a chain, which is never 0, even for a cart, a wheel, or a motor and its gear.

    L = max |r|                    reach: largest distance of any mass from the origin, with sliding joints at limits
    L = √(max J / Σ m)             if the reach is 0; J is the largest inertia or rotor that turns
    L = 1 m                        if this is also 0: a cart, a motor without mass

Some revolute joints have no lever, because no point moves when they turn: a wheel, the last wrist of many robots. An
angle error there causes no position error. It is converted to a length by the factor L if no joint has a lever,
otherwise by the radius of gyration

    ρ = √(J / m)                   J inertia about the joint's axis, m mass of the part beyond it; L if ρ is 0

A motor on an elastic gear turns against its spring, so no point moves immediately either. But an angle error of its
rotor, of inertia J_r, soon moves the part beyond, by its share of the momentum. The factor is then ρ J_r / (J_r + J).
"""

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexlink.common.products import cross
from flexlink.common.types import Array, Indices
from flexlink.kernels.geometry.kinematics import KinematicsWork, forward_kinematics
from flexlink.kernels.layout import SLIDES, ChainArrays

NEARLY = 1e-9
"""Points closer to an axis than this, relative to the size, count as on the axis, because of rounding."""


def size_without_reach(bodies: NDArray[np.void], hinges: NDArray[np.void]) -> float:
    """√(max J / Σ m) [m], or 1 m if there is no mass or no inertia."""
    mass = float(bodies["mass"].sum())
    rotors = np.abs(hinges["armature"][hinges["axis"] < SLIDES])
    largest = max(float(np.linalg.eigvalsh(bodies["inertia"]).max()), float(rotors.max(initial=0.0)))
    return math.sqrt(largest / mass) if mass > 0 and largest > 0 else 1.0


def without_lever(arrays: ChainArrays, reach: float, anywhere: Callable[[], KinematicsWork]) -> Indices:
    """Indices of revolute joints that move no hinge point or tip in any configuration.

    If a joint has a lever, so does every joint before it, because the point moves on a circle, which lies on no axis.
    For most arms the outermost joints therefore decide, and `anywhere`, which returns `at_any_posture`, is not called.
    """
    passes = (arrays.hinges["axis"] >= SLIDES).tolist()
    if reach == 0 or all(passes):
        return np.flatnonzero(np.logical_not(passes))
    first, stop, parent = (arrays.bodies[name].tolist() for name in ("first", "stop", "parent"))
    for k in range(len(passes) - 1, -1, -1):
        if passes[k]:
            continue
        body = bisect_right(stop, k)
        if not _offset_of_next(arrays, k, body) > 2 * NEARLY * reach:
            e, points = anywhere().axes[k].tolist(), anywhere().points.tolist()
            if max(_lever(e, points[body], points[each]) for each in _beyond(parent, body)) <= NEARLY * reach:
                continue
        passes[first[body] : k + 1] = [True] * (k + 1 - first[body])
        while (body := parent[body] - 1) >= 0:
            passes[first[body] : stop[body]] = [True] * (stop[body] - first[body])
    return np.flatnonzero(np.logical_not(passes))


def _offset_of_next(arrays: ChainArrays, k: int, body: int) -> float:
    """Distance of the next body from joint `k`'s axis if it follows `body` directly, with no joint between; else 0."""
    if arrays.bodies["stop"][body] != k + 1 or arrays.bodies["parent"][body + 1] != body + 1:
        return 0.0
    offset: list[float] = arrays.bodies["translation"][body + 1].tolist()
    return max(abs(x) for i, x in enumerate(offset) if i != arrays.hinges["axis"][k])


def _lever(e: list[float], a: list[float], b: list[float]) -> float:
    """Largest component of e × (b − a)."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return max(abs(e[1] * z - e[2] * y), abs(e[2] * x - e[0] * z), abs(e[0] * y - e[1] * x))


def on_elastic_gears(arrays: ChainArrays) -> Indices:
    """Indices of joints whose rotor is in series with a spring about the same axis through the same point."""
    bodies, hinges = arrays.bodies, arrays.hinges
    if not np.count_nonzero(hinges["armature"]):
        return np.empty(0, np.intp)
    inner, outer = hinges[:-1], hinges[1:]
    sprung = (inner["stiffness"] == 0) & (outer["stiffness"] > 0) & (inner["armature"] > 0)
    found = np.flatnonzero(sprung & (inner["axis"] == outer["axis"]) & (inner["axis"] < SLIDES))
    if not len(found):
        return found
    moved = bodies["translation"].any(axis=1) | (bodies["turned"] != 0) | (bodies["begins"] != 0)  # from its parent
    rotor, spring = np.searchsorted(bodies["stop"], [found, found + 1], side="right")  # indices of their bodies
    return np.asarray(found[(rotor == spring) | ~moved[spring]])


def turning_radii(arrays: ChainArrays, free: Indices, motors: Indices, size: float, placed: KinematicsWork) -> Array:
    """ρ of joints without lever and of motors on elastic gears [m], 0 for others, (n,), at a configuration `placed`."""
    radii = np.zeros(len(arrays.hinges))
    for k in motors:
        J, m = _inertia_beyond(arrays, placed, k)
        rotor = float(arrays.hinges["armature"][k])
        radii[k] = math.sqrt(J / m) * rotor / (rotor + J) if m > 0 else 0.0
    for k in free:
        J, m = _inertia_beyond(arrays, placed, k)
        radii[k] = math.sqrt(J / m) if J > 0 and m > 0 else size
    return radii


def _inertia_beyond(arrays: ChainArrays, placed: KinematicsWork, k: int) -> tuple[float, float]:
    """Inertia about the axis of joint `k` [kg m²] and mass [kg] of everything that moves with it."""
    bodies = arrays.bodies
    body = int(np.searchsorted(bodies["stop"], k, side="right"))
    beyond = np.array(_beyond(bodies["parent"].tolist(), body))
    mass, R, e = bodies["mass"][beyond], placed.rotations[beyond], placed.axes[k]
    centers = placed.points[beyond] + np.einsum("bij,bj->bi", R, bodies["center"][beyond]) - placed.points[body]
    axes = np.einsum("bij,j->bi", R.transpose(0, 2, 1), e)
    J = np.einsum("bi,bij,bj->", axes, bodies["inertia"][beyond], axes) + mass @ (cross(e, centers) ** 2).sum(axis=1)
    return float(J), float(mass.sum())


def at_any_posture(arrays: ChainArrays, length: float) -> KinematicsWork:
    """Kinematics at a generic configuration, in which no angle is zero or a right angle."""
    q: Array = np.where(arrays.hinges["axis"] < SLIDES, 0.7, 0.7 * length) * (1 + np.arange(len(arrays.hinges))) ** 0.5
    placed: KinematicsWork = forward_kinematics(arrays, q)
    return placed


def _beyond(parent: list[int], body: int) -> list[int]:
    """Indices of the bodies that move with `body`, including itself; `parent` has numbers from 1."""
    moves = {body}
    for i in range(body + 1, len(parent)):
        if parent[i] - 1 in moves:
            moves.add(i)
    return sorted(moves)
