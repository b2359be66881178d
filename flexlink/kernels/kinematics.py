"""Forward kinematics: where every body and hinge axis is, in frame 0.

p ← p + R r        R ← R R_mount        axis_k = R e_k        R ← R R_k(q_k)
"""

from flexlink.kernels.compiler import recursion
from flexlink.kernels.vec3 import ZERO, X, Y, Z, add, cos_sin, pick, place, place_axes, put, turn_axes, vector


@recursion
def kinematics(chain, q, rotations, points, axes):
    """Write R of every body (nb, 3, 3), its hinge point p (nb, 3) and every hinge axis (n, 3), frame 0."""
    bodies, hinges = chain.bodies, chain.hinges
    x, y, z = X, Y, Z  # columns of R
    p = ZERO
    for i in range(len(bodies)):
        b = bodies[i]
        p = add(p, place(vector(b.translation), x, y, z))
        put(points[i], p)
        if b.turned:
            x, y, z = place_axes(b.rotation, x, y, z)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            put(axes[k], pick(axis, x, y, z))
            c, s = cos_sin(q[k])
            x, y, z = turn_axes(axis, c, s, x, y, z)
        for row in range(3):
            put(rotations[i, row], (x[row], y[row], z[row]))
