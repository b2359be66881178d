"""Rows of ties: g and J of each, and the laws of their multipliers λ (`ties`)."""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.kinematics import add_slope, kinematics
from flexlink.kernels.tools.compiler import entry, inlined, kernel, recursion, shared
from flexlink.kernels.tools.finite import largest
from flexlink.kernels.tools.lanes import Turns
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import add, apply, cross, dot, scale, sub, vector

KIND = numbered("point distance joint")
TIE = np.dtype(
    [
        ("kind", np.int64), ("a", np.int64), ("b", np.int64),  # bodies; −1: frame 0; or coordinates; −1: none
        ("point_a", np.float64, (3,)), ("point_b", np.float64, (3,)),  # in axes of the bodies [m]
        ("along", np.float64, (3,)),  # u in axes of body b
        ("length", np.float64),  # l, if constant [m]
        ("ratio", np.float64),  # r of two coordinates
        ("stiffness", np.float64), ("damping", np.float64),  # k, inf: held [N/m, N m/rad]; d [N s/m, N m s/rad]
        ("low", np.float64), ("high", np.float64),  # free range [m, rad]; equal: none
        ("dissipation", np.float64),  # c [s/m, s/rad]
        ("bulk", np.float64),  # β of the oil of a cylinder; 0: no cylinder [Pa]
        ("areas", np.float64, (2,)),  # A of bore side and rod side, negative there, whose chamber shrinks with g [m²]
        ("volumes", np.float64, (2,)),  # of the chambers at zero distance of the ends [m³]
        ("pressures", np.float64, (2,)),  # at the commanded length [Pa]
    ],
    align=True,
)  # fmt: skip
EMPTY = -101325.0  # pressure [Pa], relative to air, of a chamber that the oil does not fill
SOFTEST = 0.05  # smallest slope ∂λ/∂g of a range, relative to k, in Newton's matrix
LAW = numbered("free held spring high low oil bore_empty rod_empty")
"""Law of a row in a step; high, low: at this end of its range. From `spring` on, laws have a spring; from `oil` on, a
cylinder, of which one side is empty by the last two."""


class Places(NamedTuple):
    """Results of `kinematics`, with scratch."""

    rotations: Any
    points: Any
    axes: Any
    turns: Any  # (3, n) cos q, sin q and q
    loads: Any  # (bodies, 6) force on a body, and its moment about the origin of frame 0


@kernel
def places_of(chain):
    """Scratch for the rows of a chain."""
    m, n = len(chain.bodies), len(chain.hinges)
    return Places(np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((n, 3)), np.empty((3, n)), np.empty((m, 6)))


@recursion
def place_all(chain, q, placed):
    """Find the places of all bodies."""
    turns = Turns(placed.turns[0], placed.turns[1], placed.turns[2])
    for k in range(len(q)):
        turns.angles[k] = q[k]
    cos_sin_all(turns.angles, turns.cosines, turns.sines)
    kinematics(chain, turns, placed)


@inlined
def place(body, point, placed):
    """Position in frame 0 of a point of a body, or of frame 0."""
    p = vector(point)
    return p if body < 0 else add(vector(placed.points[body]), apply(placed.rotations[body], p))


@recursion
def between(row, length, placed):
    """g of a row between points, the points of both bodies at which u acts, and u."""
    a, b = place(row.a, row.point_a, placed), place(row.b, row.point_b, placed)
    apart = sub(a, b)
    if row.kind == KIND.distance:
        far = math.sqrt(dot(apart, apart))
        u = scale(1.0 / far if far > 0.0 else 0.0, apart)  # ends that coincide have no direction
        return dot(u, apart) - row.length - length, a, b, u
    u = vector(row.along)  # u turns with body b, as does its point at a
    if row.b >= 0:
        u = apply(placed.rotations[row.b], u)
    return dot(u, apart) - row.length - length, a, a, u


@recursion
def find_row(chain, row, length, q, placed, J):
    """g of a row, and its J (n,), at the places of all bodies."""
    rounding = 1e-12  # largest slope of a row, relative to the distance of its points from the origin, that is an error
    J[:] = 0.0
    if row.kind == KIND.joint:
        J[row.a] = 1.0
        if row.b >= 0:
            J[row.b] = -row.ratio
        return of_joints(row, q)
    g, a, b, u = between(row, length, placed)
    add_slope(chain, placed, row.a, a, u, J)
    add_slope(chain, placed, row.b, b, scale(-1.0, u), J)
    if largest(J) <= rounding * (math.sqrt(dot(a, a)) + math.sqrt(dot(b, b))):
        J[:] = 0.0
    return g


@inlined
def of_joints(row, q):
    """g of a row of coordinates."""
    return q[row.a] - row.ratio * q[row.b] if row.b >= 0 else q[row.a]


@shared
@entry
def find_rows(chain, rows, length, q, placed, g, J):
    """Write g (r,) and J (r, n) at angles q; `length` (r,) is l where it moves, and `placed` is scratch."""
    place_all(chain, q, placed)
    for k in range(len(rows)):
        g[k] = find_row(chain, rows[k], length[k], q, placed, J[k])


@recursion
def load(row, length, λ, q, placed, R):
    """g of a row; λ acts on its coordinates in R (n,), or on its bodies at their places."""
    if row.kind == KIND.joint:
        R[row.a] -= λ
        if row.b >= 0:
            R[row.b] += row.ratio * λ
        return of_joints(row, q)
    g, a, b, u = between(row, length, placed)
    put_force(row.a, a, scale(-λ, u), placed.loads)
    put_force(row.b, b, scale(λ, u), placed.loads)
    return g


