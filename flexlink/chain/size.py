"""A length of a chain that is never 0, where nothing of it reaches out: a cart, a wheel, a motor and its gear alone.

    L = max |r|                    how far from the origin any mass gets, limits of slides included: the reach
    L = √(max J / Σ m)             without a reach, J the largest inertia or rotor that turns
    L = 1 m                        where nothing has length: a cart, a motor without mass

What turns there moves no place, and no error of it would be seen by places: it counts by its angle times L.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.kernels.bodies.kinematics import forward_kinematics
from flexlink.kernels.layout import SLIDES, ChainArrays

NEARLY = 1e-9
"""Part of the size by which a place that is turned counts as moved: rounding of axes along their own line."""


def size_without_reach(bodies: NDArray[np.void], hinges: NDArray[np.void]) -> float:
    """√(max J / Σ m) [m], or 1 m where there is no mass or no inertia."""
    mass = float(bodies["mass"].sum())
    rotors = np.abs(hinges["armature"][hinges["axis"] < SLIDES])
    largest = max(float(np.linalg.eigvalsh(bodies["inertia"]).max()), float(rotors.max(initial=0.0)))
    return math.sqrt(largest / mass) if mass > 0 and largest > 0 else 1.0


def has_levers(arrays: ChainArrays, reach: float) -> bool:
    """Whether turning any joint moves a place, a hinge point or a tip; of a chain whose joints all slide nothing asks.

    At some posture: where an arm is stretched along an axis it moves none for a moment.
    """
    bodies, hinges = arrays.bodies, arrays.hinges
    turning = np.flatnonzero(hinges["axis"] < SLIDES)
    if not len(turning):
        return True
    if reach == 0:
        return False
    return _across_an_axis(bodies, hinges) or any(_moves(arrays, int(k), reach) for k in turning)


def _across_an_axis(bodies: NDArray[np.void], hinges: NDArray[np.void]) -> bool:
    """Whether a body hangs across from the last axis of the body that it hangs on, as of most arms: quickly told."""
    parents = np.where(bodies["begins"] != 0, bodies["parent"], np.arange(len(bodies))) - 1
    behind = np.flatnonzero(parents >= 0)
    stops, firsts = bodies["stop"][parents[behind]], bodies["first"][parents[behind]]
    with_hinge = stops > firsts
    last = hinges["axis"][stops[with_hinge] - 1]
    turns = last < SLIDES
    across = bodies["translation"][behind[with_hinge][turns]].copy()
    across[np.arange(len(across)), last[turns]] = 0.0
    return bool(across.any())


def _moves(arrays: ChainArrays, k: int, reach: float) -> bool:
    """Whether joint `k` moves a place where no joint is at zero or right angles, by comparison."""
    q: Array = np.where(arrays.hinges["axis"] < SLIDES, 0.7, 0.7 * reach) * (1 + np.arange(len(arrays.hinges))) ** 0.5
    before = np.array(forward_kinematics(arrays, q).points)
    q[k] += 0.5
    return bool(np.abs(forward_kinematics(arrays, q).points - before).max() > NEARLY * reach)
