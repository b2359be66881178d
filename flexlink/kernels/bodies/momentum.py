"""Linear momentum, angular momentum and centre of mass of a chain, summed over its bodies, in frame 0."""

from flexlink.kernels.geometry.kinematics import kinematics, kinematics_workspace, motion_of
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, apply, apply_transposed, cross, put, scale, sub, vector


@kernel
def momenta(chain, qs, qds, found):
    """Write Σ m v, Σ (c × m v + I ω) and Σ m c / Σ m of states (rows, n) to `found` (rows, 3, 3).

    The angular momentum is about the origin. c is the centre of mass of a body, v the velocity of c.
    """
    placed = kinematics_workspace(chain)
    bodies, hinges = chain.bodies, chain.hinges
    for row in range(len(qs)):
        qd = qds[row]
        kinematics(chain, qs[row], placed)
        P, L, mc, m = ZERO, ZERO, ZERO, 0.0
        ω, v, p = ZERO, ZERO, ZERO
        for i in range(len(bodies)):
            b = bodies[i]
            if chain.rare is not None and b.begins:
                ω, v = motion_of(chain, b.parent, qd, placed)
                p = vector(placed.points[b.parent - 1]) if b.parent > 0 else ZERO
            v = add(v, cross(ω, sub(vector(placed.points[i]), p)))
            p = vector(placed.points[i])
            for k in range(b.first, b.stop):
                if chain.rare is not None and hinges[k].axis >= SLIDES:
                    v = add_scaled(v, qd[k], vector(placed.axes[k]))
                else:
                    ω = add_scaled(ω, qd[k], vector(placed.axes[k]))
            R, lever = placed.rotations[i], apply(placed.rotations[i], vector(b.center))
            own, c = scale(b.mass, add(v, cross(ω, lever))), add(p, lever)
            P, mc, m = add(P, own), add_scaled(mc, b.mass, c), m + b.mass
            L = add(L, add(cross(c, own), apply(R, apply(b.inertia, apply_transposed(R, ω)))))
        put(found[row, 0], P)
        put(found[row, 1], L)
        put(found[row, 2], scale(1.0 / m, mc))
