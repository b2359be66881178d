"""Joint torques T due to the drag of a fluid at rest on points of the bodies, in inertial axes.

    forward     kinematics      ω ← ω + e q̇      v ← v + ω × Δp; prismatic joint: v ← v + e q̇
    point       v_i = v + ω × R p        u = v_i·R e_y        w = v_i·R e_z        s = √(u² + w²)
                f_i = −s (d_y u R e_y + d_z w R e_z)        d = ½ ρ c_d b Δx
    backward    f ← f + f_i        n ← n + R p × f_i        T = −e·n; prismatic joint: −e·f        n ← n + Δp × f

T enters the equations of motion as T_FR does: M q̈ = T_EX − T_GC − T_FL − T_FR − T. The power q̇·T = Σ s (d_y u² +
d_z w²) ≥ 0 is dissipated. The same code runs on real and complex numbers: a derivative is the imaginary part at
x + i ε, divided by ε, with ε² below rounding (complex-step method, Squire & Trapp 1998). s is smooth except at s = 0,
where the derivative of the force is 0.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.kinematics import KinematicsWork, kinematics
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, subroutine
from flexlink.kernels.tools.lanes import Turns
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, apply, cross, dot, scale, sub, vector

EPSILON = 1e-100
"""ε of the complex step."""


class Drag(NamedTuple):
    """Force element: drag of links, with scratch arrays of floats or, for derivatives, of complex numbers."""

    chain: Any
    placed: KinematicsWork
    motion: Any  # (bodies, 6) ω of every body, and v of its hinge point
    loads: Any  # (bodies, 6) force on the subtree of every body, and moment about its hinge point
    torque: Any  # (n,) T


class DragSlopes(NamedTuple):
    """Drag with scratch for its derivatives by the complex step."""

    drag: Drag
    turns: Turns  # complex angles (n,)
    rates: Any  # (n,) complex


@allocating
def drag_of(chain):
    """The drag of a chain; without drag the scratch arrays are empty and share memory to save allocations."""
    m, n = drag_sizes(chain)
    points, motion = np.empty((m, 3)), np.empty((m, 6))
    axes, loads = points, motion
    if m > 0:
        axes, loads = np.empty((n, 3)), np.empty((m, 6))
    return Drag(chain, KinematicsWork(np.empty((m, 3, 3)), points, axes), motion, loads, np.empty(n))


@allocating
def drag_slopes_of(chain):
    """Scratch for the derivatives of a chain's drag; without drag the arrays are empty and share memory."""
    (m, n), c = drag_sizes(chain), np.complex128
    points, motion, torque, angles = np.empty((m, 3), c), np.empty((m, 6), c), np.empty(n, c), np.empty((3, n), c)
    axes, loads, rates = points, motion, torque
    if m > 0:
        axes, loads, rates = np.empty((n, 3), c), np.empty((m, 6), c), np.empty(n, c)
    drag = Drag(chain, KinematicsWork(np.empty((m, 3, 3), c), points, axes), motion, loads, torque)
    return DragSlopes(drag, Turns(angles[0], angles[1], angles[2]), rates)


@allocating
def drag_sizes(chain):
    """Numbers of bodies and hinges for which to allocate scratch: 0 and 0 without drag."""
    some = min(1, len(chain.rare.drag))
    return some * len(chain.bodies), some * len(chain.hinges)


@subroutine
def drag_torque(element, q, qd, torque):
    """Add T to `torque` (n,), at angles (n,) and rates (n,); returns the dissipated power q̇·T [W]."""
    power = 0.0
    if len(element.torque) > 0:
        find_torques(element, q, qd)
        for k in range(len(torque)):
            torque[k] += element.torque[k]
            power += qd[k] * element.torque[k]
    return power


