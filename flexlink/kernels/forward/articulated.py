"""Articulated-body algorithm, O(n) (Featherstone 1983), in working axes, with any number of hinges at one point.

The moment and force that a body and all outboard bodies require at its hinge point are linear in the angular
acceleration α and the acceleration a of the point:

    n = J α + H a + n₀          f = Hᵀ α + M a + f₀          (J, M symmetric 3×3)

The backward pass eliminates one hinge after another, with axis e, rotor inertia A and torque T. If A = 0, then
J e = Hᵀ e = 0 afterwards:

    D = e·J e + A      q̈ = (T − e·n₀ − e·(J α + H a)) / D      J ← J − J e (J e)ᵀ/D, …

For a prismatic hinge, force and moment swap roles, and so do α and a: D = e·M e + A, and J ← J − H e (H e)ᵀ/D, ….
The vector from the previous hinge point to the body's is then r + Σ e q. At a fork the moments and forces of all
branches are transferred to the hinge point of their parent body and added (`articulated_branches`).

Inboard of a triple (three axes without rotors), the moment t follows from the torques alone, e_k·t = τ_k. Only M and f₀
are passed on. The body's own axes x_j are eliminated instead of the hinge axes, since the x_j stay perpendicular
where hinge axes align (gimbal lock). If the next body outward passes no J and H, either, then with d_j = x_j × r

    h_j = m x_j × c + M d_j        J_jk = I_jk + d_j·M d_k        M ← M + m 1 − Σ h_j (J⁻¹)_jk h_kᵀ

and no matrix is rotated. Inboard of a pair, e₁ and e₂, two components of the moment are known. x₁ = e₂ and x₂ = e₁ are
eliminated in the same way. x₃ = t, normal to both, remains: J = j t tᵀ, H = t hᵀ. For the next body inboard they add

    h_j += t_j h        J_jk += j t_j t_k + t_j g_k + g_j t_k        t_j = x_j·t        g_j = h·d_j

`articulated_layout` chooses how the hinges of a body are eliminated, and where working axes restart so that the axis of
a single hinge is z. All vectors are in the working axes of their body. The same code works for one chain and for eight
chains side by side (`lanes`).
"""

from flexlink.kernels.forces.elements import subtract_torques
from flexlink.kernels.forces.joint_torques import smooth_torques, subtract_dry_friction
from flexlink.kernels.forward.articulated_branches import add_inertia_of_branch, add_load_of_branch
from flexlink.kernels.forward.articulated_groups import (
    add_pair,
    eliminate_along,
    eliminate_joint,
    eliminate_pair,
    eliminate_triple,
    in_axes_before,
    in_full,
    missing_torque,
    propagate_any,
    propagate_body,
    propagate_inertia,
    propagate_prescribed,
    swung,
    with_bias,
)
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT
from flexlink.kernels.forward.articulated_rows import BODY_ROW, HINGE_ROW, RESTART, THIRD_HINGE, axes_of
from flexlink.kernels.forward.slides import accelerate_slides, eliminate_slides, put_slides
from flexlink.kernels.tools.axes3 import add_along, pick, rotate, turn_axes
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine
from flexlink.kernels.tools.lanes import at, put_at, put_vec_of, vec, vec_of, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import keep, kept
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.sym3 import sym_apply, sym_of, sym_turn
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, scale, sub


