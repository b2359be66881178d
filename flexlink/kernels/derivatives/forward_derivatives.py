"""Derivatives of forward dynamics with respect to all angles, rates and torques, O(n²).

The articulated-body algorithm runs once, for q̈ and the factors of M. For each column of ∂q̈/∂q and ∂q̈/∂q̇, the change
of each body's load is then applied to it as a force, and the factors give the change of q̈, eight columns at once.
(The product M⁻¹ ∂T/∂q would sum the loads of all bodies outboard of a joint and separate them again, losing digits.)

The force f and the moment n that a body outboard of hinge j requires, about the hinge point p of the body, change as
follows, with ρ = p − p_j, the velocity v of p, and the symbols of `inverse_derivatives`:

    δa = δa_j + η_j × ρ + 2 δω_j × (v − v_j)
    f = m δa + η_j × m c + 2 δω_j × (ω × m c)          n = m c × δa + I η_j − 2 G δω_j

A change of an angle also rotates the force and moment that the hinge transmits: the body inboard of the hinge bears
e_j × f_j and e_j × n_j. A change of a prescribed acceleration gives η_j = e_j alone. A prismatic hinge changes only δa,
and its displacement changes the lever arm of its load, so the body inboard of it bears a moment e_j × f_j.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.inverse_derivatives import (
    BODY_MOTION,
    HINGE_MOTION,
    keep_columns,
    motion_workspace,
    of_hinge,
    outward,
    own_spin,
)
from flexlink.kernels.forces.elements import Slopes, find_slopes, force_slopes_of
from flexlink.kernels.forward.articulated_layout import LAYOUT
from flexlink.kernels.forward.articulated_rows import (
    BODY_ROW,
    RESTART,
    ArticulatedWork,
    articulated_workspace,
    axes_of,
    inertia_alone,
)
from flexlink.kernels.forward.inverse_mass import solve_on_articulated
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import X, Y, Z, rotate
from flexlink.kernels.tools.compiler import inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.finite import are_finite, is_finite
from flexlink.kernels.tools.lanes import LANES, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.sym3 import sym_apply, sym_of
from flexlink.kernels.tools.vec3 import ZERO, add, cross, dot, scale, sub

VARIABLE = numbered("q qd tau")  # the derivatives are with respect to these


class ForwardDerivativesWork(NamedTuple):
    """Scratch of `derivatives_in_space`, with the constants of a chain."""

    factors: ArticulatedWork
    solution: Any  # (2, n) T_EX and q̈
    slopes: Slopes | None  # derivatives of force elements; None for a plain chain
    motion: Any  # results of `outward`
    axes: Any  # (bodies, 9) working axes in frame 0
    accelerations: Any  # (bodies, 6) α of the body and a − g of its hinge point, frame 0
    transmitted: Any  # (bodies, 6) moment and force at the hinge point, frame 0
    loads: Any  # (bodies, 6, 8)
    r: Any  # (n, 8)
    x: Any  # (n, 8)


@kernel
def forward_derivatives_workspace(chain):
    """Scratch of `derivatives_in_space` for a chain."""
    n, m, factors = len(chain.hinges), len(chain.bodies), articulated_workspace(chain)
    return ForwardDerivativesWork(
        factors, np.empty((2, n)), force_slopes_of(chain, factors.forces), motion_workspace(chain),
        np.empty((m, 9)), np.empty((m, 6)), np.empty((m, 6)), np.empty((m, 6, LANES)),
        np.empty((n, LANES)), np.empty((n, LANES)),
    )  # fmt: skip


@subroutine
def derivatives_in_space(chain, wrench, q, qd, tau, found, work):
    """Write ∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX to `found`, (n, n) each; return whether all are finite. `work` is scratch.

    The column of a prescribed joint in ∂q̈/∂T_EX is the derivative with respect to its given acceleration.
    """
    n, hinges, factors, torque, qdd = len(q), chain.hinges, work.factors, work.solution[0], work.solution[1]
    begin(tau, torque, qdd)
    forward_dynamics(wrench, q, qd, torque, qdd, factors)
    keep_solution(factors, work.axes, work.accelerations)
    force, moment = outward(chain, wrench, False, q, qd, qdd, work.accelerations, work.motion)
    transmit(chain, force, moment, work)
    if work.slopes is not None:
        find_slopes(work.slopes, q, qd)
    for variable in range(3):
        for first in range((n - 1) // LANES * LANES, -1, -LANES):
            write_loads(chain, qd, variable, first, work)
            solve_on_articulated(work.r, work.loads, work.x, inertia_alone(factors))
            keep_columns(work.x, first, found[variable])
    keep_prescribed(hinges, found[VARIABLE.tau])
    return is_finite(q) and is_finite(qd) and is_finite(tau) and is_finite(qdd) and are_finite(found)


@recursion
def begin(tau, torque, qdd):
    """Copy the drive torques to `torque`, where forward dynamics adds torques of prescribed joints; set q̈ to 0."""
    for k in range(len(tau)):
        torque[k], qdd[k] = tau[k], 0.0


@recursion
def transmit(chain, force, moment, work):
    """Write the force and moment that the hinges of every body transmit, by the backward pass of `rne`."""
    rows, transmitted = work.motion.bodies, work.transmitted
    f = n = ZERO
    if chain.rare is not None:
        transmitted[:] = 0.0  # each branch adds its load to the row of the body on which it begins
    for i in range(len(chain.bodies) - 1, -1, -1):
        b = chain.bodies[i]
        if chain.rare is not None and b.fork > 0:
            n, f = added(transmitted, i, (n, f))
        if b.loaded:
            f, n = scale(-1.0, force), scale(-1.0, moment)
        f, n = add(f, vec_of(rows, i, BODY_MOTION.F)), add(n, vec_of(rows, i, BODY_MOTION.N))
        keep(transmitted, i, (n, f))
        n = add(n, cross(vec_of(rows, i, BODY_MOTION.r), f))
        if chain.rare is not None and b.begins:
            if b.parent > 0:
                keep(transmitted, b.parent - 1, added(transmitted, b.parent - 1, (n, f)))
            f = n = ZERO


@recursion
def keep_solution(factors, axes, accelerations):
    """Write, in frame 0, the working axes at every body and the accelerations, both as found by `articulated`."""
    x, y, z = X, Y, Z
    for i in range(len(axes)):
        if factors.forks is not None and factors.layout[i, LAYOUT.begins]:
            parent = factors.layout[i, LAYOUT.parent]
            x, y, z = axes_of(axes, parent - 1, 0) if parent > 0 else (X, Y, Z)
        if factors.layout[i, LAYOUT.restart]:
            u, v, w = axes_of(factors.bodies, i, RESTART.axes_before)
            x, y, z = rotate(u, x, y, z), rotate(v, x, y, z), rotate(w, x, y, z)
        keep(axes, i, (x, y, z))
        α, a = vec_of(factors.bodies, i, BODY_ROW.ζ), vec_of(factors.bodies, i, BODY_ROW.b)
        keep(accelerations, i, (rotate(α, x, y, z), rotate(a, x, y, z)))


# Inlined, since a call would pass the 500 numbers that describe the arrays of `work`, which takes a third of the time.
@inlined
def write_loads(chain, qd, variable, first, work):
    """Write the loads on joints and bodies for the eight columns from `first` on."""
    joint_loads(chain.hinges, qd, variable, first, work.r)
    if work.slopes is not None and rarely(work.slopes.act) and variable != VARIABLE.tau:
        force_loads(work.slopes.found[variable], first, work.r)
    body_loads(chain, variable, first // LANES, work)
    if work.motion.slides is not None and len(work.motion.slides) > 0 and variable != VARIABLE.q:
        slide_loads(chain, variable, first, work.motion, work.axes, work.loads)
    if work.motion.forks is not None and len(work.motion.forks) > 0:
        part_branches(chain.bodies, first, work.loads)
    if variable == VARIABLE.q:
        for i in range(len(chain.bodies)):
            for j in range(max(first, chain.bodies[i].first), min(first + LANES, chain.bodies[i].stop)):
                turn_transmitted(chain, i, j, j - first, work.r, work.loads, work)


@recursion
def joint_loads(hinges, qd, variable, first, r):
    """Write to r the joint torques due to unit changes of angles, rates or drive torques, columns from `first` on."""
    r[:] = 0.0
    for j in range(first, min(first + LANES, len(r))):
        if variable == VARIABLE.q:
            r[j, j - first] = -hinges[j].stiffness
        elif variable == VARIABLE.qd:
            r[j, j - first] = -friction_derivative(hinges[j], qd[j])
        elif not hinges[j].prescribed:
            r[j, j - first] = 1.0


@recursion
def force_loads(slopes, first, r):
    """Subtract the derivatives `slopes` (n, n) of the force elements' torques from r, columns from `first` on."""
    for k in range(len(r)):
        for j in range(first, min(first + LANES, len(r))):
            r[k, j - first] -= slopes[k, j]


