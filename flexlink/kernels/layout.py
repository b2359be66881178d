"""Layout of the arrays of a chain, which every kernel reads: bodies, hinges, gravity and optional features.

Bodies form a tree. Each body comes after its parent, in most cases directly after it. A forward pass goes from the base
to the tips; at a body with several children it stores the state from which the branches continue (`fork`, `slot`). A
backward pass adds up the contributions of the branches there.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.kernels.tools.numbered import numbered


def record(*fields: Any) -> np.dtype[Any]:
    """Return the type of aligned records; fields are attributes both in Python and in compiled kernels."""
    return np.dtype((np.record, np.dtype([*fields], align=True)))


BODY = record(
    ("first", np.int64),  # its hinges have indices first … stop − 1
    ("stop", np.int64),
    ("parent", np.int64),  # number of the parent body, from 1; 0: the base
    ("begins", np.int64),  # 1: the first body of a branch, so its parent is not the body before it
    ("slot", np.int64),  # first body of a branch: row with the state of its parent; 0: state of the base
    ("fork", np.int64),  # row in which the state of this body is stored for its branches; 0: it has none
    ("loaded", np.int64),  # 1: the tip wrench acts at its hinge point
    ("turned", np.int64),  # 1 if `rotation` is not the identity
    ("springs", np.int64),  # variable of its hinges' springs: 0 angles, 1 rotation vector (X, Y, Z or Z, Y, X),
    # 2 rotation vector, and curvature of the cell that it forms with the next body
    ("rotation", np.float64, (3, 3)),  # R: v_parent = R v_body at zero joint angles
    ("translation", np.float64, (3,)),  # r: hinge point in the frame of the parent body [m]
    ("mass", np.float64),  # [kg]
    ("center", np.float64, (3,)),  # c: centre of mass in the body frame [m]
    ("inertia", np.float64, (3, 3)),  # I: about the centre of mass, body axes [kg m²]
)

HINGE = record(
    ("axis", np.int64),  # 0, 1, 2: revolute about X, Y, Z; 3, 4, 5: prismatic along them
    ("stiffness", np.float64),  # k, or K_ii of coupled springs [N m/rad]; prismatic: [N/m], similarly for all units
    ("rest", np.float64),  # θ₀ [rad]
    ("damping", np.float64),  # d, viscous and structural, or D_ii of coupled dampers [N m s/rad]
    ("coulomb", np.float64),  # dry friction torque [N m]
    ("coulomb_width", np.float64),  # rate over which the dry torque changes sign [rad/s]
    ("armature", np.float64),  # rotor inertia, added to the diagonal of M [kg m²]
    ("lower", np.float64),  # lower joint limit, for information only; −inf: none [rad]
    ("upper", np.float64),  # upper joint limit; inf: none [rad]
    ("prescribed", np.int64),  # 1 if the motion of the hinge is prescribed and its torque unknown
)

COUPLING = record(
    ("inner", np.int64),  # two hinges, inner < outer, of one cell (overlapping couplings form a cell)
    ("outer", np.int64),
    ("stiffness", np.float64),  # K_ij = K_ji: torque −K_ij (θ_j − θ₀_j) on i, −K_ij (θ_i − θ₀_i) on j [N m/rad]
    ("damping", np.float64),  # D_ij = D_ji: the same with rates [N m s/rad]
)


DRAG = record(
    ("body", np.int64),  # index of the body with the point
    ("point", np.float64, (3,)),  # in the frame of the body [m]
    ("across", np.float64, (2, 3)),  # unit vectors normal to the link: y and z of the section, body axes
    ("drag", np.float64, (2,)),  # ½ ρ c_d b Δx for flow along each of these vectors [kg/m]
)

SPRINGS = numbered("angles rotation cell")
"""Variable on which the springs of a body's hinges act (`BODY.springs`); `cell` includes the next body's hinges."""
SLIDES = 3
"""Hinges with at least this axis number are prismatic. The hinges of a body are all revolute or all prismatic."""


FORCES = {
    "couplings": COUPLING,
    "drag": DRAG,
    "dampers": record(
        ("hinge", np.int64),
        ("quadratic", np.float64),  # c: resisting torque c |q̇| q̇ [N m s²/rad²]
    ),
    "gyrators": record(
        ("inner", np.int64),  # two hinges
        ("outer", np.int64),
        ("gyration", np.float64),  # g: resisting torque g q̇_outer at the inner hinge, −g q̇_inner at the outer one
    ),
    "hardening": record(
        ("hinge", np.int64),
        ("cubic", np.float64),  # c: spring torque c q³ [N m/rad³]
    ),
}
"""Force elements of a chain by name. Fields `hinge`, `inner` and `outer` are indices of hinges, `body` of bodies."""


class Rare(NamedTuple):
    """Optional features of a chain: its force elements by the names of `FORCES`; each array may be empty."""

    couplings: NDArray[np.void]
    drag: NDArray[np.void]
    dampers: NDArray[np.void]
    gyrators: NDArray[np.void]
    hardening: NDArray[np.void]


class ChainArrays(NamedTuple):
    """Arrays of a chain that kernels read.

    `rare` is None if the chain is plain: no branches, no prismatic joints, no force elements. The kernels are then
    compiled without code for them (`tools.absent`).
    """

    bodies: NDArray[np.void]
    hinges: NDArray[np.void]
    gravity: NDArray[np.float64]
    rare: Rare | None
