"""How a free base turns, in the terms of others: a rotation and an angular velocity for three angles and their rates.

R = R_reference Rx Ry Rz        ω = S(φ) φ̇        ω̇ = S φ̈ + Ṡ φ̇        in axes of the base
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.rotation import about_axis
from flexlink.common.products import product
from flexlink.common.types import Array


def rotation_of(reference: Array, angles: Array) -> Array:
    """R, v_0 = R v, of three angles [rad]."""
    return product(reference, *(about_axis(axis, angle) for axis, angle in enumerate(angles.tolist())))


def spin_matrix(angles: Array) -> Array:
    """S, whose columns are the axes of the three hinges, shape (3, 3)."""
    (cy, cz), (sy, sz) = np.cos(angles[1:]), np.sin(angles[1:])
    return np.array([[cy * cz, sz, 0.0], [-cy * sz, cz, 0.0], [sy, 0.0, 1.0]])


def spin_drift(angles: Array, rates: Array) -> Array:
    """Ṡ φ̇, what ω̇ is without φ̈, shape (3,)."""
    (cy, cz), (sy, sz) = np.cos(angles[1:]), np.sin(angles[1:])
    x, y, z = rates
    about_x = np.array([-sy * cz * y - cy * sz * z, sy * sz * y - cy * cz * z, cy * y])
    return np.asarray(about_x * x + np.array([cz, -sz, 0.0]) * y * z)
