"""Workspace of `articulated`: one contiguous row of float64 numbers per body and per hinge."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.elements import forces_of, forces_side_by_side, one_of
from flexlink.kernels.forces.joint_torques import JOINT, dry_joints, put_joint
from flexlink.kernels.forward.articulated_branches import DEMAND, FORK_SIZE
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT, common_layout, layout_of
from flexlink.kernels.geometry.branches import fork_lanes, fork_rows
from flexlink.kernels.tools.compiler import inlined, kernel, shared
from flexlink.kernels.tools.lanes import LANES, empty_lanes, put_lane, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.sym3 import point_inertia, sym_add, symmetric
from flexlink.kernels.tools.vec3 import scale, vector

BODY_ROW = numbered(
    # Constant: columns of the mount's rotation; reach, the hinge point in axes of the parent body; mass, m c and
    # inertia about the hinge point in body axes.
    "mount:9 mass moment:3 own_inertia:6 reach:3",
    # Functions of the state, working axes: x_j, m c, ζ = Σ q̇_k ω × e_k, f = m ω × (ω × c); inertia, n = ω × I ω
    # along x_j. The x_j are the axes of the body, for a pair e₂, e₁, e₂ × e₁. In the axes that apply inboard of it:
    # r, from the hinge point of the parent to that of the body, and b = ω × (ω × r), with ω of the parent;
    # each prismatic hinge adds 2 q̇ ω × e to b.
    "axes:9 r:3 b:3 ζ:3 mc:3 f:3 inertia:6 n:3",
    # Pair or triple, after elimination of J: h_j / D_j, the factors of J, α and 1 / D_j.
    "h_D:9 factors:3 α:3 inverses:3",
)
RESTART = numbered("axes_before:9 restarts", start=BODY_ROW.h_D)
"""Columns of a body where working axes may restart (never a pair or triple): previous axes; 1 if they do restart."""
HINGE_ROW = numbered("armature torque axis:3 Je:3 He:3 T inverse", start=JOINT.size)
"""Columns of a hinge after the `JOINT` columns: rotor A, torque, e, J e (in a triple: e₁*), Hᵀ e, T, 1 / D."""
THIRD_HINGE = numbered("e13 sense", start=HINGE_ROW.T)
"""Columns of a triple: e₁·e₃, and the sign s = ±1 for which s times the cosine of the middle angle is e₁·e₂×e₃."""


class ArticulatedWork(NamedTuple):
    """Scratch arrays of `articulated`, with the constants of one chain, or of eight."""

    gravity: Any
    layout: Any
    axes: Any
    prescribed: Any
    bodies: Any  # rows of the bodies, and a row of zeros in place of a child where there is none
    hinges: Any  # rows of the hinges
    dry: Any
    flat: Any  # angles, cosines, sines, for a loop over all of them
    trig: Any  # the same memory, by hinge
    forks: Any  # rows of the forks; None for a plain chain
    forces: Any  # force elements; None for a plain chain


@shared
@kernel
def articulated_workspace(chain):
    """Allocate the workspace of `articulated`, and fill in the chain's constants."""
    bodies, hinges, n = chain.bodies, chain.hinges, len(chain.hinges)
    layout, axes = layout_of(bodies, hinges), np.empty(n, np.int64)
    rows, joints = np.zeros((len(bodies) + 1, BODY_ROW.size)), np.zeros((n, HINGE_ROW.size))
    for i in range(len(bodies)):
        b = bodies[i]
        for j in range(9):
            rows[i, BODY_ROW.mount + j] = b.rotation[j % 3, j // 3]
        inertia = sym_add(symmetric(b.inertia), point_inertia(b.mass, vector(b.center)))
        keep(rows, i, (b.mass, scale(b.mass, vector(b.center)), inertia, vector(b.translation)), BODY_ROW.mass)
        keep(rows, i, inertia, BODY_ROW.inertia)
        rows[i, RESTART.restarts] = layout[i, LAYOUT.restart]
    for k in range(n):
        put_joint(joints, k, hinges[k])
        joints[k, HINGE_ROW.armature], axes[k] = hinges[k].armature, hinges[k].axis
    for k in layout[layout[:, LAYOUT.group] == GROUP.triple, LAYOUT.first]:
        joints[k + 2, THIRD_HINGE.sense] = 1.0 if axes[k + 1] == (axes[k] + 1) % 3 else -1.0
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines; padded to full vectors
    return ArticulatedWork(
        chain.gravity.copy(), layout, axes, hinges["prescribed"] != 0, rows, joints,
        dry_joints(joints[:, JOINT.coulomb]), trig, trig, fork_rows(chain, FORK_SIZE), forces_of(chain),
    )  # fmt: skip


@kernel
def articulated_lanes_workspace(chains):
    """The workspace for eight chains with equal hinges side by side, from arrays (8, bodies), (8, n) and (8, 3)."""
    m, n = chains.bodies.shape[1], chains.hinges.shape[1]
    axes, coulomb, layouts = np.empty(n, np.int64), np.zeros(n), np.empty((LANES, m, LAYOUT.size), np.int64)
    base, rows = empty_lanes((3,)), empty_lanes((m + 1, BODY_ROW.size))
    joints, trig = empty_lanes((n, HINGE_ROW.size)), empty_lanes((3, n))
    for lane in range(LANES):
        one = articulated_workspace(one_of(chains, lane))
        axes[:] = one.axes
        layouts[lane] = one.layout
        base[:, lane] = one.gravity
        put_lane(one.bodies, lane, rows)
        put_lane(one.hinges, lane, joints)
        coulomb += one.hinges[:, JOINT.coulomb]
    prescribed, flat = chains.hinges[0]["prescribed"] != 0, trig.reshape(3, n * LANES)
    layout, dry = common_layout(layouts), dry_joints(coulomb)
    return ArticulatedWork(
        base, layout, axes, prescribed, rows, joints, dry, flat, trig,
        fork_lanes(one_of(chains, 0), DEMAND.size), forces_side_by_side(chains),
    )  # fmt: skip


@inlined
def inertia_alone(work):
    """The workspace without force elements; calls are faster, because every array is passed as several numbers."""
    return ArticulatedWork(
        work.gravity, work.layout, work.axes, work.prescribed, work.bodies, work.hinges, work.dry, work.flat, work.trig,
        work.forks, None,
    )  # fmt: skip


@inlined
def axes_of(bodies, i, first):
    """Three vectors that start at column `first` of row `i`."""
    return vec_of(bodies, i, first), vec_of(bodies, i, first + 3), vec_of(bodies, i, first + 6)
