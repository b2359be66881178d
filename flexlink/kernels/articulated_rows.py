"""Rows of numbers that `articulated` works on: one row per body and per hinge, contiguous, as an array of float64."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.compiler import inlined, kernel
from flexlink.kernels.joint_torques import COULOMB, JOINT, dry_joints, given_joints, put_joint
from flexlink.kernels.lanes import LANES, put_vec_of, vec_of
from flexlink.kernels.sym3 import point_inertia, sym_add, symmetric
from flexlink.kernels.vec3 import scale, vector

# Whole numbers of a body: its hinges first … stop − 1; turned by a mount; free: it turns freely on three axes, so that
# what it passes inward is a force and a known moment only; quick: free, and so is the one beyond it, or there is none.
FIRST, STOP, TURNED, FREE, QUICK = range(5)
# Numbers of a body. Fixed, body axes: columns of the mount's rotation, mass, m c, inertia about the hinge point, r to
# the next hinge point. Of the state, frame 0: body axes, r, m c, b = ω × (ω × r), ζ = Σ q̇_k ω × e_k, f = m ω × (ω × c);
# n = ω × I ω in body axes; of a free body h_j / D_j, the factors of J and α once J is eliminated.
MOUNT, MASS, MOMENT, INERTIA, REACH = 0, 9, 10, 13, 19
AXES, R, MC, B, ZETA, F, N, H_D, FACTORS, ALPHA, BODY_SIZE = 22, 31, 34, 37, 40, 43, 46, 49, 58, 61, 64
# Numbers of a hinge, after those of its joint: rotor A, torque, axis e, J e, Hᵀ e, T and 1 / D; within a free group
# instead of J e and T: e₁* of `known_moment`, and e₁·e₃.
ARMATURE, TORQUE, AXIS, JE, HE, T_NET, INVERSE, HINGE_SIZE = (JOINT + k for k in (0, 1, 2, 5, 8, 11, 12, 13))


class ArticulatedWork(NamedTuple):
    """Scratch of `articulated`, with the constants of a chain, or of eight."""

    gravity: Any
    layout: Any
    axes: Any
    given: Any
    rows: Any
    joints: Any
    dry: Any
    flat: Any  # angles, cosines and sines, for the loop over all of them
    trig: Any  # the same memory, for the hinges


@kernel
def articulated_workspace(bodies, hinges, gravity):
    """Scratch of `articulated` with the chain's constants."""
    n = len(hinges)
    layout, axes = np.zeros((len(bodies), 5), np.int64), np.empty(n, np.int64)
    rows, joints = np.zeros((len(bodies), BODY_SIZE)), np.zeros((n, HINGE_SIZE))
    for i in range(len(bodies)):
        b = bodies[i]
        layout[i, FIRST], layout[i, STOP], layout[i, TURNED] = b.first, b.stop, b.turned
        layout[i, FREE] = is_free(b, hinges)
        for j in range(9):
            rows[i, MOUNT + j] = b.rotation[j % 3, j // 3]
        rows[i, MASS] = b.mass
        put_vec_of(rows, scale(b.mass, vector(b.center)), i, MOMENT)
        inertia = sym_add(symmetric(b.inertia), point_inertia(b.mass, vector(b.center)))
        for j in range(6):
            rows[i, INERTIA + j] = inertia[j]
        if i > 0:
            put_vec_of(rows, vector(b.translation), i - 1, REACH)
            ends = i + 1 == len(bodies) and b.first == b.stop and b.mass == 0.0 and not np.any(b.inertia)
            layout[i - 1, QUICK] = layout[i - 1, FREE] and (layout[i, FREE] or ends)
    for k in range(n):
        put_joint(joints, k, hinges[k])
        joints[k, ARMATURE], axes[k] = hinges[k].armature, hinges[k].axis
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines; whole vectors of angles
    dry = dry_joints(joints[:, COULOMB])
    return ArticulatedWork(gravity.copy(), layout, axes, given_joints(hinges), rows, joints, dry, trig, trig)


@kernel
def articulated_lanes_workspace(bodies, hinges, gravity):
    """The same for eight chains side by side, arrays of shape (8, bodies), (8, n), (8, 3), alike in their layout."""
    m, n = bodies.shape[1], hinges.shape[1]
    one = articulated_workspace(bodies[0], hinges[0], gravity[0])
    layout, axes, coulomb = one[1], one[2], np.zeros(n)
    base, rows, joints = np.empty((3, LANES)), np.empty((m, BODY_SIZE, LANES)), np.empty((n, HINGE_SIZE, LANES))
    trig = np.empty((3, n * LANES))
    for lane in range(LANES):
        one = articulated_workspace(bodies[lane], hinges[lane], gravity[lane])
        for j in range(3):
            base[j, lane] = gravity[lane, j]
        for i in range(m):
            layout[i, TURNED] |= one[1][i, TURNED]
            layout[i, FREE] &= one[1][i, FREE]
            layout[i, QUICK] &= one[1][i, QUICK]
            for j in range(BODY_SIZE):
                rows[i, j, lane] = one[4][i, j]
        for k in range(n):
            coulomb[k] += hinges[lane, k].coulomb
            for j in range(HINGE_SIZE):
                joints[k, j, lane] = one[5][k, j]
    given, trig_lanes = given_joints(hinges[0]), trig.reshape(3, n, LANES)
    return ArticulatedWork(base, layout, axes, given, rows, joints, dry_joints(coulomb), trig, trig_lanes)


@kernel
def is_free(body, hinges):
    """Whether a body turns freely: three axes in a group, no two alike in a row, no rotors, none prescribed."""
    for k in range(body.first, body.stop):
        twice = k > body.first and hinges[k].axis == hinges[k - 1].axis
        if twice or hinges[k].armature != 0.0 or hinges[k].prescribed:
            return False
    return body.stop - body.first == 3


@inlined
def inertia_of(bodies, i):
    """Inertia of body `i` about its hinge point, body axes, as a symmetric tensor."""
    a, b = vec_of(bodies, i, INERTIA), vec_of(bodies, i, INERTIA + 3)
    return a[0], a[1], a[2], b[0], b[1], b[2]


@inlined
def axes_of(bodies, i):
    """Axes x, y, z of body `i`."""
    return vec_of(bodies, i, AXES), vec_of(bodies, i, AXES + 3), vec_of(bodies, i, AXES + 6)
