"""Forward kinematics: where every body and hinge axis is, in frame 0.

p ← p + R r        R ← R R_mount        axis_k = R e_k        R ← R R_k(q_k)
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.lanes import cos_sin_of, put_vec_of, zero_of
from flexlink.kernels.tools.vec3 import add, pick, place, place_axes, put, turn_axes, vector


class KinematicsWork(NamedTuple):
    """What `kinematics` writes, in frame 0."""

    rotations: Any  # R of every body, (nb, 3, 3)
    points: Any  # hinge point p of every body, (nb, 3)
    axes: Any  # of every hinge, (n, 3)


@kernel
def kinematics_workspace(chain):
    """Scratch of `kinematics` for a chain."""
    m, n = len(chain.bodies), len(chain.hinges)
    return KinematicsWork(np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((n, 3)))


@kernel
def forward_kinematics(chain, q):
    """R and p of every body and all hinge axes, in new arrays."""
    work = kinematics_workspace(chain)
    kinematics(chain, q, work)
    return work


@kernel
def tip_points(chain, qs, tips):
    """Write the origin of the tip frame, (states, 3), at the angles of each state, (states, n)."""
    work = kinematics_workspace(chain)
    for row in range(len(qs)):
        kinematics(chain, qs[row], work)
        put(tips[row], vector(work.points[-1]))


@recursion
def kinematics(chain, q, work):
    """Write R and p of every body and all hinge axes, at angles (n,), or `Turns` of eight states side by side."""
    bodies, hinges = chain.bodies, chain.hinges
    rotations, points, axes = work.rotations, work.points, work.axes
    o = zero_of(points, 0, 0)
    x, y, z = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o)  # columns of R
    p = (o, o, o)
    for i in range(len(bodies)):
        b = bodies[i]
        p = add(p, place(vector(b.translation), x, y, z))
        put_vec_of(points, p, i, 0)
        if b.turned:
            x, y, z = place_axes(b.rotation, x, y, z)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            put_vec_of(axes, pick(axis, x, y, z), k, 0)
            c, s = cos_sin_of(q, k)
            x, y, z = turn_axes(axis, c, s, x, y, z)
        for row in range(3):
            put_vec_of(rotations[i], (x[row], y[row], z[row]), row, 0)
