"""A length of a chain that is never 0, where nothing of it reaches out: a cart, a wheel, a motor and its gear alone.

    L = max |r|                    how far from the origin any mass gets, limits of slides included: the reach
    L = √(max J / Σ m)             without a reach, J the largest inertia or rotor that turns
    L = 1 m                        where nothing has length: a cart, a motor without mass

A joint that turns and moves no place has no lever: a wheel, the last wrist of many robots. No place shows an error of
its angle. It counts by the angle times a length: L where no joint has a lever, else a radius of gyration,

    ρ = √(J / m)                   J the inertia about the joint's axis and m the mass of all beyond it; L where 0

A motor on an elastic gear turns against its spring, and no place moves at once either. An error of its rotor J_r moves
what is beyond soon after, by its share of the momentum. It counts by ρ J_r / (J_r + J).
"""

from __future__ import annotations

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
"""Part of the size within which a place is on an axis: rounding."""


def size_without_reach(bodies: NDArray[np.void], hinges: NDArray[np.void]) -> float:
    """√(max J / Σ m) [m], or 1 m where there is no mass or no inertia."""
    mass = float(bodies["mass"].sum())
    rotors = np.abs(hinges["armature"][hinges["axis"] < SLIDES])
    largest = max(float(np.linalg.eigvalsh(bodies["inertia"]).max()), float(rotors.max(initial=0.0)))
    return math.sqrt(largest / mass) if mass > 0 and largest > 0 else 1.0


def without_lever(arrays: ChainArrays, reach: float, anywhere: Callable[[], KinematicsWork]) -> Indices:
    """Joints that turn and move no place, a hinge point or a tip, at any posture.

    A joint on which one with a lever hangs has a lever: the place moves on a circle, which lies on no axis. So those
    farthest out tell of most arms, and `anywhere`, `at_any_posture`, need not be asked.
    """
    last = len(arrays.hinges) - 1
    if (
        arrays.rare is None
        and last >= 0
        and _offset_of_next(arrays, last, len(arrays.bodies) - 2) > 2 * NEARLY * reach > 0
    ):
        return np.empty(0, np.intp)  # of bodies in a row the last joint tells of all
    passes = (arrays.hinges["axis"] >= SLIDES).tolist()
    if reach == 0 or all(passes):
        return np.flatnonzero(np.logical_not(passes))
    first, stop, parent = (arrays.bodies[name].tolist() for name in ("first", "stop", "parent"))
    for k in range(last, -1, -1):
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
    """How far the next body is from the axis of a joint of one, if it hangs on it, no joint between; 0 if not."""
    if arrays.bodies["stop"][body] != k + 1 or arrays.bodies["parent"][body + 1] != body + 1:
        return 0.0
    place: list[float] = arrays.bodies["translation"][body + 1].tolist()
    return max(abs(x) for i, x in enumerate(place) if i != arrays.hinges["axis"][k])


def _lever(e: list[float], a: list[float], b: list[float]) -> float:
    """Largest component of e × (b − a)."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return max(abs(e[1] * z - e[2] * y), abs(e[2] * x - e[0] * z), abs(e[0] * y - e[1] * x))


def on_elastic_gears(arrays: ChainArrays) -> Indices:
    """Joints with a rotor whose turning a spring about the same axis at the same point can take back."""
    bodies, hinges = arrays.bodies, arrays.hinges
    if not np.count_nonzero(hinges["armature"]):
        return np.empty(0, np.intp)
    inner, outer = hinges[:-1], hinges[1:]
    sprung = (inner["stiffness"] == 0) & (outer["stiffness"] > 0) & (inner["armature"] > 0)
    found = np.flatnonzero(sprung & (inner["axis"] == outer["axis"]) & (inner["axis"] < SLIDES))
    if not len(found):
        return found
    apart = bodies["translation"].any(axis=1) | (bodies["turned"] != 0) | (bodies["begins"] != 0)
    here, there = np.searchsorted(bodies["stop"], [found, found + 1], side="right")
    return np.asarray(found[(here == there) | ~apart[there]])


def turning_radii(arrays: ChainArrays, free: Indices, motors: Indices, size: float, placed: KinematicsWork) -> Array:
    """ρ of joints without a lever and of motors on elastic gears [m], 0 of all others, (n,); placed at any posture."""
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
    """Inertia about the axis of joint `k` [kg m²] and mass [kg] of all that moves with it."""
    bodies = arrays.bodies
    body = int(np.searchsorted(bodies["stop"], k, side="right"))
    beyond = np.array(_beyond(bodies["parent"].tolist(), body))
    mass, R, e = bodies["mass"][beyond], placed.rotations[beyond], placed.axes[k]
    centers = placed.points[beyond] + np.einsum("bij,bj->bi", R, bodies["center"][beyond]) - placed.points[body]
    own = np.einsum("bij,j->bi", R.transpose(0, 2, 1), e)
    J = np.einsum("bi,bij,bj->", own, bodies["inertia"][beyond], own) + mass @ (cross(e, centers) ** 2).sum(axis=1)
    return float(J), float(mass.sum())


def at_any_posture(arrays: ChainArrays, length: float) -> KinematicsWork:
    """Where all is at angles of which none is zero or a right angle."""
    q: Array = np.where(arrays.hinges["axis"] < SLIDES, 0.7, 0.7 * length) * (1 + np.arange(len(arrays.hinges))) ** 0.5
    placed: KinematicsWork = forward_kinematics(arrays, q)
    return placed


def _beyond(parent: list[int], body: int) -> list[int]:
    """The bodies that move with one, itself first, by what each hangs on, counted from 1."""
    moves = {body}
    for i in range(body + 1, len(parent)):
        if parent[i] - 1 in moves:
            moves.add(i)
    return sorted(moves)
