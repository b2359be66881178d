"""Fixed rotations between frames: roll-pitch-yaw, unit quaternions (w, x, y, z) and matrices."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def matrix_from_rpy_deg(rpy_deg: tuple[float, float, float]) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), angles in degrees; multiples of 90° give exact zeros and ones."""
    (cr, sr), (cp, sp), (cy, sy) = (cos_sin_deg(angle) for angle in rpy_deg)
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    R: Array = Rz @ Ry @ Rx
    return R


def cos_sin_deg(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees, exact at multiples of 90°."""
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    reduced = angle % 360.0
    return quarter.get(reduced) or (math.cos(math.radians(reduced)), math.sin(math.radians(reduced)))


def rpy_from_matrix(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll).

    The yaw is what is left of R after the roll is undone, so that a roll that is badly determined (pitch near ±90°)
    is made up for.
    """
    roll = math.atan2(R[2, 1], R[2, 2])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    c, s = math.cos(roll), math.sin(roll)
    return roll, pitch, math.atan2(s * R[0, 2] - c * R[0, 1], c * R[1, 1] - s * R[1, 2])


def quaternion_from_matrix(R: Array) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z), w ≥ 0; from the largest of the four, so no cancellation (Shepperd 1978)."""
    w, x, y, z = 1 + np.trace(R), *(1 + 2 * R[k, k] - np.trace(R) for k in range(3))
    candidates = {
        w: (w, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]),
        x: (R[2, 1] - R[1, 2], x, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]),
        y: (R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], y, R[1, 2] + R[2, 1]),
        z: (R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], z),
    }
    largest = max(candidates)
    q = np.array(candidates[largest], float)
    q = q / math.hypot(*q) * (1 if q[0] >= 0 else -1)
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])
