"""Kinematics of a free base: six joints, three that slide along X, Y, Z of frame 0 and three that turn about X, Y, Z.

The three angles turn the base from a reference attitude, its initial attitude: R = R_reference Rx Ry Rz. At zero
angles, their rates are the angular velocity in axes of the base.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexlink.chain.rigid import matrix_from_quaternion, matrix_from_rpy_deg, quaternion_from_matrix
from flexlink.common.types import Array
from flexlink.describe.initial import BaseState
from flexlink.kernels.layout import SLIDES

JOINTS = 6
"""Number of joints of a free base; they are the first of the chain."""
NAMES = "x", "y", "z", "rx", "ry", "rz"
"""Names of these joints."""
AXES = (*range(SLIDES, SLIDES + 3), *range(3))
"""Axes along or about which these joints move, as in dtype `HINGE`."""


def attitude(base: BaseState) -> Array:
    """Unit quaternion w, x, y, z of a base's initial attitude, shape (4,)."""
    if base.quaternion is None:
        return np.array(quaternion_from_matrix(matrix_from_rpy_deg(base.rpy_deg)))
    quaternion = np.array(base.quaternion)
    quaternion /= np.abs(quaternion).max()
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def reference_rotation(base: BaseState) -> Array:
    """Rotation R of a base's initial attitude, v_0 = R v, shape (3, 3)."""
    return (
        matrix_from_rpy_deg(base.rpy_deg)
        if base.quaternion is None
        else matrix_from_quaternion(attitude(base).tolist())
    )


def rotations_of(angles: Array) -> Array:
    """R = Rx Ry Rz for three angles (…, 3) [rad], shape (…, 3, 3)."""
    (cx, cy, cz), (sx, sy, sz) = _parts(np.cos(angles)), _parts(np.sin(angles))
    return _matrices(
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    )


def angles_of(R: Array) -> Array:
    """Inverse of `rotations_of`: angles [rad], with the angle about Y within ±90°, shape (…, 3)."""
    across = np.hypot(R[..., 0, 0], R[..., 0, 1])
    x = np.arctan2(-R[..., 1, 2], R[..., 2, 2])
    return np.stack([x, np.arctan2(R[..., 0, 2], across), np.arctan2(-R[..., 0, 1], R[..., 0, 0])], axis=-1)


def quaternions_of(angles: Array) -> Array:
    """Unit quaternions w, x, y, z of the rotations Rx Ry Rz by three angles [rad], shape (…, 4)."""
    half = np.asarray(angles) / 2
    turns = np.zeros((3, *half.shape[:-1], 4))
    for axis in range(3):
        turns[axis, ..., 0], turns[axis, ..., 1 + axis] = np.cos(half[..., axis]), np.sin(half[..., axis])
    return product_of(product_of(turns[0], turns[1]), turns[2])


def product_of(p: Array, q: Array) -> Array:
    """Unit quaternion of rotation p followed by rotation q about the rotated axes, normalized; shapes (…, 4)."""
    a, b = ([each[..., k] for k in range(4)] for each in (p, q))
    both = np.empty(np.broadcast_shapes(p.shape, q.shape))
    both[..., 0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    both[..., 1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    both[..., 2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    both[..., 3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    return np.asarray(both / np.sqrt((both * both).sum(axis=-1, keepdims=True)))


def rates_matrices(angles: Array) -> Array:
    """S in ω = S φ̇, ω in axes of the base, φ̇ rates of the angles, (…, 3, 3); det S = cos of the angle about Y."""
    (_, cy, cz), (_, sy, sz) = _parts(np.cos(angles)), _parts(np.sin(angles))
    return _matrices([cy * cz, sz, 0.0], [-cy * sz, cz, 0.0], [sy, 0.0, 1.0])


def rates_matrices_changing(angles: Array, rates: Array) -> Array:
    """Ṡ in ω̇ = S φ̈ + Ṡ φ̇, shape (…, 3, 3)."""
    (_, cy, cz), (_, sy, sz), (_, y, z) = _parts(np.cos(angles)), _parts(np.sin(angles)), _parts(np.asarray(rates))
    return _matrices(
        [-y * sy * cz - z * cy * sz, z * cz, 0.0], [y * sy * sz - z * cy * cz, -z * sz, 0.0], [y * cy, 0.0, 0.0]
    )


def _parts(vectors: Array) -> tuple[Array, Array, Array]:
    return vectors[..., 0], vectors[..., 1], vectors[..., 2]


def _matrices(*rows: list[Any]) -> Array:
    """Matrices from their elements, scalars or arrays of the first one's shape; `np.stack` takes ten times as long."""
    first = np.asarray(rows[0][0])
    found = np.empty((*first.shape, 3, 3), first.dtype)
    for i, row in enumerate(rows):
        for j, element in enumerate(row):
            found[..., i, j] = element
    return found
