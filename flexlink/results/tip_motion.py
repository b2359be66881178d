"""How far the tip of an arm moves, and how far two paths of it are apart; a path has shape (samples, 3) [m]."""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array


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
    return float(np.linalg.norm(np.ptp(tip, axis=0)))


def centre_of_motion(tip: Array) -> Array:
    """Centre of the same box, shape (3,) [m]."""
    return np.asarray((tip.min(axis=0) + tip.max(axis=0)) / 2)
