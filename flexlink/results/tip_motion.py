"""How far the tip of an arm moves, and how far two paths of it are apart; a path has shape (samples, 3) [m].

Where turning moves no place, as of a wheel, the path by which a run is judged is that of all bodies, (samples, bodies,
12): of each its point and its axes times the chain's size L over √2, which a turn by a small angle φ moves by L φ.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.kernels.geometry.kinematics import forward_kinematics, tip_points


def judged_path(chain: Chain, q: Array) -> Array:
    """The path of the tip at angles q (samples, n), or that of all bodies where turning moves no place."""
    if chain.has_levers:
        tips = np.empty((len(q), 3))
        tip_points(chain.arrays, q, tips)
        return tips
    path = np.empty((len(q), len(chain.bodies), 12))
    for row, angles in zip(path, np.ascontiguousarray(q), strict=True):
        placed = forward_kinematics(chain.arrays, angles)
        row[:, :3], row[:, 3:] = placed.points, placed.rotations.reshape(-1, 9) * (chain.size / np.sqrt(2))
    return path


def compared_path(chain: Chain, q: Array) -> Array:
    """The judged path; of a tree those of all its tips, (samples, tips, 3) [m]."""
    if len(chain.tips) == 1 or not chain.has_levers:
        return judged_path(chain, q)
    tips = list(chain.tips.values())
    return np.array([forward_kinematics(chain.arrays, angles).points[tips] for angles in np.ascontiguousarray(q)])


def apart(path: Array, other: Array) -> Array:
    """Distance of two compared paths at every sample (samples,) [m], of all bodies or tips the largest."""
    lengths = np.linalg.norm(path - other, axis=-1)
    return np.asarray(lengths if path.ndim == 2 else lengths.max(axis=-1))


def motion_in_words(chain: Chain, moved: float) -> str:
    """How far a compared path goes [m]."""
    what = "it" if not chain.has_levers else "the tip" if len(chain.tips) == 1 else "a tip"
    return f"while {what} moves {moved:.3g} m"


def distances(path: Array, other: Array) -> Array:
    """Distance of a path from another one, or from a point (3,), at every sample (samples,) [m]."""
    return np.asarray(np.linalg.norm(path - other, axis=1))


def largest_distance(path: Array, other: Array) -> float:
    """The largest of them [m]."""
    return float(distances(path, other).max())


def largest_so_far(lengths: Array) -> Array:
    """Largest length up to every sample (samples,) [m]; inf from the first one on that is not finite."""
    return np.maximum.accumulate(np.where(np.isfinite(lengths), lengths, np.inf))


def tip_travel(tip: Array) -> float:
    """Largest distance of the tip from where it starts [m]."""
    return largest_distance(tip, tip[0])


def extent_of_motion(tip: Array) -> float:
    """Diagonal of the smallest box along frame 0 around a path [m].

    At least the travel. Errors of steps are judged by it: a vibration of amplitude a has the extent 2a, wherever in its
    period a run starts; its travel is between a and 2a.
    """
    box = np.ptp(tip, axis=0)
    return float(np.linalg.norm(box) if box.ndim == 1 else np.linalg.norm(box, axis=-1).max())


def centre_of_motion(tip: Array) -> Array:
    """Centre of the same box, shape (3,) [m]."""
    return np.asarray((tip.min(axis=0) + tip.max(axis=0)) / 2)
