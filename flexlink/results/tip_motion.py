"""Extent of the motion of an arm's tip, and distance between two paths; a path has shape (samples, 3) [m].

If rotations move no point, as in a wheel, checks use the path of all bodies, (samples, bodies, 12). This has each
body's position, and its axes multiplied by L/√2 with the chain's size L, so rotation by a small angle φ counts as L φ.
"""

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.kernels.geometry.kinematics import forward_kinematics, tip_points


def checked_path(chain: Chain, q: Array, *, every: bool = False) -> Array:
    """Path of the tip, or of all bodies if rotations move no point, or if `every`, as a tie may hold the tip."""
    if every:
        return np.array([forward_kinematics(chain.arrays, angles).points for angles in np.ascontiguousarray(q)])
    if chain.has_levers:
        tips = np.empty((len(q), 3))
        tip_points(chain.arrays, q, tips)
        return tips
    path = np.empty((len(q), len(chain.bodies), 12))
    for row, angles in zip(path, np.ascontiguousarray(q), strict=True):
        placed = forward_kinematics(chain.arrays, angles)
        row[:, :3], row[:, 3:] = placed.points, placed.rotations.reshape(-1, 9) * (chain.size / np.sqrt(2))
    return path


def compared_path(chain: Chain, q: Array, *, every: bool = False) -> Array:
    """Return `checked_path`, or, for an arm with several tips, the paths of all its tips, (samples, tips, 3) [m]."""
    if every or len(chain.tips) == 1 or not chain.has_levers:
        return checked_path(chain, q, every=every)
    tips = list(chain.tips.values())
    return np.array([forward_kinematics(chain.arrays, angles).points[tips] for angles in np.ascontiguousarray(q)])


def apart(path: Array, other: Array) -> Array:
    """Distance between two compared paths at every sample (samples,) [m]; the largest over all bodies or tips."""
    lengths = np.linalg.norm(path - other, axis=-1)
    return np.asarray(lengths if path.ndim == 2 else lengths.max(axis=-1))


def motion_in_words(chain: Chain, moved: float) -> str:
    """Phrase that states the extent of a compared path [m]."""
    what = "it" if not chain.has_levers else "the tip" if len(chain.tips) == 1 else "a tip"
    return f"while {what} moves {moved:.3g} m"


def distances(path: Array, other: Array) -> Array:
    """Distance of a path from another one, or from a point (3,), at every sample (samples,) [m]."""
    return np.asarray(np.linalg.norm(path - other, axis=1))


def largest_distance(path: Array, other: Array) -> float:
    """Largest of the `distances` [m]."""
    return float(distances(path, other).max())


def largest_so_far(lengths: Array) -> Array:
    """Running maximum of lengths (samples,) [m]; inf from the first length that is not finite."""
    return np.maximum.accumulate(np.where(np.isfinite(lengths), lengths, np.inf))


def tip_travel(tip: Array) -> float:
    """Largest distance of the tip from its start [m]."""
    return largest_distance(tip, tip[0])


def extent_of_motion(tip: Array) -> float:
    """Diagonal of the smallest box along the axes of frame 0 around a path [m].

    It is at least `tip_travel`. Errors of steps are compared with the extent, not with the travel: a vibration of
    amplitude a has the extent 2a at any initial phase, but a travel between a and 2a.
    """
    box = np.ptp(tip, axis=0)
    return float(np.linalg.norm(box) if box.ndim == 1 else np.linalg.norm(box, axis=-1).max())


def centre_of_motion(tip: Array) -> Array:
    """Centre of the box of `extent_of_motion`, shape (3,) [m]."""
    return np.asarray((tip.min(axis=0) + tip.max(axis=0)) / 2)
