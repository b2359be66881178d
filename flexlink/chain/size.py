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


def without_lever(arrays: ChainArrays, reach: float) -> Indices:
    """Joints that turn and move no place, a hinge point or a tip, at any posture.

    A joint on which one with a lever hangs has a lever: the place moves on a circle, which lies on no axis.
    """
    bodies, passes = arrays.bodies, arrays.hinges["axis"] >= SLIDES
    if reach == 0:
        return np.flatnonzero(~passes)
    placed = _at_any_posture(arrays, reach)
    for k in range(len(passes) - 1, -1, -1):
        if not passes[k]:
            body, beyond = _beyond(bodies, k)
            levers = cross(placed.axes[k], placed.points[beyond] - placed.points[body])
            if np.abs(levers).max() > NEARLY * reach:
                _mark_path(bodies, body, k, passes)
    return np.flatnonzero(~passes)


def on_elastic_gears(arrays: ChainArrays) -> Indices:
    """Joints with a rotor whose turning a spring about the same axis at the same point can take back."""
    bodies, hinges = arrays.bodies, arrays.hinges
    inner, outer = hinges[:-1], hinges[1:]
    sprung = (inner["stiffness"] == 0) & (outer["stiffness"] > 0) & (inner["armature"] > 0)
    found = np.flatnonzero(sprung & (inner["axis"] == outer["axis"]) & (inner["axis"] < SLIDES))
    apart = bodies["translation"].any(axis=1) | (bodies["turned"] != 0) | (bodies["begins"] != 0)
    here, there = _bodies_of(bodies)[[found, found + 1]]
    return np.asarray(found[(here == there) | ~apart[there]])


def turning_radii(arrays: ChainArrays, free: Indices, motors: Indices, size: float) -> Array:
    """ρ of joints without a lever and of motors on elastic gears [m], 0 of all others, (n,)."""
    placed, radii = _at_any_posture(arrays, size), np.zeros(len(arrays.hinges))
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
    bodies, (body, beyond) = arrays.bodies, _beyond(arrays.bodies, k)
    mass, R, e = bodies["mass"][beyond], placed.rotations[beyond], placed.axes[k]
    centers = placed.points[beyond] + np.einsum("bij,bj->bi", R, bodies["center"][beyond]) - placed.points[body]
    own = np.einsum("bij,j->bi", R.transpose(0, 2, 1), e)
    J = np.einsum("bi,bij,bj->", own, bodies["inertia"][beyond], own) + mass @ (cross(e, centers) ** 2).sum(axis=1)
    return float(J), float(mass.sum())


def _at_any_posture(arrays: ChainArrays, length: float) -> KinematicsWork:
    """Where all is at angles of which none is zero or a right angle."""
    q: Array = np.where(arrays.hinges["axis"] < SLIDES, 0.7, 0.7 * length) * (1 + np.arange(len(arrays.hinges))) ** 0.5
    placed: KinematicsWork = forward_kinematics(arrays, q)
    return placed


def _bodies_of(bodies: NDArray[np.void]) -> Indices:
    """The body of every joint (n,)."""
    return np.repeat(np.arange(len(bodies)), bodies["stop"] - bodies["first"])


def _beyond(bodies: NDArray[np.void], k: int) -> tuple[int, NDArray[np.bool_]]:
    """The body of joint `k`, and whether each body moves with it."""
    body = int(_bodies_of(bodies)[k])
    moves = np.arange(len(bodies)) == body
    for i in range(body + 1, len(bodies)):
        moves[i] = bodies["parent"][i] > body and moves[bodies["parent"][i] - 1]
    return body, moves


def _mark_path(bodies: NDArray[np.void], body: int, k: int, marked: NDArray[np.bool_]) -> None:
    """Mark joint `k` of a body and all that it hangs on."""
    marked[bodies["first"][body] : k + 1] = True
    while (body := int(bodies["parent"][body]) - 1) >= 0:
        marked[bodies["first"][body] : bodies["stop"][body]] = True
