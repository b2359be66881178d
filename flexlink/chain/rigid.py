"""Poses of frames, rotations, and rigid bodies that can be moved, joined and separated exactly.

A body of mass m, centre c and inertia I about it has the covariance Σ = ∫ (x − c)(x − c)ᵀ dm = ½ tr(I) 1 − I. Such a
body exists if and only if m ≥ 0 and Σ ⪰ 0. In the symmetric 4 × 4 form ∫ (1, x)(1, x)ᵀ dm, masses, first and second
moments simply add (Wensing, Kim & Slotine 2018, Linear matrix inequalities for physically consistent inertial
parameters).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.products import cross, dot, product
from flexlink.common.types import Array
from flexlink.describe.directions import unit
from flexlink.describe.initial import BaseState


class Pose(NamedTuple):
    """Pose of a frame in an outer frame: v_outer = R v + p."""

    R: Array
    p: Array

    def then(self, inner: Pose) -> Pose:
        """Compose poses: `inner` is the pose of a frame in this frame; return its pose in the outer frame."""
        return Pose(product(self.R, inner.R), self.p + product(self.R, inner.p))

    @property
    def inverse(self) -> Pose:
        """Pose of the outer frame in this frame."""
        return Pose(self.R.T, product(-self.R.T, self.p))


HERE = Pose(np.eye(3), np.zeros(3))


class SpatialInertia(NamedTuple):
    """Mass [kg], centre of mass [m] and inertia about it [kg m²], in one frame."""

    mass: float
    center: Array
    inertia: Array

    def moved(self, pose: Pose) -> SpatialInertia:
        """Return the body in the outer frame, where `pose` is the pose of its present frame."""
        R, p = pose
        return SpatialInertia(self.mass, p + product(R, self.center), product(R, self.inertia, R.T))

    def plus(self, other: SpatialInertia) -> SpatialInertia:
        """Join two bodies by the parallel axis theorem; adding second moments would lose digits far from the origin."""
        mass = self.mass + other.mass
        if mass == 0:
            return SpatialInertia(0.0, np.zeros(3), self.inertia + other.inertia)
        d = other.center - self.center
        between = self.mass * other.mass / mass * (dot(d, d) * np.eye(3) - np.outer(d, d))
        return SpatialInertia(mass, self.center + d * (other.mass / mass), self.inertia + between + other.inertia)

    @property
    def covariance(self) -> Array:
        """Σ = ∫ (x − c)(x − c)ᵀ dm [kg m²]."""
        return np.asarray(np.trace(self.inertia) / 2 * np.eye(3) - self.inertia)

    @property
    def moments(self) -> Array:
        """∫ (1, x)(1, x)ᵀ dm, shape (4, 4): mass, first moment [kg m], second moment about the origin [kg m²]."""
        point = np.array([1.0, *self.center])
        moments = self.mass * np.outer(point, point)
        moments[1:, 1:] += self.covariance
        return moments


DESCRIBED = np.dtype([("link", "f8", (3, 3)), ("section", "f8", (3, 3)), ("lent", "f8")])
"""Per body: rotations R, v_body = R v, from axes of its link and from those of the section at its origin, x along the
beam; and the inertia that a cell lends to the last segment of its link, about y and z, from the segment before [kg m²]
(`Cells.tip`)."""

NOTHING = SpatialInertia(0.0, np.zeros(3), np.zeros((3, 3)))


def body_with(mass: float, center: Array, covariance: Array) -> SpatialInertia:
    """Body of this mass, centre and covariance."""
    return SpatialInertia(mass, center, np.trace(covariance) * np.eye(3) - covariance)


@functools.lru_cache(maxsize=256)
def matrix_from_rpy_deg(rpy_deg: tuple[float, float, float]) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), read-only, from angles in degrees; multiples of 90° give exact zeros and ones."""
    return read_only(_composed(*map(cos_sin_deg, rpy_deg)))


