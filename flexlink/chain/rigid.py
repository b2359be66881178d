"""Poses of frames, and rigid bodies that can be moved, joined and separated exactly.

A body of mass m, centre c and inertia I about it has the covariance Σ = ∫ (x − c)(x − c)ᵀ dm = ½ tr(I) 1 − I. Such a
body exists if and only if m ≥ 0 and Σ ⪰ 0. In the symmetric 4 × 4 form ∫ (1, x)(1, x)ᵀ dm, masses, first and second
moments simply add (Wensing, Kim & Slotine 2018, Linear matrix inequalities for physically consistent inertial
parameters).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.common.products import dot, product
from flexlink.common.types import Array


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
