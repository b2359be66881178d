"""Constants of one planar chain, or of eight side by side: the links at q = 0, projected once onto the plane of motion.

All planar recursions read these constants: forward dynamics (`planar`), inverse dynamics (`planar_rne`), solutions of
(M + A) x = r, and derivatives.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.elements import forces_of, forces_side_by_side, one_of
from flexlink.kernels.forces.joint_torques import JOINT, dry_joints, put_joint
from flexlink.kernels.tools.axes3 import X, Y, Z, pick, place_axes, rotate, unit
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion
from flexlink.kernels.tools.lanes import LANES, at, put_at, put_lane, vec, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sincos import cos_sin_all, less_whole_turns
from flexlink.kernels.tools.sym3 import sym_apply, symmetric
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, put, scale, vector

LINK = numbered(
    "sign armature mass inertia",  # sign σ of the hinge axis, armature A, mass, inertia I about the hinge point
    "rx ry sx sy",  # r to the next hinge (last link: to the tip) and s = m c, at q = 0
    "rate2 torque dx dy",  # in the current state: ω², τ, d (r turned by 90°)
    "ux uy α β γ",  # H / D, T / D, A / D, 1 − A / D
    start=JOINT.size,
)
"""Columns of a link, which follow the columns `JOINT` of its hinge."""
BASE = numbered("u:3 v:3 normal:3 gravity:3")
"""Entries of the base: in-plane axes u and v, normal (right-handed) and gravity, in frame 0."""


class PlanarWork(NamedTuple):
    """Scratch of `planar`, with the constants of one chain or of eight."""

    base: Any
    links: Any
    prescribed: Any
    dry: Any
    flat: Any  # angles, cosines and sines as flat arrays, for one SIMD loop
    trig: Any  # the same memory, indexed by link
    forces: Any  # force elements; None for a plain chain


@kernel
def planar_workspace(chain):
    """Scratch of `planar` with the chain's constants."""
    bodies, hinges, n = chain.bodies, chain.hinges, len(chain.hinges)
    base, links = np.zeros(12), np.zeros((n, LINK.size))
    put(base[BASE.gravity :], vector(chain.gravity))
    x, y, z = X, Y, Z
    to_body = ZERO  # from the hinge of the current link to the origin of the current body
    k = -1
    for i in range(len(bodies)):
        b = bodies[i]
        to_body = add(to_body, rotate(vector(b.translation), x, y, z))
        x, y, z = place_axes(b.rotation, x, y, z)
        if k >= 0:
            links[k, LINK.rx], links[k, LINK.ry] = in_plane(base, to_body)
        for j in range(b.first, b.stop):
            axis = pick(hinges[j].axis, x, y, z)
            if k < 0:
                span_plane(axis, base)
            k, to_body = j, ZERO
            links[k, LINK.sign] = np.sign(dot(axis, vec(base, BASE.normal)))
            put_joint(links, k, hinges[k])
            links[k, LINK.armature] = hinges[k].armature
        if k >= 0:
            cx, cy = in_plane(base, add(to_body, rotate(vector(b.center), x, y, z)))
            normal = (dot(x, vec(base, BASE.normal)), dot(y, vec(base, BASE.normal)), dot(z, vec(base, BASE.normal)))
            links[k, LINK.mass] += b.mass
            links[k, LINK.sx] += b.mass * cx
            links[k, LINK.sy] += b.mass * cy
            own = dot(normal, sym_apply(symmetric(b.inertia), normal))
            links[k, LINK.inertia] += own + b.mass * (cx * cx + cy * cy)
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines, padded to full SIMD vectors
    return PlanarWork(
        base, links, hinges["prescribed"] != 0, dry_joints(links[:, JOINT.coulomb]), trig, trig, forces_of(chain)
    )


@kernel
def planar_lanes_workspace(chains):
    """Scratch of `planar` for eight chains side by side, with bodies (8, bodies), hinges (8, n) and gravity (8, 3)."""
    n = chains.hinges.shape[1]
    base, links, coulomb = np.empty((12, LANES)), np.empty((n, LINK.size, LANES)), np.zeros(n)
    trig = np.empty((3, n * LANES))
    for lane in range(LANES):
        one = planar_workspace(one_of(chains, lane))
        base[:, lane] = one.base
        put_lane(one.links, lane, links)
        coulomb += one.links[:, JOINT.coulomb]
    prescribed, dry = chains.hinges[0]["prescribed"] != 0, dry_joints(coulomb)
    return PlanarWork(base, links, prescribed, dry, trig, trig.reshape(3, n, LANES), forces_side_by_side(chains))


@allocating
def span_plane(normal, base):
    """Write u, v and normal to `base`; for a normal along a coordinate axis, u and v are along the other two axes."""
    least = 0
    for k in range(1, 3):
        if abs(normal[k]) < abs(normal[least]):
            least = k
    u = add_scaled(unit(least), -normal[least], normal)
    u = scale(1.0 / math.sqrt(dot(u, u)), u)
    put(base[BASE.u :], u)
    put(base[BASE.v :], cross(normal, u))
    put(base[BASE.normal :], normal)


@inlined
def in_plane(base, a):
    """Components of a along u and v."""
    return dot(vec(base, BASE.u), a), dot(vec(base, BASE.v), a)


@recursion
def cos_sin_less_turns(q, links, flat, angles):
    """Recompute cosines and sines after removing whole turns from each joint angle; `angles` is a view of `flat[0]`."""
    for k in range(len(q)):
        put_at(angles, at(q, k), k)
    less_whole_turns(flat[0])
    φ = zero_of(q)
    for k in range(len(q)):
        φ += at(links, k, LINK.sign) * at(angles, k)
        put_at(angles, φ, k)
    cos_sin_all(flat[0], flat[1], flat[2])
