"""Layout of a chain's arrays, which every kernel reads: its bodies, its hinges, gravity, and what is rare.

Bodies form a tree; each comes after the one that it hangs on, mostly right after it. A recursion outward goes from body
to body and keeps, at a body on which branches begin, what these go on from (`fork`, `slot`); one inward adds up there
what comes from the branches.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.kernels.tools.numbered import numbered


def record(fields: list[Any]) -> np.dtype[Any]:
    """Aligned records whose fields are attributes in Python, too, as in compiled kernels, which so run as either."""
    return np.dtype((np.record, np.dtype(fields, align=True)))


BODY = record(
    [
        ("first", np.int64),  # its hinges are first … stop − 1
        ("stop", np.int64),
        ("parent", np.int64),  # number, from 1, of the body that it hangs on; 0: the base
        ("begins", np.int64),  # 1: a branch begins with it, it does not hang on the body before it
        ("slot", np.int64),  # of such a one, where the state of what it hangs on is kept; 0: that of the base
        ("fork", np.int64),  # where this body's state is kept for branches that begin on it; 0: none does
        ("loaded", np.int64),  # 1: the tip wrench acts at its hinge point
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
        ("axis", np.int64),  # 0, 1, 2: turns about X, Y, Z; 3, 4, 5: slides along them
        ("stiffness", np.float64),  # k, K_ii where springs are coupled [N m/rad], of a sliding joint [N/m]; and so on
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


DRAG = record(
    [
        ("body", np.int64),  # on which the point is
        ("point", np.float64, (3,)),  # in the frame of the body [m]
        ("across", np.float64, (2, 3)),  # unit vectors across the link there, the section's y and z, in body axes
        ("drag", np.float64, (2,)),  # ½ ρ c_d b Δx of flow along each of them [kg/m]
    ]
)

SPRINGS = numbered("angles rotation cell")
"""What springs of a body's hinges hold (`BODY.springs`); the last with those of the next body outward, too."""
SLIDES = 3
"""Hinges whose axis is as large slide; a body's hinges either all turn, or all slide."""


DAMPER = record(
    [
        ("hinge", np.int64),
        ("quadratic", np.float64),  # c: torque c |q̇| q̇ resists [N m s²/rad²]
    ]
)

GYRATOR = record(
    [
        ("inner", np.int64),  # two hinges
        ("outer", np.int64),
        ("gyration", np.float64),  # g: torque g q̇_outer resists at the inner one, −g q̇_inner at the outer one
    ]
)

FORCES = {"couplings": COUPLING, "drag": DRAG, "dampers": DAMPER, "gyrators": GYRATOR}
"""Force elements of a chain by name; fields `hinge`, `inner` and `outer` are numbers of hinges, `body` of bodies."""


class Rare(NamedTuple):
    """What a plain chain has not: its force elements, each of which may be empty, by the names of `FORCES`."""

    couplings: NDArray[np.void]
    drag: NDArray[np.void]
    dampers: NDArray[np.void]
    gyrators: NDArray[np.void]


class ChainArrays(NamedTuple):
    """What the kernels see of a chain.

    `rare` is None of a plain one: no branches, no joints that slide, no force elements. No code is made for these then
    (`tools.absent`).
    """

    bodies: NDArray[np.void]
    hinges: NDArray[np.void]
    gravity: NDArray[np.float64]
    rare: Rare | None