def matrix_from_rpy(rpy: tuple[float, float, float]) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), angles in radians."""
    return _composed(*((math.cos(angle), math.sin(angle)) for angle in rpy))


def _composed(*turns: tuple[float, float]) -> Array:
    Rx, Ry, Rz = (_about_axis(axis, *turn) for axis, turn in enumerate(turns))
    return product(Rz, Ry, Rx)


def about_axis_deg(axis: int, angle: float) -> Array:
    """Rotation by an angle [deg] about coordinate axis 0, 1, 2 = X, Y, Z; exact at multiples of 90°."""
    return _about_axis(axis, *cos_sin_deg(angle))


def _about_axis(axis: int, c: float, s: float) -> Array:
    R, (j, k) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
    R[j, j] = R[k, k] = c
    R[k, j], R[j, k] = s, -s
    return R


@functools.lru_cache(maxsize=256)
def turn_to(towards: tuple[float, float, float]) -> tuple[int, Array]:
    """Coordinate axis nearest to a direction, and the smallest rotation R from that axis to it: R e = direction.

    R = 1 + [v]× + [v]×²/(1 + c) with v = e × direction, c = e · direction; exact for every coordinate axis, and the
    identity for X, Y and Z. R is read-only.
    """
    direction = unit("axis", towards)
    axis = int(np.argmax(direction))
    c, v = direction[axis], cross(np.eye(3)[axis], direction)
    V = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return axis, read_only(np.eye(3) + V + product(V, V) / (1 + c))


def read_only(array: Array) -> Array:
    """Make the array read-only, because callers will share it."""
    array.flags.writeable = False
    return array


def cos_sin_deg(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees, exact at multiples of 90°."""
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    reduced = angle % 360.0
    return quarter.get(reduced) or (math.cos(math.radians(reduced)), math.sin(math.radians(reduced)))


def rpy_from_matrix(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll).

    The yaw is computed after turning R back by the roll, so that it cancels errors of an ill-conditioned roll (pitch
    near ±90°).
    """
    roll = math.atan2(R[2, 1], R[2, 2])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    c, s = math.cos(roll), math.sin(roll)
    return roll, pitch, math.atan2(s * R[0, 2] - c * R[0, 1], c * R[1, 1] - s * R[1, 2])


def quaternion_from_matrix(R: Array) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z), w ≥ 0, from its largest component to avoid cancellation (Shepperd 1978)."""
    trace = np.trace(R)
    w, x, y, z = 1 + trace, *(1 + 2 * R[k, k] - trace for k in range(3))
    candidates = {
        w: (w, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]),
        x: (R[2, 1] - R[1, 2], x, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]),
        y: (R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], y, R[1, 2] + R[2, 1]),
        z: (R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], z),
    }
    q = np.array(candidates[max(candidates)], float)
    q = q / math.hypot(*q) * (1 if q[0] >= 0 else -1)
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])


def matrix_from_quaternion(q: Sequence[float]) -> Array:
    """R of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


# Rotations R = Rx Ry Rz by three angles, as those of a floating base from its reference attitude. At zero angles, their
# rates are the angular velocity in axes of the base.


def reference_rotation(base: BaseState) -> Array:
    """Rotation R of a base's initial attitude, v_0 = R v, shape (3, 3)."""
    if base.quaternion is None:
        return matrix_from_rpy_deg(base.rpy_deg)
    quaternion = np.array(base.quaternion)
    quaternion /= np.abs(quaternion).max()
    return matrix_from_quaternion((quaternion / np.linalg.norm(quaternion)).tolist())


def rotations_of(angles: Array) -> Array:
    """R = Rx Ry Rz for three angles [rad], shape (3, 3)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    return np.array([
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ])  # fmt: skip


def rates_matrices(angles: Array) -> Array:
    """S in ω = S φ̇, ω in axes of the base, φ̇ rates of the angles, (3, 3); det S = cos of the angle about Y."""
    (_, cy, cz), (_, sy, sz) = np.cos(angles), np.sin(angles)
    return np.array([[cy * cz, sz, 0.0], [-cy * sz, cz, 0.0], [sy, 0.0, 1.0]])


def rates_matrices_changing(angles: Array, rates: Array) -> Array:
    """Ṡ in ω̇ = S φ̈ + Ṡ φ̇, shape (3, 3)."""
    (_, cy, cz), (_, sy, sz), (_, y, z) = np.cos(angles), np.sin(angles), rates
    return np.array([
        [-y * sy * cz - z * cy * sz, z * cz, 0.0], [y * sy * sz - z * cy * cz, -z * sz, 0.0], [y * cy, 0.0, 0.0]
    ])  # fmt: skip