@recursion
def keep_prescribed(hinges, by_input):
    """Write 1 on the diagonal for prescribed joints: the derivative of a given acceleration with respect to itself."""
    for k in range(len(hinges)):
        if hinges[k].prescribed:
            by_input[k, k] = 1.0


@inlined
def turn_transmitted(chain, i, j, lane, r, loads, work):
    """Add the loads on the parent and earlier hinges of body `i` when hinge `j` rotates or shifts its own load."""
    hinges = work.motion.hinges
    e, parent = of_hinge(hinges, j, HINGE_MOTION.e), chain.bodies[i].parent - 1
    n, f = cross(e, vec_of(work.transmitted, i, 0)), cross(e, vec_of(work.transmitted, i, 3))
    if chain.rare is not None and chain.hinges[j].axis >= SLIDES:
        n, f = f, ZERO
    else:
        for k in range(chain.bodies[i].first, j):
            r[k, lane] -= dot(of_hinge(hinges, k, HINGE_MOTION.e), n)
    if parent >= 0:
        n = in_axes(work.axes, parent, add(n, cross(vec_of(work.motion.bodies, i, BODY_MOTION.r), f)))
        own = loads[parent].T
        keep(own, lane, added(own, lane, (n, in_axes(work.axes, parent, f))))


@inlined
def in_axes(axes, i, a):
    """Components of the vector a along the working axes of body `i`."""
    return dot(vec_of(axes, i, 0), a), dot(vec_of(axes, i, 3), a), dot(vec_of(axes, i, 6), a)


