"""Solve M x = r for many right-hand sides, O(n) each, with the factors that forward dynamics stored in its workspace.

    group      load, backward pass                                       forward pass
    one hinge  T = r − e·n          n ← n + T J e / D                    x = (T − J e·α − Hᵀe·a) / D
               f ← f + T Hᵀe / D    then e·n ← r − A T / D               α ← α + x e
    prismatic  the same with f for n, a for α, H e and M e for J e and Hᵀ e
    triple     t with e_k·t = r_k   T = L⁻¹ (x_j·t − x_j·n)              Lᵀα = D⁻¹ (T − h·a)
    pair       t = r₁ e₁ + r₂ e₂    f ← f + Σ T_j h_j / D_j              x from the difference of α across the group

From one hinge point to the next, n ← n + r × f and a ← a + α × r, as in `articulated` at rest and without gravity. The
factors are floats; r and x are floats or eight floats side by side (`lanes`). The load of a branch is added to the load
of its parent body. In the forward pass the rows of the loads store the accelerations from which branches continue.
"""

from flexlink.kernels.forward.articulated import along_group, spread
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT
from flexlink.kernels.forward.articulated_rows import BODY_ROW, HINGE_ROW, RESTART, THIRD_HINGE, axes_of
from flexlink.kernels.tools.axes3 import combine, combine2, rotate
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine
from flexlink.kernels.tools.lanes import at, put_at, vec_of, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, sub


@recursion
def solve_on_articulated(r, loads, x, work):
    """Write x (n,) with M x + Jᵀ(loads) = r, 0 at prescribed joints; `articulated` must have been called with `work`.

    `loads` (bodies, 6) contains moment and force of the bodies at their hinge points, in working axes; overwritten.
    """
    layout, prescribed, bodies, hinges = work.layout, work.prescribed, work.bodies, work.hinges
    o = zero_of(x)
    n, f = (o, o, o), (o, o, o)
    for i in range(len(layout) - 1, -1, -1):
        n, f = added(loads, i, (add(n, cross(vec_of(bodies, i + 1, BODY_ROW.r), f)), f))
        if layout[i, LAYOUT.group] == GROUP.triple or layout[i, LAYOUT.group] == GROUP.pair:
            triple = layout[i, LAYOUT.group] == GROUP.triple
            n, f = load_group(bodies, i, hinges, layout[i, LAYOUT.first], triple, r, x, n, f)
        elif work.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            n, f = load_slides(layout, i, prescribed, hinges, r, x, n, f)
        else:
            for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
                if not prescribed[k]:
                    n, f = load_hinge(hinges, k, HINGE_ROW.Je, HINGE_ROW.He, r, x, n, f)
        if layout[i, LAYOUT.restart]:
            u, v, w = axes_of(bodies, i, RESTART.axes_before)
            n, f = rotate(n, u, v, w), rotate(f, u, v, w)
        if work.forks is not None and rarely(layout[i, LAYOUT.begins]):
            add_branch(loads, layout[i, LAYOUT.parent], vec_of(bodies, i, BODY_ROW.r), n, f)
            n, f = (o, o, o), (o, o, o)
    α, a = (o, o, o), (o, o, o)
    for i in range(len(layout)):
        if work.forks is not None and rarely(layout[i, LAYOUT.begins]):
            α, a = motion_of_branch(loads, layout[i, LAYOUT.parent], vec_of(bodies, i, BODY_ROW.r))
        if layout[i, LAYOUT.restart]:
            u, v, w = axes_of(bodies, i, RESTART.axes_before)
            α, a = (dot(u, α), dot(v, α), dot(w, α)), (dot(u, a), dot(v, a), dot(w, a))
        if layout[i, LAYOUT.group] == GROUP.triple or layout[i, LAYOUT.group] == GROUP.pair:
            α = move_group(bodies, i, hinges, layout[i, LAYOUT.first], layout[i, LAYOUT.group] == GROUP.triple, x, α, a)
        elif work.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            a = move_slides(layout, i, prescribed, hinges, x, α, a)
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                if prescribed[k]:
                    put_at(x, o, k)
                else:
                    demand = dot(vec_of(hinges, k, HINGE_ROW.Je), α) + dot(vec_of(hinges, k, HINGE_ROW.He), a)
                    put_at(x, at(x, k) - hinges[k, HINGE_ROW.inverse] * demand, k)
                α = add_scaled(α, at(x, k), vec_of(hinges, k, HINGE_ROW.axis))
        if work.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            keep(loads, i, (α, a))
        a = add(a, cross(α, vec_of(bodies, i + 1, BODY_ROW.r)))