@inlined
def find_torques(work, q, qd):
    """Write T to `work.torque`, at rates (n,) and angles (n,); the angles may be `Turns`."""
    put_loads(work, q, qd)
    bodies, hinges, loads, torque = work.chain.bodies, work.chain.hinges, work.loads, work.torque
    points, axes = work.placed.points, work.placed.axes
    for i in range(len(bodies) - 1, -1, -1):
        b, (f, n) = bodies[i], kept(loads, i, (ZERO, ZERO))
        for k in range(b.first, b.stop):
            torque[k] = -dot(vector(axes[k]), f if hinges[k].axis >= SLIDES else n)
        if b.parent > 0:
            step = sub(vector(points[i]), vector(points[b.parent - 1]))
            keep(loads, b.parent - 1, added(loads, b.parent - 1, (f, add(n, cross(step, f)))))


@inlined
def put_loads(work, q, qd):
    """Forward pass: write the force on every body, and the moment about its hinge point."""
    drag = work.chain.rare.drag
    kinematics(work.chain, q, work.placed)
    move(work, qd)
    work.loads[:] = 0.0
    for point in drag:
        pull(point, work.placed.rotations[point.body], work)


@inlined
def move(work, qd):
    """Write ω of every body, and v of its hinge point."""
    chain = work.chain
    bodies, hinges, points, axes = chain.bodies, chain.hinges, work.placed.points, work.placed.axes
    for i in range(len(bodies)):
        b, ω, v = bodies[i], ZERO, ZERO
        if b.parent > 0:
            ω, v = kept(work.motion, b.parent - 1, (ω, v))
            v = add(v, cross(ω, sub(vector(points[i]), vector(points[b.parent - 1]))))
        for k in range(b.first, b.stop):
            if hinges[k].axis >= SLIDES:
                v = add_scaled(v, qd[k], vector(axes[k]))
            else:
                ω = add_scaled(ω, qd[k], vector(axes[k]))
        keep(work.motion, i, (ω, v))


@inlined
def pull(point, R, work):
    """Add the drag force at a point, and its moment, to the loads of the body."""
    lever, (ω, v) = apply(R, vector(point.point)), kept(work.motion, point.body, (ZERO, ZERO))
    v = add(v, cross(ω, lever))
    y, z = apply(R, vector(point.across[0])), apply(R, vector(point.across[1]))
    u, w = dot(v, y), dot(v, z)
    s = np.sqrt(u * u + w * w)
    f = add(scale(-s * point.drag[0] * u, y), scale(-s * point.drag[1] * w, z))
    keep(work.loads, point.body, added(work.loads, point.body, (f, cross(lever, f))))


@kernel
def drag_loads(chain, q, qd):
    """Drag force on every body and moment about its hinge point, in frame 0, in a new array (bodies, 2, 3)."""
    drag = drag_of(chain)
    put_loads(drag, q, qd)
    return drag.loads.reshape(-1, 2, 3)


@subroutine
def drag_slopes(element, q, qd, by_angle, by_rate):
    """Add ∂T/∂q to `by_angle` and ∂T/∂q̇ to `by_rate`, (n, n) each; O(n²)."""
    work, turns, rates, moves = element.drag, element.turns, element.rates, False
    for k in range(len(work.torque)):
        moves = moves or qd[k] != 0.0
        turns.cosines[k], turns.sines[k], turns.angles[k] = np.cos(q[k]), np.sin(q[k]), q[k]
        rates[k] = qd[k]
    if not moves:
        return
    for j in range(len(q)):
        turns.cosines[j] = complex(np.cos(q[j]), -EPSILON * np.sin(q[j]))
        turns.sines[j] = complex(np.sin(q[j]), EPSILON * np.cos(q[j]))
        turns.angles[j] = complex(q[j], EPSILON)
        find_torques(work, turns, rates)
        turns.cosines[j], turns.sines[j], turns.angles[j] = np.cos(q[j]), np.sin(q[j]), q[j]
        for i in range(len(q)):
            by_angle[i, j] += work.torque[i].imag / EPSILON
        rates[j] = complex(qd[j], EPSILON)
        find_torques(work, turns, rates)
        rates[j] = qd[j]
        for i in range(len(q)):
            by_rate[i, j] += work.torque[i].imag / EPSILON
