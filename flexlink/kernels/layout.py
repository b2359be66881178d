"""Layout of a chain's arrays, which every kernel reads: its bodies, its hinges, gravity, and couplings of springs."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


def record(fields: list[Any]) -> np.dtype[Any]:
    """Aligned records whose fields are attributes in Python, too, as in compiled kernels, which so run as either."""
    return np.dtype((np.record, np.dtype(fields, align=True)))


BODY = record(
    [
        ("first", np.int64),  # its hinges are first … stop − 1
        ("stop", np.int64),
        ("turned", np.int64),  # 1 if `rotation` is not the identity
        ("springs", np.int64),  # what those of its hinges hold: 0 angles, 1 their rotation vector (X, Y, Z or Z, Y, X),
        # 2 that and the curvature of a cell, with the next body outward
        ("rotation", np.float64, (3, 3)),  # R: v_parent = R v_body at zero joint angles
        ("translation", np.float64, (3,)),  # r: hinge point in the frame of the body before it [m]
        ("mass", np.float64),  # [kg]
        ("center", np.float64, (3,)),  # c: centre of mass in the body frame [m]
        ("inertia", np.float64, (3, 3)),  # I: about the centre of mass, body axes [kg m²]
    ]
)

HINGE = record(
    [
        ("axis", np.int64),  # 0, 1, 2 = X, Y, Z
        ("stiffness", np.float64),  # k, K_ii where springs are coupled [N m/rad]
        ("rest", np.float64),  # θ₀ [rad]
        ("damping", np.float64),  # d, viscous and structural, D_ii where dampers are coupled [N m s/rad]
        ("coulomb", np.float64),  # dry friction torque [N m]
        ("coulomb_width", np.float64),  # rate over which the dry torque turns round [rad/s]
        ("armature", np.float64),  # rotor inertia, added to the diagonal of M [kg m²]
        ("lower", np.float64),  # limits of the angle, kept for whoever asks; ±inf without [rad]
        ("upper", np.float64),
        ("prescribed", np.int64),  # 1 if the motion of the hinge is given in time, and its torque sought
    ]
)

COUPLING = record(
    [
        ("inner", np.int64),  # two hinges, inner < outer, of the cell that overlapping couplings make
        ("outer", np.int64),
        ("stiffness", np.float64),  # K_ij = K_ji: torque −K_ij (θ_j − θ₀_j) on i, −K_ij (θ_i − θ₀_i) on j [N m/rad]
        ("damping", np.float64),  # D_ij = D_ji, of the rates likewise [N m s/rad]
    ]
)


class ChainArrays(NamedTuple):
    """What the kernels see of a chain."""

    bodies: NDArray[np.void]
    hinges: NDArray[np.void]
    gravity: NDArray[np.float64]
    couplings: NDArray[np.void]
