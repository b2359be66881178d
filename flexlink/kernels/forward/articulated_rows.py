"""Rows of numbers that `articulated` works on: one row per body and per hinge, contiguous, as an array of float64."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.elements import eight_of, forces_of, forces_side_by_side
from flexlink.kernels.forces.joint_torques import JOINT, dry_joints, prescribed_joints, put_joint
from flexlink.kernels.forward.articulated_branches import DEMAND, FORK_SIZE
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT, common_layout, layout_of
from flexlink.kernels.geometry.branches import fork_lanes, fork_rows
from flexlink.kernels.layout import ChainArrays
from flexlink.kernels.tools.compiler import inlined, kernel, shared
from flexlink.kernels.tools.lanes import LANES, empty_lanes, put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sym3 import point_inertia, sym_add, symmetric
from flexlink.kernels.tools.vec3 import scale, vector

BODY_ROW = numbered(
    # Fixed: columns of the mount's rotation, and reach, its hinge point, in axes of what it hangs on; mass, m c and
    # inertia about the hinge point in its own.
    "mount:9 mass moment:3 own_inertia:6 reach:3",
    # Of the state, working axes: x_j, m c, ζ = Σ q̇_k ω × e_k, f = m ω × (ω × c); inertia and n = ω × I ω along x_j.
    # These are the axes of the body, but of a pair e₂, e₁, e₂ × e₁. In the working axes before those that may begin at
    # this body: r, from the hinge point that it hangs on to its own, and b = ω × (ω × r), with ω of what it hangs on;
    # where it slides, too, b has 2 q̇ ω × e of each hinge.
    "axes:9 r:3 mc:3 b:3 ζ:3 f:3 inertia:6 n:3",
    # Of a pair or triple, once J is eliminated: h_j / D_j, the factors of J, α and 1 / D_j.
    "h_D:9 factors:3 α:3 inverses:3",
)
RESTART = numbered("axes_before:9 restarts", start=BODY_ROW.h_D)
"""Where working axes may restart, of no pair or triple: the axes before in these (columns), and whether, 1 or 0."""
HINGE_ROW = numbered("armature torque axis:3 Je:3 He:3 T inverse", start=JOINT.size)
"""Numbers of a hinge, after those of its joint: rotor A, torque, e, J e, Hᵀ e, T, 1 / D; in a triple e₁* for J e."""
THIRD_HINGE = numbered("e13 sense", start=HINGE_ROW.T)
"""Of a triple: e₁·e₃, and 1 or −1, the sense of the axes, with which the cosine of the middle angle is e₁·e₂×e₃."""


class ArticulatedWork(NamedTuple):
    """Scratch of `articulated`, with the constants of a chain, or of eight."""

    gravity: Any
    layout: Any
    axes: Any
    prescribed: Any
    bodies: Any  # rows of numbers of the bodies, and one of zeros: nothing hangs on the last
    hinges: Any  # and of the hinges
    dry: Any
    flat: Any  # angles, cosines and sines, for the loop over all of them
    trig: Any  # the same memory, for the hinges
    forks: Any  # rows of what branches go on from, and of what they demand; None of a plain chain
    forces: Any  # force elements; likewise


@shared
@kernel
def articulated_workspace(bodies, hinges, gravity, rare):
    """Scratch of `articulated` with the chain's constants."""
    n = len(hinges)
    layout, axes = layout_of(bodies, hinges), np.empty(n, np.int64)
    rows, joints = np.zeros((len(bodies) + 1, BODY_ROW.size)), np.zeros((n, HINGE_ROW.size))
    for i in range(len(bodies)):
        b = bodies[i]
        for j in range(9):
            rows[i, BODY_ROW.mount + j] = b.rotation[j % 3, j // 3]
        rows[i, BODY_ROW.mass], rows[i, RESTART.restarts] = b.mass, layout[i, LAYOUT.restart]
        put_vec_of(rows, scale(b.mass, vector(b.center)), i, BODY_ROW.moment)
        inertia = sym_add(symmetric(b.inertia), point_inertia(b.mass, vector(b.center)))
        for j in range(6):
            rows[i, BODY_ROW.own_inertia + j] = rows[i, BODY_ROW.inertia + j] = inertia[j]
        put_vec_of(rows, vector(b.translation), i, BODY_ROW.reach)
    for k in range(n):
        put_joint(joints, k, hinges[k])
        joints[k, HINGE_ROW.armature], axes[k] = hinges[k].armature, hinges[k].axis
    for k in layout[layout[:, LAYOUT.group] == GROUP.triple, LAYOUT.first]:
        joints[k + 2, THIRD_HINGE.sense] = 1.0 if axes[k + 1] == (axes[k] + 1) % 3 else -1.0
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines; whole vectors of angles
    chain, dry = ChainArrays(bodies, hinges, gravity, rare), dry_joints(joints[:, JOINT.coulomb])
    return ArticulatedWork(
        gravity.copy(), layout, axes, prescribed_joints(hinges), rows, joints, dry, trig, trig,
        fork_rows(chain, FORK_SIZE), forces_of(chain),
    )  # fmt: skip


@kernel
def articulated_lanes_workspace(bodies, hinges, gravity, rare):
    """The same for eight chains side by side, arrays (8, bodies), (8, n), (8, 3), and what is rare; alike in hinges."""
    m, n, chains = bodies.shape[1], hinges.shape[1], eight_of(bodies, hinges, gravity, rare)
    axes, coulomb, layouts = np.empty(n, np.int64), np.zeros(n), np.empty((LANES, m, LAYOUT.size), np.int64)
    base, rows = empty_lanes((3,)), empty_lanes((m + 1, BODY_ROW.size))
    joints, trig = empty_lanes((n, HINGE_ROW.size)), empty_lanes((3, n))
    for lane in range(LANES):
        chain = chains[lane]
        one = articulated_workspace(chain.bodies, chain.hinges, chain.gravity, chain.rare)
        axes[:] = one.axes
        layouts[lane] = one.layout
        base[:, lane], rows[:, :, lane], joints[:, :, lane] = gravity[lane], one.bodies, one.hinges
        coulomb += one.hinges[:, JOINT.coulomb]
    prescribed, flat = prescribed_joints(hinges[0]), trig.reshape(3, n * LANES)
    layout, dry = common_layout(layouts), dry_joints(coulomb)
    return ArticulatedWork(
        base, layout, axes, prescribed, rows, joints, dry, flat, trig,
        fork_lanes(chains[0], DEMAND.size), forces_side_by_side(chains),
    )  # fmt: skip


@inlined
def inertia_alone(work):
    """The scratch without force elements: a call hands over every number that describes its arrays."""
    return ArticulatedWork(
        work.gravity, work.layout, work.axes, work.prescribed, work.bodies, work.hinges, work.dry, work.flat, work.trig,
        work.forks, None,
    )  # fmt: skip


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
