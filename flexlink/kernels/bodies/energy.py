"""Energies, momenta and centre of mass of a chain, summed over its bodies: an independent check of ½ q̇ᵀ M q̇."""

from flexlink.kernels.forces.elements import elastic_energy, forces_of
from flexlink.kernels.geometry.kinematics import forward_kinematics, kinematics, kinematics_workspace, motion_of
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import kernel, recursion, subroutine
from flexlink.kernels.tools.vec3 import ZERO, add, apply, apply_transposed, cross, dot, put, scale, sub, vector


@kernel
def energies(chain, q, qd):
    """Return T = Σ ½ m v² + ½ ω·Iω + ½ armature q̇², V_g = −Σ m g·p_c and the energy V_e of all springs [J]."""
    return energies_of(chain, q, qd, forward_kinematics(chain, q), forces_of(chain))


@recursion
def energies_of(chain, q, qd, placed, forces):
    """Return T, V_g and V_e, given the kinematics `placed` and the force elements `forces` of the chain."""
    bodies, hinges = chain.bodies, chain.hinges
    rotations, points, axes = placed.rotations, placed.points, placed.axes
    kinetic, gravity, elastic = 0.0, 0.0, 0.0
    ω, v, p = ZERO, ZERO, ZERO
    for i in range(len(bodies)):
        b = bodies[i]
        if chain.rare is not None and b.begins:
            ω, v = motion_of(chain, b.parent, qd, placed)
            p = vector(points[b.parent - 1]) if b.parent > 0 else ZERO
        v = add(v, cross(ω, sub(vector(points[i]), p)))
        p = vector(points[i])
        for k in range(b.first, b.stop):
            if chain.rare is not None and hinges[k].axis >= SLIDES:
                v = slid(v, qd[k], axes[k])
            else:
                ω = add(ω, scale(qd[k], vector(axes[k])))
            kinetic += 0.5 * hinges[k].armature * qd[k] ** 2
            elastic += 0.5 * hinges[k].stiffness * (q[k] - hinges[k].rest) ** 2
        lever = apply(rotations[i], vector(b.center))
        v_center = add(v, cross(ω, lever))
        ω_body = apply_transposed(rotations[i], ω)
        kinetic += 0.5 * b.mass * dot(v_center, v_center) + 0.5 * dot(ω_body, apply(b.inertia, ω_body))
        gravity -= b.mass * dot(vector(chain.gravity), add(p, lever))
    if forces is not None:
        elastic += elastic_energy(forces.elements, q)
    return kinetic, gravity, elastic


@subroutine
def slid(v, rate, axis):
    """Velocity v + rate · axis of the point after a prismatic hinge, from the velocity v of the point before it."""
    return add(v, scale(rate, vector(axis)))


@kernel
def momenta(chain, qs, qds, found):
    """Write Σ m v, Σ (c × m v + I ω) and Σ m c / Σ m of states (rows, n) to `found` (rows, 3, 3), in frame 0.

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
                    v = add(v, scale(qd[k], vector(placed.axes[k])))
                else:
                    ω = add(ω, scale(qd[k], vector(placed.axes[k])))
            R, lever = placed.rotations[i], apply(placed.rotations[i], vector(b.center))
            own, c = scale(b.mass, add(v, cross(ω, lever))), add(p, lever)
            P, mc, m = add(P, own), add(mc, scale(b.mass, c)), m + b.mass
            L = add(L, add(cross(c, own), apply(R, apply(b.inertia, apply_transposed(R, ω)))))
        put(found[row, 0], P)
        put(found[row, 1], L)
        put(found[row, 2], scale(1.0 / m, mc))
