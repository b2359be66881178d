"""Rows of numbers that `articulated` works on: one row per body and per hinge, contiguous, as an array of float64."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.joint_torques import COULOMB, JOINT, dry_joints, given_joints, put_joint
from flexlink.kernels.forward.articulated_layout import ANEW, FIRST, LAYOUT_SIZE, TRIPLE, WAY, common_layout, layout_of
from flexlink.kernels.tools.compiler import inlined, kernel
from flexlink.kernels.tools.lanes import LANES, put_vec_of, vec_of
from flexlink.kernels.tools.sym3 import point_inertia, sym_add, symmetric
from flexlink.kernels.tools.vec3 import scale, vector

# Numbers of a body. Fixed, body axes: columns of the mount's rotation, mass, m c, inertia about the hinge point, r to
# the next hinge point. Of the state, working axes: x_j, r, m c, b = ω × (ω × r), ζ = Σ q̇_k ω × e_k, f = m ω × (ω × c);
# inertia and n = ω × I ω along x_j. These are the axes of the body, but of a pair e₂, e₁, e₂ × e₁.
MOUNT, MASS, MOMENT, OWN_INERTIA, REACH = 0, 9, 10, 13, 19
AXES, R, MC, B, ZETA, F, INERTIA, N = 22, 31, 34, 37, 40, 43, 46, 52
# Of a pair or triple, once J is eliminated: h_j / D_j, the factors of J, α and 1 / D_j.
H_D, FACTORS, ALPHA, INVERSES, BODY_SIZE = 55, 64, 67, 70, 73
# Where working axes may begin anew: the working axes before in these (columns), and whether they do (1 or 0).
BEFORE, BEGINS = H_D, FACTORS
# Numbers of a hinge, after those of its joint: rotor A, torque, axis e, J e, Hᵀ e, T and 1 / D; within a triple
# instead of J e: e₁* of `known_moment`; of its third hinge instead of T and 1 / D: e₁·e₃, and 1 or −1, the sense of the
# axes, with which the cosine of the middle angle is e₁·e₂×e₃.
ARMATURE, TORQUE, AXIS, JE, HE, T_NET, INVERSE, HINGE_SIZE = (JOINT + k for k in (0, 1, 2, 5, 8, 11, 12, 13))
SENSE = INVERSE


class ArticulatedWork(NamedTuple):
    """Scratch of `articulated`, with the constants of a chain, or of eight."""

    gravity: Any
    layout: Any
    axes: Any
    given: Any
    bodies: Any  # rows of numbers of the bodies
    hinges: Any  # and of the hinges
    dry: Any
    flat: Any  # angles, cosines and sines, for the loop over all of them
    trig: Any  # the same memory, for the hinges


@kernel
def articulated_workspace(bodies, hinges, gravity):
    """Scratch of `articulated` with the chain's constants."""
    n = len(hinges)
    layout, axes = layout_of(bodies, hinges), np.empty(n, np.int64)
    rows, joints = np.zeros((len(bodies), BODY_SIZE)), np.zeros((n, HINGE_SIZE))
    for i in range(len(bodies)):
        b = bodies[i]
        for j in range(9):
            rows[i, MOUNT + j] = b.rotation[j % 3, j // 3]
        rows[i, MASS], rows[i, BEGINS] = b.mass, layout[i, ANEW]
        put_vec_of(rows, scale(b.mass, vector(b.center)), i, MOMENT)
        inertia = sym_add(symmetric(b.inertia), point_inertia(b.mass, vector(b.center)))
        for j in range(6):
            rows[i, OWN_INERTIA + j] = rows[i, INERTIA + j] = inertia[j]
        if i > 0:
            put_vec_of(rows, vector(b.translation), i - 1, REACH)
    for k in range(n):
        put_joint(joints, k, hinges[k])
        joints[k, ARMATURE], axes[k] = hinges[k].armature, hinges[k].axis
    for k in layout[layout[:, WAY] == TRIPLE, FIRST]:
        joints[k + 2, SENSE] = 1.0 if axes[k + 1] == (axes[k] + 1) % 3 else -1.0
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines; whole vectors of angles
    dry = dry_joints(joints[:, COULOMB])
    return ArticulatedWork(gravity.copy(), layout, axes, given_joints(hinges), rows, joints, dry, trig, trig)


@kernel
def articulated_lanes_workspace(bodies, hinges, gravity):
    """The same for eight chains side by side, arrays of shape (8, bodies), (8, n), (8, 3), alike in their hinges."""
    m, n = bodies.shape[1], hinges.shape[1]
    one = articulated_workspace(bodies[0], hinges[0], gravity[0])
    axes, coulomb, layouts = one.axes, np.zeros(n), np.empty((LANES, m, LAYOUT_SIZE), np.int64)
    base, rows, joints = np.empty((3, LANES)), np.empty((m, BODY_SIZE, LANES)), np.empty((n, HINGE_SIZE, LANES))
    trig = np.empty((3, n * LANES))
    for lane in range(LANES):
        one = articulated_workspace(bodies[lane], hinges[lane], gravity[lane])
        layouts[lane] = one.layout
        base[:, lane], rows[:, :, lane], joints[:, :, lane] = gravity[lane], one.bodies, one.hinges
        coulomb += one.hinges[:, COULOMB]
    given, trig_lanes = given_joints(hinges[0]), trig.reshape(3, n, LANES)
    layout = common_layout(layouts)
    return ArticulatedWork(base, layout, axes, given, rows, joints, dry_joints(coulomb), trig, trig_lanes)


@inlined
def inertia_of(bodies, i, first):
    """Symmetric tensor that starts at `first` of row `i`."""
    a, b = vec_of(bodies, i, first), vec_of(bodies, i, first + 3)
    return a[0], a[1], a[2], b[0], b[1], b[2]


@inlined
def axes_of(bodies, i, first):
    """Three vectors that start at `first` of row `i`."""
    return vec_of(bodies, i, first), vec_of(bodies, i, first + 3), vec_of(bodies, i, first + 6)


@inlined
def put_axes_of(bodies, x, y, z, i, first):
    """Write what `axes_of` reads."""
    put_vec_of(bodies, x, i, first)
    put_vec_of(bodies, y, i, first + 3)
    put_vec_of(bodies, z, i, first + 6)