@subroutine
def add_branch(loads, number, r, n, f):
    """Add the load of a branch, at a hinge point displaced by r, to body `number`, counted from 1; 0 is the base."""
    if number > 0:
        keep(loads, number - 1, added(loads, number - 1, (add(n, cross(r, f)), f)))


@subroutine
def motion_of_branch(loads, number, r):
    """α and a at the first hinge point of a branch, displaced by r, from α and a in the row of body `number`."""
    if number == 0:
        o = zero_of(loads, 0, 0)
        return (o, o, o), (o, o, o)
    α, a = vec_of(loads, number - 1, 0), vec_of(loads, number - 1, 3)
    return α, add(a, cross(α, r))


@inlined
def load_hinge(hinges, k, first, second, r, x, n, f):
    """n and f inboard of a hinge; stores T / D in x. `first` and `second` are the columns of J e and Hᵀ e."""
    e, torque = vec_of(hinges, k, HINGE_ROW.axis), at(r, k)
    T = (torque - dot(e, n)) * hinges[k, HINGE_ROW.inverse]
    put_at(x, T, k)
    n, f = add_scaled(n, T, vec_of(hinges, k, first)), add_scaled(f, T, vec_of(hinges, k, second))
    return add_scaled(n, torque - hinges[k, HINGE_ROW.armature] * T - dot(e, n), e), f


@subroutine
def load_slides(layout, i, prescribed, hinges, r, x, n, f):
    """Return n and f inboard of the prismatic hinges of body `i`; stores T / D in x."""
    for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
        if not prescribed[k]:
            f, n = load_hinge(hinges, k, HINGE_ROW.He, HINGE_ROW.Je, r, x, f, n)
    return n, f


@subroutine
def move_slides(layout, i, prescribed, hinges, x, α, a):
    """Return a outboard of the prismatic hinges of body `i`; write x of these hinges."""
    for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
        if prescribed[k]:
            put_at(x, zero_of(x), k)
        else:
            demand = dot(vec_of(hinges, k, HINGE_ROW.Je), α) + dot(vec_of(hinges, k, HINGE_ROW.He), a)
            put_at(x, at(x, k) - hinges[k, HINGE_ROW.inverse] * demand, k)
        a = add_scaled(a, at(x, k), vec_of(hinges, k, HINGE_ROW.axis))
    return a


@inlined
def load_group(bodies, i, hinges, k, triple, r, x, n, f):
    """n and f inboard of a triple or pair of hinges from `k`; stores T_j / D_j of the eliminated axes in x."""
    u, v, w = axes_of(bodies, i, BODY_ROW.axes)
    l12, l13, l23 = vec_of(bodies, i, BODY_ROW.factors)
    e1, e2, τ1, τ2 = vec_of(hinges, k, HINGE_ROW.axis), vec_of(hinges, k + 1, HINGE_ROW.axis), at(r, k), at(r, k + 1)
    if triple:
        τ3 = at(r, k + 2)
        dual, e3 = vec_of(hinges, k, HINGE_ROW.Je), vec_of(hinges, k + 2, HINGE_ROW.axis)
        t = combine(τ1 - hinges[k + 2, THIRD_HINGE.e13] * τ3, dual, τ2, e2, τ3, e3)
    else:
        t = combine2(τ1, e1, τ2, e2)
    net = sub(t, n)
    T1 = dot(u, net)
    T2 = dot(v, net) - l12 * T1
    T3 = dot(w, net) - l13 * T1 - l23 * T2
    D1, D2, D3 = vec_of(bodies, i, BODY_ROW.inverses)
    put_at(x, D1 * T1, k)
    put_at(x, D2 * T2, k + 1)
    f = add_scaled(add_scaled(f, T1, vec_of(bodies, i, BODY_ROW.h_D)), T2, vec_of(bodies, i, BODY_ROW.h_D + 3))
    if triple:
        put_at(x, D3 * T3, k + 2)
        return t, add_scaled(f, T3, vec_of(bodies, i, BODY_ROW.h_D + 6))
    return add_scaled(t, -T3, w), f


@inlined
def move_group(bodies, i, hinges, k, triple, x, before, a):
    """Return α outboard of a triple or pair of hinges from `k`; write x of these hinges."""
    u, v, w = axes_of(bodies, i, BODY_ROW.axes)
    α3 = dot(w, before)
    if triple:
        α3 = at(x, k + 2) - dot(vec_of(bodies, i, BODY_ROW.h_D + 6), a)
    α1, α2, α3 = along_group(bodies, i, at(x, k), at(x, k + 1), α3, a)
    α = rotate((α1, α2, α3), u, v, w)
    if triple:
        spread(hinges, k, sub(α, before), x)
    else:
        put_at(x, α2 - dot(v, before), k)
        put_at(x, α1 - dot(u, before), k + 1)
    return α