@recursion
def articulated(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and the tip wrench (6,); see `forward_dynamics`."""
    layout, prescribed, bodies, hinges, trig = work.layout, work.prescribed, work.bodies, work.hinges, work.trig
    power = zero_of(q)
    for k in range(len(q)):
        put_at(trig[0], at(q, k), k)
        working, torque = smooth_torques(hinges, k, at(q, k), at(qd, k), at(tau, k))
        put_at(hinges, torque, k, HINGE_ROW.torque)
        power += working * at(qd, k)
    lost = subtract_dry_friction(hinges, work.dry, qd, HINGE_ROW.torque)
    if work.forces is not None and rarely(work.forces.act):
        lost += subtract_torques(work.forces, hinges, q, qd, HINGE_ROW.torque)
    cos_sin_all(work.flat[0], work.flat[1], work.flat[2])
    f, n, turning = outward(layout, work.axes, bodies, hinges, work.forks, wrench, qd, trig[0], trig[1], trig[2])
    inward(layout, work.axes, prescribed, bodies, hinges, work.forks, n, f, qdd, trig[1])
    return (
        turning + accelerate(work.gravity, layout, work.forks, prescribed, bodies, hinges, qd, tau, qdd, power) - lost
    )


@inlined
def outward(layout, axes, bodies, hinges, forks, wrench, qd, places, cosines, sines):
    """Store axes and velocity terms; return −wrench in the working axes of the loaded body, and the power m·ω.

    `places` contains the angles of revolute hinges and the displacements of prismatic hinges.
    """
    o = zero_of(qd)
    zero = (o, o, o)
    f, n = sub(zero, vec(wrench, 0)), sub(zero, vec(wrench, 3))
    x, y, z = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o)
    ω, acting = (o, o, o), (f, n, o)
    if forks is not None and rarely(len(forks) > 0):
        keep(forks, 0, (x, y, z, ω, f, n))
    for i in range(len(layout)):
        if forks is not None and rarely(layout[i, LAYOUT.begins]):
            x, y, z, ω, f, n = kept(forks, layout[i, LAYOUT.slot], (x, y, z, ω, f, n))
        r = rotate(vec_of(bodies, i, BODY_ROW.reach), x, y, z)  # from the hinge point of the parent
        keep(bodies, i, (r, swung(ω, r)), BODY_ROW.r)
        if layout[i, LAYOUT.turned]:
            u, v, w = axes_of(bodies, i, BODY_ROW.mount)
            x, y, z = rotate(u, x, y, z), rotate(v, x, y, z), rotate(w, x, y, z)
        if layout[i, LAYOUT.restart]:
            x, y, z = begin_axes(bodies, i, x, y, z)
            u, v, w = axes_of(bodies, i, RESTART.axes_before)
            ω, f, n = components(ω, u, v, w), components(f, u, v, w), components(n, u, v, w)
        ζ = (o, o, o)
        if forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            put_slides(layout, i, axes, bodies, hinges, x, y, z, ω, places, qd)
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                axis, rate = axes[k], at(qd, k)
                e = pick(axis, x, y, z)
                put_vec_of(hinges, e, k, HINGE_ROW.axis)
                ζ = add_scaled(ζ, rate, cross(ω, e))
                ω = add_scaled(ω, rate, e)
                x, y, z = turn_axes(axis, at(cosines, k), at(sines, k), x, y, z)
        mc = rotate(vec_of(bodies, i, BODY_ROW.moment), x, y, z)
        keep(bodies, i, (ζ, mc, swung(ω, mc)), BODY_ROW.ζ)
        if layout[i, LAYOUT.group] == GROUP.pair:
            u, v, w = pair_axes(bodies, i, hinges, layout[i, LAYOUT.first], axes, cosines, sines)
            put_axes(bodies, i, ω, u, v, w)
        else:
            put_axes(bodies, i, ω, x, y, z)
        if layout[i, LAYOUT.loaded]:
            acting = f, n, -dot(n, ω)
        if forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            keep(forks, layout[i, LAYOUT.fork], (x, y, z, ω, f, n))
    return acting


@inlined
def put_axes(bodies, i, ω, x, y, z):
    """Store the axes of body `i` for its group of hinges, and ω × I ω along them."""
    keep(bodies, i, (x, y, z), BODY_ROW.axes)
    ω = components(ω, x, y, z)
    put_vec_of(bodies, cross(ω, sym_apply(sym_of(bodies, i, BODY_ROW.inertia), ω)), i, BODY_ROW.n)


@inlined
def components(a, x, y, z):
    """Components of a along x, y, z."""
    return dot(x, a), dot(y, a), dot(z, a)


@inlined
def begin_axes(bodies, i, x, y, z):
    """Restart working axes at body `i`: store x, y, z, its axes before its hinge, and return unit vectors.

    If chains side by side do not all restart here, the others continue in their axes and store unit vectors.
    """
    μ = at(bodies, i, RESTART.restarts)
    ν = 1.0 - μ
    keep(bodies, i, mixed(μ, x, y, z, ν), RESTART.axes_before)
    return mixed(ν, x, y, z, μ)


@inlined
def mixed(μ, x, y, z, ν):
    """μ x, μ y, μ z plus ν times the unit vectors."""
    return add_along(0, ν, scale(μ, x)), add_along(1, ν, scale(μ, y)), add_along(2, ν, scale(μ, z))


@inlined
def pair_axes(bodies, i, hinges, k, axes, cosines, sines):
    """Return e₂, e₁, e₂ × e₁ of a pair of hinges Y, Z or Z, Y; rotate the body's inertia into these axes."""
    e1, e2 = vec_of(hinges, k, HINGE_ROW.axis), vec_of(hinges, k + 1, HINGE_ROW.axis)
    c, s, I = at(cosines, k + 1), at(sines, k + 1), sym_of(bodies, i, BODY_ROW.own_inertia)
    if axes[k + 1] == 2:
        xx, yy, zz, yz, xz, xy = sym_turn(2, c, s, I)
        keep(bodies, i, (zz, yy, xx, -xy, -xz, yz), BODY_ROW.inertia)
    else:
        xx, yy, zz, yz, xz, xy = sym_turn(1, c, s, I)
        keep(bodies, i, (yy, zz, xx, xz, xy, yz), BODY_ROW.inertia)
    return e2, e1, cross(e2, e1)


@inlined
def inward(layout, axes, prescribed, bodies, hinges, forks, n_tip, f_tip, qdd, cosines):
    """Eliminate all hinges from the tips to the base; n_tip and f_tip act on the loaded tip."""
    o = zero_of(qdd)
    zero = (o, o, o)
    if forks is not None:
        forks[1:] = 0.0
    n, f = zero, zero
    J, H, M = (o, o, o, o, o, o), (zero, zero, zero), (o, o, o, o, o, o)
    j, h, t = o, zero, zero  # J = j t tᵀ and H = t hᵀ of a pair on the next body
    outer = GROUP.tip
    for i in range(len(layout) - 1, -1, -1):
        group, k, following = layout[i, LAYOUT.group], layout[i, LAYOUT.first], layout[i, LAYOUT.next]
        if layout[i, LAYOUT.loaded]:
            n, f = n_tip, f_tip
        if forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            J, H = in_full(o, outer, J, H, j, h, t)
            J, H, M, n, f = with_branches(bodies, following, forks, layout[i, LAYOUT.fork], J, H, M, n, f)
            outer, following = GROUP.hinges, len(layout)
        if group == GROUP.triple:
            c = at(cosines, k + 1) * at(hinges, k + 2, THIRD_HINGE.sense)
            if outer > GROUP.pair:
                M, n, f = eliminate_triple(bodies, i, hinges, k, c, *propagate_body(bodies, i, following, M, n, f))
            else:
                J, H = in_full(o, outer, J, H, j, h, t)
                M, n, f = eliminate_triple(bodies, i, hinges, k, c, *propagate_any(bodies, i, following, J, H, M, n, f))
        elif group == GROUP.pair:
            if outer > GROUP.pair:  # the next body passes no J and H
                j, h = o, zero
            if outer >= GROUP.pair:
                body = add_pair(bodies, i, following, j, h, t, *propagate_body(bodies, i, following, M, n, f))
                j, h, t, M, n, f = eliminate_pair(bodies, i, hinges, k, *body)
            else:
                body = propagate_any(bodies, i, following, J, H, M, n, f)
                j, h, t, M, n, f = eliminate_pair(bodies, i, hinges, k, *body)
        elif group != GROUP.tip:
            J, H = in_full(o, outer, J, H, j, h, t)
            J, H, M, n, f = propagate_joints(
                layout, i, following, axes, forks, prescribed, bodies, hinges, qdd, J, H, M, n, f
            )
        outer = group
        if forks is not None and rarely(layout[i, LAYOUT.begins]):
            J, H = in_full(o, outer, J, H, j, h, t)
            add_branch(bodies, i, forks, layout[i, LAYOUT.slot], J, H, M, n, f)
            M, n, f = (o, o, o, o, o, o), zero, zero
            outer = GROUP.tip


@subroutine
def add_branch(bodies, i, forks, slot, J, H, M, n, f):
    """Add the articulated inertia and bias force of the branch that begins with body `i` to its fork's row."""
    if slot > 0:
        n, f = with_bias(bodies, i, H, M, n, f)
        add_load_of_branch(forks, slot, vec_of(bodies, i, BODY_ROW.r), n, f)
        add_inertia_of_branch(forks, slot, vec_of(bodies, i, BODY_ROW.r), J, H, M)


@subroutine
def with_branches(bodies, i, forks, k, J, H, M, n, f):
    """Articulated inertia and bias force at a fork: the branches in its row, plus the chain that follows body `i`."""
    add_branch(bodies, i, forks, k, J, H, M, n, f)
    return kept(forks, k, (J, H, M, n, f))


@inlined
def propagate_joints(layout, i, following, axes, forks, prescribed, bodies, hinges, qdd, J, H, M, n, f):
    """Return J, H, M, n, f inboard of body `i`, eliminating hinge by hinge; a prescribed q̈ adds to n and f."""
    J, H, M, n, f = propagate_inertia(bodies, i, following, J, H, M, n, f)
    if layout[i, LAYOUT.group] == GROUP.along:
        J, H, M, n, f = eliminate_along(hinges, layout[i, LAYOUT.first], J, H, M, n, f)
    elif forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
        J, H, M, n, f = eliminate_slides(layout, i, axes, prescribed, hinges, qdd, J, H, M, n, f)
    else:
        for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
            if prescribed[k]:
                n, f = propagate_prescribed(hinges, k, at(qdd, k), J, H, n, f)
            else:
                again = k + 1 < layout[i, LAYOUT.stop] and axes[k] == axes[k + 1] and not prescribed[k + 1]
                J, H, M, n, f = eliminate_joint(hinges, k, again, J, H, M, n, f)
    ζ = vec_of(bodies, i, BODY_ROW.ζ)
    n, f = add(n, sym_apply(J, ζ)), add(f, rotate(ζ, H[0], H[1], H[2]))
    if layout[i, LAYOUT.restart]:
        J, H, M, n, f = in_axes_before(bodies, i, J, H, M, n, f)
    return J, H, M, n, f


@inlined
def accelerate(gravity, layout, forks, prescribed, bodies, hinges, qd, tau, qdd, power):
    """Forward pass: compute absolute accelerations, q̈ from their differences, and torques of prescribed hinges.

    Returns the power, including the power of these torques. In the rows of the bodies, α replaces ζ and a − g replaces
    b; branches continue from these values.
    """
    o = zero_of(qdd)
    α, a = (o, o, o), scale(-1.0, vec(gravity, 0))
    for i in range(len(layout)):
        group, first = layout[i, LAYOUT.group], layout[i, LAYOUT.first]
        if forks is not None and rarely(layout[i, LAYOUT.begins]):
            α, a = motion_of_branch(bodies, i, layout[i, LAYOUT.parent], gravity)
        if layout[i, LAYOUT.restart]:
            u, v, w = axes_of(bodies, i, RESTART.axes_before)
            α, a = components(α, u, v, w), components(a, u, v, w)
        before = add(α, vec_of(bodies, i, BODY_ROW.ζ))
        x, y, z = axes_of(bodies, i, BODY_ROW.axes)
        if group == GROUP.triple:
            t1, t2, t3 = vec_of(bodies, i, BODY_ROW.α)
            t3 -= dot(vec_of(bodies, i, BODY_ROW.h_D + 6), a)
            α = rotate(along_group(bodies, i, t1, t2, t3, a), x, y, z)
            spread(hinges, first, sub(α, before), qdd)
        elif group == GROUP.pair:
            t1, t2, _ = vec_of(bodies, i, BODY_ROW.α)
            α1, α2, α3 = along_group(bodies, i, t1, t2, dot(z, before), a)
            α = rotate((α1, α2, α3), x, y, z)
            put_at(qdd, α2 - dot(y, before), first)
            put_at(qdd, α1 - dot(x, before), first + 1)
        elif forks is not None and rarely(group == GROUP.slides):
            α = before
            a, taken = accelerate_slides(layout, i, prescribed, hinges, qd, tau, qdd, α, a)
            power += taken
        else:
            α = before
            for k in range(first, layout[i, LAYOUT.stop]):
                if not prescribed[k]:
                    demand = dot(vec_of(hinges, k, HINGE_ROW.Je), α) + dot(vec_of(hinges, k, HINGE_ROW.He), a)
                    put_at(qdd, at(hinges, k, HINGE_ROW.inverse) * (at(hinges, k, HINGE_ROW.T) - demand), k)
                α = add_scaled(α, at(qdd, k), vec_of(hinges, k, HINGE_ROW.axis))
                if prescribed[k]:
                    more = missing_torque(hinges, k, at(qdd, k), α, a)
                    put_at(tau, at(tau, k) + more, k)
                    power += at(qd, k) * more
        keep(bodies, i, (a, α), BODY_ROW.b)
        following = layout[i, LAYOUT.next]
        b = vec_of(bodies, following, BODY_ROW.b)
        a = add(add(a, cross(α, vec_of(bodies, following, BODY_ROW.r))), b)
    return power


@subroutine
def motion_of_branch(bodies, i, parent, gravity):
    """α and a − g before the hinges of body `i`; `parent` is the number of its parent from 1, 0 for the base."""
    if parent == 0:
        o = zero_of(bodies, 0, 0)
        return (o, o, o), scale(-1.0 + o, vec(gravity, 0))
    α, a = vec_of(bodies, parent - 1, BODY_ROW.ζ), vec_of(bodies, parent - 1, BODY_ROW.b)
    return α, add(add(a, cross(α, vec_of(bodies, i, BODY_ROW.r))), vec_of(bodies, i, BODY_ROW.b))


@inlined
def along_group(bodies, i, t1, t2, α3, a):
    """α along the axes of body `i`, from t = D⁻¹ T, α₃, and a of the hinge point: Lᵀ α = t − D⁻¹ h·a."""
    l12, l13, l23 = vec_of(bodies, i, BODY_ROW.factors)
    α2 = t2 - dot(vec_of(bodies, i, BODY_ROW.h_D + 3), a) - l23 * α3
    α1 = t1 - dot(vec_of(bodies, i, BODY_ROW.h_D), a) - l12 * α2 - l13 * α3
    return α1, α2, α3


@inlined
def spread(hinges, k, step, qdd):
    """Write q̈ of the triple that starts at hinge `k`, from the difference of angular acceleration across it."""
    first = dot(vec_of(hinges, k, HINGE_ROW.Je), step)
    put_at(qdd, first, k)
    put_at(qdd, dot(vec_of(hinges, k + 1, HINGE_ROW.axis), step), k + 1)
    put_at(qdd, dot(vec_of(hinges, k + 2, HINGE_ROW.axis), step) - at(hinges, k + 2, THIRD_HINGE.e13) * first, k + 2)
