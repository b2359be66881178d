"""Where a free base is: six joints, three that slide along the axes of frame 0 and three that turn, X, Y, Z.

The three angles turn the base from a reference attitude, R = R_reference Rx Ry Rz, which is the one that it starts
with. Rates at angles of zero are the angular velocity in axes of the base.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.rotation import matrix_from_quaternion, matrix_from_rpy_deg, quaternion_from_matrix
from flexlink.common.types import Array
from flexlink.describe.conditions import BaseState
from flexlink.kernels.layout import SLIDES

JOINTS = 6
"""Of a free base, the first of the chain."""
AXES = (*range(SLIDES, SLIDES + 3), *range(3))
"""Of these joints, as in dtype `HINGE`."""


def attitude(base: BaseState) -> Array:
    """Unit quaternion w, x, y, z of where a base starts, shape (4,)."""
    if base.quaternion is None:
        return np.array(quaternion_from_matrix(matrix_from_rpy_deg(base.rpy_deg)))
    quaternion = np.array(base.quaternion)
    quaternion /= np.abs(quaternion).max()
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def reference_rotation(base: BaseState) -> Array:
    """R of where a base starts, v_0 = R v, shape (3, 3)."""
    return (
        matrix_from_rpy_deg(base.rpy_deg)
        if base.quaternion is None
        else matrix_from_quaternion(attitude(base).tolist())
    )
