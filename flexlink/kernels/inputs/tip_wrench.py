"""The tip wrench at a stage, in frame 0; it is constant or given by a table in time, in axes of frame 0 or of the tip.

A constant force has a potential. A force that changes, or rotates with the tip, has none. Its power is

    f·ṗ = f · Σ (ω_i × r_i + e_k q̇_k)            along the path to the tip, e_k of prismatic hinges
"""

from flexlink.kernels.inputs.references import locate
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import X, Y, Z, cos_sin, pick, place_axes, rotate, turn_axes
from flexlink.kernels.tools.compiler import entry, kernel, recursion
from flexlink.kernels.tools.lanes import vec
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale, vector


@recursion
def put_wrench(loads, t, middle, q, qd, wrench):
    """Write force and moment at time t and state q, q̇ (n,) into `wrench` (6,), frame 0; return the power f·ṗ [W].

    `middle` is the midpoint of the step that contains t. A constant wrench is not changed. Arms side by side have only
    constant wrenches.
    """
    if q.ndim == 1:  # noqa: SIM102  decided by the compiler
        if loads is not None and loads.varies:
            return put_acting(loads, t, middle, q, qd, wrench)
    return 0.0


@recursion
def put_acting(loads, t, middle, q, qd, wrench):
    """`put_wrench` for loads that are not None."""
    bodies, hinges = loads.chain.bodies, loads.chain.hinges
    x, y, z = X, Y, Z  # columns of R
    ω = v = ZERO
    for number in range(len(loads.path)):
        b = bodies[loads.path[number]]
        v = add(v, cross(ω, rotate(vector(b.translation), x, y, z)))
        if b.turned:
            x, y, z = place_axes(b.rotation, x, y, z)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            if loads.chain.rare is not None and axis >= SLIDES:
                e = pick(axis - SLIDES, x, y, z)
                v = add(v, add_scaled(scale(qd[k], e), q[k], cross(ω, e)))
                continue
            ω = add_scaled(ω, qd[k], pick(axis, x, y, z))
            c, s = cos_sin(q[k])
            x, y, z = turn_axes(axis, c, s, x, y, z)
    put_given(loads, t, middle, wrench)
    if loads.follows:
        wrench[0], wrench[1], wrench[2] = rotate(vec(wrench, 0), x, y, z)
        wrench[3], wrench[4], wrench[5] = rotate(vec(wrench, 3), x, y, z)
    return dot(vec(wrench, 0), v)


@entry
def put_given(loads, t, middle, wrench):
    """Write force and moment at time t into `wrench` (6,), in the axes in which they are specified."""
    held = loads.coefficients.shape[1] == 1
    piece = locate(loads.knots, 0, len(loads.knots), middle if held else t)
    x = max(0.0, t - loads.knots[piece])
    c = loads.coefficients[piece]
    for k in range(6):
        wrench[k] = 0.0
        for j in range(len(c) - 1, -1, -1):
            wrench[k] = wrench[k] * x + c[j, k]


@kernel
def wrenches(loads, ts, qs, qds, found):
    """Wrenches at the samples of a run, (samples, 6) in frame 0; a sample at a knot uses the later piece."""
    for row in range(len(ts)):
        put_wrench(loads, ts[row], ts[row], qs[row], qds[row], found[row])