@inlined
def body_loads(chain, variable, block, work):
    """Write the loads on the bodies outboard of the hinges of a block, and 0 for all other bodies."""
    loads, first, prescribed = work.loads, block * LANES, any_prescribed(chain.hinges)
    for i in range(len(chain.bodies)):
        beyond = chain.bodies[i].stop - first
        if beyond > 0 and (variable != VARIABLE.tau or prescribed):
            n, f = load_of_body(work.motion.bodies, work.motion.hinges, i, chain.bodies[i].mass, variable, block)
            if chain.bodies[i].loaded and variable == VARIABLE.q:
                n = sub(n, vec_of(work.motion.hinges, block, HINGE_MOTION.δm))
                f = sub(f, vec_of(work.motion.hinges, block, HINGE_MOTION.δF))
            keep(loads, i, (in_axes(work.axes, i, n), in_axes(work.axes, i, f)))
        else:
            beyond = 0
        for lane in range(LANES):
            if lane >= beyond or (variable == VARIABLE.tau and not chain.hinges[first + lane].prescribed):
                loads[i, :, lane] = 0.0


@subroutine
def slide_loads(chain, variable, first, motion, axes, loads):
    """Overwrite the loads due to rates or given accelerations of prismatic hinges in the block from `first` on."""
    for number in range(len(motion.slides)):
        j = motion.slides[number]
        if first <= j < first + LANES and (variable == VARIABLE.qd or chain.hinges[j].prescribed):
            δa = of_hinge(motion.hinges, j, HINGE_MOTION.e)
            if variable == VARIABLE.qd:
                δa = scale(2.0, of_hinge(motion.hinges, j, HINGE_MOTION.δv))
            for i in range(len(chain.bodies)):
                if chain.bodies[i].stop > j:
                    n = in_axes(axes, i, cross(vec_of(motion.bodies, i, BODY_MOTION.mc), δa))
                    keep(loads[i].T, j - first, (n, in_axes(axes, i, scale(chain.bodies[i].mass, δa))))


@subroutine
def part_branches(bodies, first, loads):
    """Set to 0 the loads due to hinges from `first` on at the bodies that these hinges do not move."""
    for i in range(len(bodies)):
        number, stop = i + 1, first + LANES
        while stop > first:
            begin = bodies[number - 1].first if number > 0 else 0
            own = bodies[number - 1].stop if number > 0 else 0
            for j in range(max(first, own), stop):
                loads[i, :, j - first] = 0.0
            stop, number = min(stop, begin), bodies[number - 1].parent if number > 0 else 0


@inlined
def load_of_body(bodies, hinges, i, m, variable, block):
    """Moment and force that body `i` requires for unit changes of the eight hinges of a block."""
    mc, ω, I = vec_of(bodies, i, BODY_MOTION.mc), vec_of(bodies, i, BODY_MOTION.ω), sym_of(bodies, i, BODY_MOTION.I)
    ρ = sub(vec_of(bodies, i, BODY_MOTION.p), vec_of(hinges, block, HINGE_MOTION.p))
    u = sub(vec_of(bodies, i, BODY_MOTION.v), vec_of(hinges, block, HINGE_MOTION.v))
    δω, η = vec_of(hinges, block, HINGE_MOTION.δω), vec_of(hinges, block, HINGE_MOTION.η)
    if variable == VARIABLE.qd:
        δω, η = vec_of(hinges, block, HINGE_MOTION.e), scale(2.0, δω)
    elif variable == VARIABLE.tau:
        δω, η = scale(0.0, δω), vec_of(hinges, block, HINGE_MOTION.e)
    δa = add(cross(η, ρ), scale(2.0, cross(δω, u)))
    if variable == VARIABLE.q:
        δa = add(δa, vec_of(hinges, block, HINGE_MOTION.δa))
    G = own_spin(ω, I)
    n = add(cross(mc, δa), sub(sym_apply(I, η), scale(2.0, rotate(δω, G[0], G[1], G[2]))))
    f = add(scale(m, δa), add(cross(η, mc), scale(2.0, cross(δω, cross(ω, mc)))))
    return n, f


@inlined
def any_prescribed(hinges):
    """Whether the motion of some joint is prescribed."""
    count = 0
    for k in range(len(hinges)):
        count += hinges[k].prescribed
    return count > 0


@recursion
def friction_derivative(hinge, rate):
    """∂T_FR/∂q̇ = d + (c / w) sech²(q̇ / w) of one hinge with damping d and Coulomb torque c of width w."""
    slope = hinge.damping
    if hinge.coulomb > 0.0:
        decay = math.exp(-abs(rate) / hinge.coulomb_width)
        sech = 2.0 * decay / (1.0 + decay * decay)
        slope += hinge.coulomb / hinge.coulomb_width * sech * sech
    return slope
