"""Forward kinematics: where every body and hinge axis is, in frame 0.

p ← p + R r        R ← R R_mount        axis_k = R e_k        R ← R R_k(q_k)
"""

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.vec3 import cos_sin


@kernel
def kinematics(chain, q, rotations, points, axes):
    """Write R of every body (nb, 3, 3), its hinge point p (nb, 3) and every hinge axis (n, 3), frame 0."""
    bodies, hinges = chain.bodies, chain.hinges
    R = np.eye(3)
    p = np.zeros(3)
    for i in range(len(bodies)):
        b = bodies[i]
        for row in range(3):
            r = b.translation
            p[row] += R[row, 0] * r[0] + R[row, 1] * r[1] + R[row, 2] * r[2]
            points[i, row] = p[row]
        if b.turned:
            for row in range(3):
                x, y, z = R[row, 0], R[row, 1], R[row, 2]
                for column in range(3):
                    m = b.rotation
                    R[row, column] = x * m[0, column] + y * m[1, column] + z * m[2, column]
        for k in range(b.first, b.stop):
            e = hinges[k].axis
            u, v = (e + 1) % 3, (e + 2) % 3  # the two columns that the rotation about e mixes
            c, s = cos_sin(q[k])
            for row in range(3):
                axes[k, row] = R[row, e]
                x, y = R[row, u], R[row, v]
                R[row, u] = c * x + s * y
                R[row, v] = c * y - s * x
        rotations[i] = R