@inlined
def put_force(body, point, f, loads):
    """Add a force at a point to the loads of a body."""
    if body >= 0:
        keep(loads, body, added(loads, body, (f, cross(point, f))))


@inlined
def pressed(row, side, g, v):
    """λ of a range beyond its high end, side 1, or its low end, side −1: > 0 if it presses; −∞ without such an end."""
    depth = side * (g - (row.high if side > 0.0 else row.low))
    return row.stiffness * depth * (1.0 + row.dissipation * side * v if depth > 0.0 else 1.0)


@recursion
def chamber(row, side, g, length):
    """p of a chamber full of oil, 0: bore side, 1: rod side, and its area times −∂p/∂g; `length`: the moved l."""
    A = row.areas[side]
    V = row.volumes[side] + A * (row.length + length)
    return row.pressures[side] - row.bulk * math.log1p(A * g / V), A * A * row.bulk / (V + A * g)


@recursion
def law_of(row, g, v, length):
    """LAW that is valid at g and ġ."""
    if row.stiffness == math.inf:
        return LAW.held
    if row.bulk > 0.0:
        law = LAW.oil
        for side in range(2):
            if chamber(row, side, g, length)[0] < EMPTY:
                law = LAW.bore_empty + side
        return law
    if row.low == row.high:
        return LAW.spring
    if pressed(row, 1.0, g, v) > 0.0:
        return LAW.high
    if pressed(row, -1.0, g, v) > 0.0:
        return LAW.low
    return LAW.free


@recursion
def other_law(row, law, g):
    """The law that a row takes instead: free, or the nearer end of its range; a side that is empty, or none."""
    if law >= LAW.oil:
        return LAW.oil if law > LAW.oil else LAW.bore_empty if g > 0.0 else LAW.rod_empty
    if law != LAW.free:
        return LAW.free
    return LAW.high if row.high - g < g - row.low else LAW.low


@inlined
def stretch(row, law, g):
    """δ of a row by a law, without regard to its validity; 0 if the law has no spring of constant stiffness."""
    if law < LAW.spring or law >= LAW.oil:
        return 0.0
    return g - (row.low if law == LAW.low else row.high)


@inlined
def out_of_range(row, law, g, v, length):
    """How far λ of a row is beyond its law; −∞ if the law has no end."""
    if law == LAW.high:
        return -pressed(row, 1.0, g, v)
    if law == LAW.low:
        return -pressed(row, -1.0, g, v)
    if law == LAW.free:
        return max(pressed(row, 1.0, g, v), pressed(row, -1.0, g, v))
    off = -math.inf
    if law >= LAW.oil:
        for side in range(2):
            missing = abs(row.areas[side]) * (EMPTY - chamber(row, side, g, length)[0])
            off = max(off, -missing if law == LAW.bore_empty + side else missing)
    return off


@recursion
def multiplier(row, law, g, v, length):
    """λ of a row with a spring by a law, without regard to its validity; ∂λ/∂g and ∂λ/∂ġ."""
    k, d, c, δ = row.stiffness, row.damping, row.dissipation, stretch(row, law, g)
    if law >= LAW.oil:
        λ, k = d * v, 0.0
        for side in range(2):
            p, slope = chamber(row, side, g, length)
            if law == LAW.bore_empty + side:
                p, slope = EMPTY, 0.0
            λ, k = λ - row.areas[side] * p, k + slope
        return λ, k, d
    if law == LAW.spring:
        return k * δ + d * v, k, d
    if law == LAW.free:
        return 0.0, 0.0, 0.0
    side = 1.0 if law == LAW.high else -1.0
    grown = 1.0 + c * side * v
    return k * δ * grown, k * max(SOFTEST, grown), max(0.0, k * c * side * δ)


@recursion
def stored(row, law, g, length):
    """Energy E that the spring of a row stores by a law, ∂E/∂g = λ for ġ = 0, without regard to its validity; ∂E/∂l."""
    δ, E, slope = stretch(row, law, g), 0.0, 0.0
    if δ != 0.0:
        return 0.5 * row.stiffness * δ * δ, 0.0
    if law >= LAW.oil:
        for side in range(2):
            A, p = row.areas[side], row.pressures[side]
            V = row.volumes[side] + A * (row.length + length)
            x = A * g / V
            if law == LAW.bore_empty + side:
                E -= A * EMPTY * g
            else:
                E += row.bulk * V * ((1.0 + x) * math.log1p(x) - x) - A * p * g
                slope += row.bulk * A * (math.log1p(x) - x)
    return E, slope


@recursion
def power_beside(row, law, g, v, λ, length, speed):
    """Power of a spring with the multiplier λ at ġ and l̇, beside the change of the energy that it stores."""
    return (multiplier(row, law, g, 0.0, length)[0] - λ) * v + (stored(row, law, g, length)[1] - λ) * speed


@shared
@entry
def spring_forces(rows, length, g, v, λ, slopes):
    """Write λ and ∂λ/∂g (r,) of all springs at g and ġ (r,), with l where it moves; 0 for rows that are held."""
    for k in range(len(rows)):
        row, λ[k], slopes[k] = rows[k], 0.0, 0.0
        if row.stiffness < math.inf:
            λ[k], slopes[k], _ = multiplier(row, law_of(row, g[k], v[k], length[k]), g[k], v[k], length[k])


@shared
@entry
def oil_pressures(row, length, g, p):
    """Write the pressures p (samples, 2) [Pa] in the chambers of a cylinder, with l − `row.length` and g (samples,)."""
    for i in range(len(g)):
        for side in range(2):
            p[i, side] = max(EMPTY, chamber(row, side, g[i], length[i])[0])
