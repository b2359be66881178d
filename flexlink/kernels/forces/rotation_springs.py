"""Springs that act on the rotation vector φ = log R of three hinges at one point instead of on their angles θ.

R is the product of the hinges' rotations in their order, X, Y, Z or Z, Y, X. Euler angles are φ + O(φ²), which limits
every lumping rule to second order where a link bends far out of a plane. With the chain's K, including coupled springs,

    V = ½ φ·K φ        m = ∂V/∂φ        n = m − ½ φ × m + g φ × (φ × m)        τ_k = e_k·n
    g = (1 − ½ |φ| cot ½|φ|) / |φ|²

with vectors in axes of the body outboard of the hinges (order X, Y, Z). In a cell of two triples, the springs act on
the curvature Θ' − ½ Θ × Θ' at both Gauss points, where the rotation vector Θ is the quadratic polynomial through −φ₁,
0, φ₂. This adds

    V += (β₁∘φ₁ + β₂∘φ₂)·w + ½ w·(γ∘w)        w = −φ₁ × φ₂ / 6        β_i = (K_ii + K_12) / 2        γ = (β₁ + β₂) / 2

where ∘ is the product component by component. The energy is exact up to the fourth power of the cell's length, even
for tapered links. In other words, ½ w adds to φ₁ and to φ₂: V = ½ (φ + ½ w)·K (φ + ½ w). So a coupling K_ij of two axes
in a cell has V = K_ij (φ_i + ½ w_i) (φ_j + ½ w_j).

R is stored as a quaternion computed from the half angles, so φ is smooth up to a full turn, where it reverses. The φ(θ)
of order Z, Y, X equals −φ(−θ) of order X, Y, Z, so one factor σ = ±1 covers both orders. Kernels first apply
the torques K (θ − θ₀) of all hinges. This module computes the excess: the torque of the law minus K (θ − θ₀).

Eight triples are computed at once, one per SIMD lane (`lanes`): triples of one chain, or the same triple of eight
chains. Each triple has a slot (column) in the rows of numbers: first the inner triples of cells, then the outer triples
in the same order, then all other triples.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.layout import SPRINGS
from flexlink.kernels.tools.axes3 import X, Y, Z, pick
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion, shared
from flexlink.kernels.tools.lanes import LANES, at, eight_of, put_at, put_eight, put_lane, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, scale, sub

ROW = numbered(
    "half:3 cosine:3 sine:3",  # ½ (θ − θ₀) of the hinges about X, Y, Z
    "sense stiffness:3 rest:3 coupled:3",  # σ, K_ii, θ₀; K_12 at the inner triple of a cell
    "v:3 w square factor g",  # quaternion of σ (θ − θ₀), v·v, |φ| / |v|, g
    "φ:3 moment:3 linear:3 excess:3",  # φ, m, K (θ − θ₀) and the excess torque
)
"""Names of the rows of numbers; a row has one number for every triple."""
NEAR = 1 / 16  # limit of v·v, where |φ| = 0.505 rad: below it both series are exact to rounding
ARCSINE = tuple(2 * math.comb(2 * k, k) / 4**k / (2 * k + 1) for k in range(13))
"""Series of 2 arcsin(s) / s in powers of s²; the next term is below 1e-17."""
COTANGENT = (
    1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000, 1 / 74724249600,
    3617 / 10670622842880000,
)  # fmt: skip
"""Series of (1 − ½ x cot ½ x) / x² in powers of x², |B_2k| / (2k)! (Abramowitz & Stegun 4.3.70)."""


class RotationSprings(NamedTuple):
    """Force element: springs of rotation vectors, with scratch; empty arrays for a chain without such springs."""

    hinges: Any  # (t, 3) indices of the hinges about X, Y, Z of every triple
    slots: Any  # (t,) column of each triple in the rows
    cells: Any  # (c, 2) inner and outer triple of each cell
    outer: Any  # (1,) offset, in numbers of a row, from the inner triple of a cell to the outer one
    within: Any  # (w, 3) couplings within a cell, about one axis: axis, slot of the inner triple, index of the coupling
    pairs: Any  # (m, 6) other couplings: axis and slot of the inner and of the outer hinge, index, cell of both or −1
    coupled: Any  # (m, 1) K_ij of `pairs`
    numbers: Any  # (ROW.size, number of slots rounded up to a multiple of eight)
    side: Any  # the same memory, indexed by slot
    flat: Any  # (3, …) the first nine rows, same memory: half angles, cosines, sines


@shared
@kernel
def rotation_springs(bodies, hinges, couplings):
    """The springs of rotation vectors of a chain, with scratch."""
    triples, cells = triples_of(bodies, hinges)
    if len(triples) == 0:
        return no_springs(triples, cells)
    slots, outer = slots_of(cells, len(triples), LANES)
    within, pairs = joined(triples, slots, cells, couplings, len(hinges))
    size = -(-(slots.max() + 1) // LANES) * LANES
    numbers, coupled = np.zeros((ROW.size, size)), np.zeros((len(pairs), 1))
    springs = RotationSprings(
        triples, slots, cells, np.full(1, outer), within, pairs, coupled, numbers, numbers, turns_of(numbers)
    )
    own, both = np.empty(len(hinges)), np.empty(len(couplings))
    for k in range(len(hinges)):
        own[k] = hinges[k].stiffness
    for j in range(len(couplings)):
        both[j] = couplings[j].stiffness
    put_constants(springs, own, both)
    for t in range(len(triples)):
        numbers[ROW.sense, slots[t]] = 1.0 if triples[t, 0] < triples[t, 2] else -1.0
        for a in range(3):
            numbers[ROW.rest + a, slots[t]] = hinges[triples[t, a]].rest
    return springs


@allocating
def no_springs(triples, cells):
    """Empty springs, for a chain without triples; they share arrays, since forward dynamics often allocates them."""
    none, pairs, numbers = np.empty(0, np.int64), np.empty((0, 6), np.int64), np.empty((ROW.size, 0))
    coupled = np.empty((0, 1))
    return RotationSprings(triples, none, cells, none, triples, pairs, coupled, numbers, numbers, turns_of(numbers))


@allocating
def triples_of(bodies, hinges):
    """(t, 3) the hinges about X, Y, Z of every triple, and (c, 2) the inner and outer triple of every cell."""
    t = c = 0
    for i in range(len(bodies)):
        t, c = t + (bodies[i].springs != SPRINGS.angles), c + (bodies[i].springs == SPRINGS.cell)
    triples, cells, t, c = np.empty((t, 3), np.int64), np.empty((c, 2), np.int64), 0, 0
    for i in range(len(bodies)):
        if bodies[i].springs != SPRINGS.angles:
            for k in range(bodies[i].first, bodies[i].stop):
                triples[t, hinges[k].axis] = k
            if bodies[i].springs == SPRINGS.cell:
                cells[c, 0], cells[c, 1] = t, t + 1
                c += 1
            t += 1
    return triples, cells


@allocating
def turns_of(numbers):
    """View (3, …) of the first nine rows: all half angles, all cosines, all sines."""
    size = 3 * numbers.shape[1]
    return numbers.reshape(-1)[: 3 * size].reshape(3, size)


@allocating
def slots_of(cells, count, room):
    """Slots (t,) of the triples, outer ones from a multiple of `room` on, and their offset from inner ones."""
    slots, behind = np.full(count, -1), -(-len(cells) // room) * room
    for c in range(len(cells)):
        slots[cells[c, 0]], slots[cells[c, 1]] = c, behind + c
    free = 2 * behind
    for t in range(count):
        if slots[t] < 0:
            slots[t] = free
            free += 1
    return slots, behind * (LANES // room)


@kernel
def joined(triples, slots, cells, couplings, n):
    """Return `within` and `pairs` of `RotationSprings`, which index the couplings between hinges of triples."""
    place, cell = np.full((n, 2), -1), np.full(len(triples), -1)
    for t in range(len(triples)):
        for a in range(3):
            place[triples[t, a], 0], place[triples[t, a], 1] = a, t
    for c in range(len(cells)):
        cell[cells[c, 0]] = cell[cells[c, 1]] = c
    within, pairs, w, m = np.empty((len(couplings), 3), np.int64), np.empty((len(couplings), 6), np.int64), 0, 0
    for j in range(len(couplings)):
        i, o = couplings[j].inner, couplings[j].outer
        a, t, b, u = place[i, 0], place[i, 1], place[o, 0], place[o, 1]
        if t >= 0 and u >= 0:
            shared = cell[t] if cell[t] == cell[u] else -1
            if a == b and shared >= 0:
                within[w, 0], within[w, 1], within[w, 2] = a, slots[t], j
                w += 1
            else:
                pairs[m, 0], pairs[m, 1], pairs[m, 2], pairs[m, 3], pairs[m, 4] = a, slots[t], b, slots[u], j
                pairs[m, 5] = shared
                m += 1
    return within[:w].copy(), pairs[:m].copy()


@allocating
def put_constants(springs, own, both):
    """Set the diagonal of K to `own` (n,) and its couplings to `both` (couplings,); the law is linear in K."""
    for t in range(len(springs.hinges)):
        for a in range(3):
            springs.numbers[ROW.stiffness + a, springs.slots[t]] = own[springs.hinges[t, a]]
    for w in range(len(springs.within)):
        springs.numbers[ROW.coupled + springs.within[w, 0], springs.within[w, 1]] = both[springs.within[w, 2]]
    for m in range(len(springs.pairs)):
        springs.coupled[m, 0] = both[springs.pairs[m, 4]]


@allocating
def rotation_springs_side_by_side(chains):
    """The springs of rotation vectors of eight chains with the same hinges; one chain per lane."""
    first = rotation_springs(chains.bodies[0], chains.hinges[0], chains.rare.couplings[0])
    slots, outer = slots_of(first.cells, len(first.hinges), 1)
    within, pairs = first.within.copy(), first.pairs.copy()
    for t in range(len(slots)):
        for w in range(len(within)):
            if first.within[w, 1] == first.slots[t]:
                within[w, 1] = slots[t]
        for m in range(len(pairs)):
            for place in (1, 3):
                if first.pairs[m, place] == first.slots[t]:
                    pairs[m, place] = slots[t]
    count = slots.max() + 1 if len(slots) > 0 else 0
    numbers, coupled = np.zeros((ROW.size, count * LANES)), np.empty((len(pairs), 1, LANES))
    side = numbers.reshape(ROW.size, count, LANES)
    for lane in range(LANES):
        one = rotation_springs(chains.bodies[lane], chains.hinges[lane], chains.rare.couplings[lane])
        put_lane(one.coupled, lane, coupled)
        for t in range(len(slots)):
            for row in range(ROW.size):
                side[row, slots[t], lane] = one.numbers[row, one.slots[t]]
    return RotationSprings(
        first.hinges, slots, first.cells, np.full(1, outer), within, pairs, coupled, numbers, side, turns_of(numbers)
    )


@allocating
def rotation_of(chain):
    """The springs of rotation vectors of a chain; it may have none."""
    return rotation_springs(chain.bodies, chain.hinges, chain.rare.couplings)


@recursion
def rotation_torque(springs, q, qd, torque):
    """Add the excess of the law over K (θ − θ₀) to `torque`; returns the dissipated power, 0."""
    if len(springs.hinges) > 0:
        add_excess(q, springs, torque)
    return zero_of(qd)


@recursion
def rotation_energy(springs, q):
    """Energy V of the law minus ½ (θ − θ₀)·K (θ − θ₀) [J]; 0 without such springs."""
    return excess_energy(q, springs) if len(springs.hinges) > 0 else 0.0


@recursion
def add_excess(q, springs, torque):
    """Add the excess torques to `torque` (n,), or (n, 8) of eight states."""
    find_excess(q, springs)
    for t in range(len(springs.hinges)):
        for a in range(3):
            k = springs.hinges[t, a]
            put_at(torque, at(torque, k) + at(springs.side, ROW.excess + a, springs.slots[t]), k)


@kernel
def excess_torque(bodies, hinges, couplings, q):
    """Excess torque of the law over K (θ − θ₀), in a new array (n,)."""
    torque = np.zeros(len(q))
    add_excess(q, rotation_springs(bodies, hinges, couplings), torque)
    return torque


@kernel
def rotation_vectors(bodies, hinges, couplings, q):
    """Return the angles (n,), with the angles of triples replaced by the components of φ."""
    springs, found = rotation_springs(bodies, hinges, couplings), q.copy()
    find_quaternions(q, springs)
    find_moments(springs)
    for t in range(len(springs.hinges)):
        for a in range(3):
            found[springs.hinges[t, a]] = springs.numbers[ROW.φ + a, springs.slots[t]]
    return found


@kernel
def stretches(bodies, hinges, couplings, q):
    """Return the hinges (t, 3) of the triples, and the factor ½|φ| / sin ½|φ| (t,) by which φ amplifies errors of R."""
    springs = rotation_springs(bodies, hinges, couplings)
    find_quaternions(q, springs)
    return springs.hinges, 0.5 * springs.numbers[ROW.factor][springs.slots]


@recursion
def excess_energy(q, springs):
    """Energy V of the law minus ½ (θ − θ₀)·K (θ − θ₀) of a chain [J]."""
    find_quaternions(q, springs)
    find_moments(springs)
    numbers, found = springs.numbers, 0.0
    for k in springs.slots:
        for a in range(3):
            φ, θ = numbers[ROW.φ + a, k], 2.0 * numbers[ROW.half + a, k]
            found += 0.5 * numbers[ROW.stiffness + a, k] * (φ - θ) * (φ + θ)
    for m in range(len(springs.pairs)):
        a, t, b, u = springs.pairs[m, 0], springs.pairs[m, 1], springs.pairs[m, 2], springs.pairs[m, 3]
        w = half_w(springs, springs.pairs[m, 5])
        bent = (numbers[ROW.φ + a, t] + dot(w, pick(a, X, Y, Z))) * (numbers[ROW.φ + b, u] + dot(w, pick(b, X, Y, Z)))
        found += springs.coupled[m, 0] * (bent - 4.0 * numbers[ROW.half + a, t] * numbers[ROW.half + b, u])
    for c in range(len(springs.cells)):
        found += energy_of_cell(numbers, springs.slots[springs.cells[c, 0]], springs.slots[springs.cells[c, 1]])
    return found


@inlined
def energy_of_cell(numbers, t, u):
    """Contribution of K_12 and w to the excess energy of the cell whose triples have slots `t` and `u` [J]."""
    θ1, θ2 = three(numbers, ROW.half, t), three(numbers, ROW.half, u)
    φ1, φ2, both = three(numbers, ROW.φ, t), three(numbers, ROW.φ, u), three(numbers, ROW.coupled, t)
    β1, β2, γ = bending_of_cell(three(numbers, ROW.stiffness, t), three(numbers, ROW.stiffness, u), both)
    w = scale(-1.0 / 6.0, cross(φ1, φ2))
    M = add_scaled(add(by_axis(β1, φ1), by_axis(β2, φ2)), 0.5, by_axis(γ, w))
    return dot(both, sub(by_axis(φ1, φ2), scale(4.0, by_axis(θ1, θ2)))) + dot(w, M)


@inlined
def three(numbers, row, k):
    """The numbers in slot `k` of three rows, from `row` on."""
    return numbers[row, k], numbers[row + 1, k], numbers[row + 2, k]


@inlined
def eight(numbers, row, first):
    """The numbers in slots `first` … `first` + 7 of three rows, from `row` on."""
    return eight_of(numbers[row], first), eight_of(numbers[row + 1], first), eight_of(numbers[row + 2], first)


@inlined
def put_eight_of(numbers, a, row, first):
    """Write vectors `a` of eight triples to the numbers that `eight` reads."""
    put_eight(numbers[row], a[0], first)
    put_eight(numbers[row + 1], a[1], first)
    put_eight(numbers[row + 2], a[2], first)


@inlined
def by_axis(a, b):
    """a∘b, the product component by component."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inlined
def bending_of_cell(inner, outer, both):
    """β₁, β₂ and γ from K₁₁, K₂₂ and K₁₂, component by component."""
    β1, β2 = scale(0.5, add(inner, both)), scale(0.5, add(outer, both))
    return β1, β2, scale(0.5, add(β1, β2))


@recursion
def find_excess(q, springs):
    """Write the excess, the torque of the law minus K (θ − θ₀), of every triple."""
    find_quaternions(q, springs)
    find_moments(springs)
    numbers = springs.numbers
    for k in range(0, numbers.shape[1], LANES):
        σ, φ, m = eight_of(numbers[ROW.sense], k), eight(numbers, ROW.φ, k), eight(numbers, ROW.moment, k)
        c, s = eight(numbers, ROW.cosine, k), eight(numbers, ROW.sine, k)
        n = turned_back(σ, eight_of(numbers[ROW.g], k), φ, m)
        Cy, Cz, Sy, Sz = c[1] * c[1] - s[1] * s[1], c[2] * c[2] - s[2] * s[2], 2.0 * c[1] * s[1], 2.0 * c[2] * s[2]
        x, y = Cy * (Cz * n[0] - σ * Sz * n[1]) + σ * Sy * n[2], σ * Sz * n[0] + Cz * n[1]
        put_eight_of(numbers, sub((x, y, n[2]), eight(numbers, ROW.linear, k)), ROW.excess, k)


@inlined
def turned_back(σ, g, φ, m):
    """n = m − ½ σ φ × m + g φ × (φ × m)."""
    once = cross(φ, m)
    return add_scaled(add_scaled(m, -0.5 * σ, once), g, cross(φ, once))


@recursion
def find_quaternions(q, springs):
    """Write half angles with cosines and sines, the quaternion (v, w), v·v, |φ| / |v| and g of every triple."""
    numbers, side = springs.numbers, springs.side
    for t in range(len(springs.hinges)):
        slot = springs.slots[t]
        for a in range(3):
            θ = at(q, springs.hinges[t, a]) - at(side, ROW.rest + a, slot)
            put_at(side, 0.5 * θ, ROW.half + a, slot)
    cos_sin_all(springs.flat[0], springs.flat[1], springs.flat[2])
    for k in range(0, numbers.shape[1], LANES):
        σ, (cx, cy, cz) = eight_of(numbers[ROW.sense], k), eight(numbers, ROW.cosine, k)
        sx, sy, sz = scale(σ, eight(numbers, ROW.sine, k))
        yz, cc, sc, cs = sy * sz, cy * cz, sy * cz, cy * sz
        v = sx * cc + cx * yz, cx * sc - sx * cs, cx * cs + sx * sc
        square = dot(v, v)
        put_eight_of(numbers, v, ROW.v, k)
        put_eight(numbers[ROW.w], cx * cc - sx * yz, k)
        put_eight(numbers[ROW.square], square, k)
        factor, g = near(square)
        put_eight(numbers[ROW.factor], factor, k)
        put_eight(numbers[ROW.g], g, k)
    some = False
    for k in range(numbers.shape[1]):
        some |= numbers[ROW.square, k] >= NEAR or numbers[ROW.w, k] < 0.0
    if some:
        find_far(numbers)


@inlined
def near(square):
    """|φ| / |v| and g by their series, for v·v below `NEAR`."""
    factor = polynomial(ARCSINE, square)
    return factor, polynomial(COTANGENT, factor * factor * square)


@inlined
def polynomial(coefficients, x):
    """Σ c_k x^k by Horner's rule."""
    total = coefficients[-1] * x + coefficients[-2]
    for k in range(len(coefficients) - 3, -1, -1):
        total = total * x + coefficients[k]
    return total


@recursion
def find_far(numbers):
    """Write |φ| / |v| and g of the quaternions beyond the range of the series."""
    for k in range(numbers.shape[1]):
        w, square = numbers[ROW.w, k], numbers[ROW.square, k]
        if square >= NEAR or w < 0.0:
            sine = math.sqrt(square)
            half = math.atan2(sine, w)
            numbers[ROW.factor, k] = 2.0 * half / sine
            numbers[ROW.g, k] = (1.0 - half * w / sine) / (4.0 * half * half)


@recursion
def find_moments(springs):
    """Write φ, m = ∂V/∂φ and K (θ − θ₀) of every triple."""
    numbers, side, outer = springs.numbers, springs.side, springs.outer[0]
    for k in range(0, outer, LANES):
        bend_cell(numbers, k, k + outer)
    for k in range(2 * outer, numbers.shape[1], LANES):
        φ, θ, held = vectors_of(numbers, k)
        put_eight_of(numbers, φ, ROW.φ, k)
        put_eight_of(numbers, by_axis(held, φ), ROW.moment, k)
        put_eight_of(numbers, by_axis(held, θ), ROW.linear, k)
    for m in range(len(springs.pairs)):
        a, t, b, u = springs.pairs[m, 0], springs.pairs[m, 1], springs.pairs[m, 2], springs.pairs[m, 3]
        both = at(springs.coupled, m, 0)
        add_product(side, a, t, both, b, u)
        add_product(side, b, u, both, a, t)
        if springs.pairs[m, 5] >= 0:
            add_turns(springs, m, both)


@inlined
def vectors_of(numbers, k):
    """φ, θ − θ₀ and K_ii of eight triples."""
    factor = eight_of(numbers[ROW.sense], k) * eight_of(numbers[ROW.factor], k)
    φ, θ = scale(factor, eight(numbers, ROW.v, k)), scale(2.0, eight(numbers, ROW.half, k))
    return φ, θ, eight(numbers, ROW.stiffness, k)


@inlined
def bend_cell(numbers, k, l):
    """Write φ, m (with the terms of w) and K (θ − θ₀) of eight cells: inner triples from `k`, outer ones from `l`."""
    (φ1, θ1, inner), (φ2, θ2, outer) = vectors_of(numbers, k), vectors_of(numbers, l)
    both = eight(numbers, ROW.coupled, k)
    put_eight_of(numbers, φ1, ROW.φ, k)
    put_eight_of(numbers, φ2, ROW.φ, l)
    put_eight_of(numbers, add(by_axis(inner, θ1), by_axis(both, θ2)), ROW.linear, k)
    put_eight_of(numbers, add(by_axis(outer, θ2), by_axis(both, θ1)), ROW.linear, l)
    β1, β2, γ = bending_of_cell(inner, outer, both)
    w = scale(-1.0 / 6.0, cross(φ1, φ2))
    M = add(add(by_axis(β1, φ1), by_axis(β2, φ2)), by_axis(γ, w))
    m1, m2 = add(by_axis(inner, φ1), by_axis(both, φ2)), add(by_axis(outer, φ2), by_axis(both, φ1))
    put_eight_of(numbers, add_scaled(add(m1, by_axis(β1, w)), -1.0 / 6.0, cross(φ2, M)), ROW.moment, k)
    put_eight_of(numbers, add_scaled(add(m2, by_axis(β2, w)), -1.0 / 6.0, cross(M, φ1)), ROW.moment, l)


@inlined
def add_product(side, a, t, both, b, u):
    """Add K_ij φ_b and K_ij (θ − θ₀)_b of axis `b` in slot `u` to m and K (θ − θ₀) at axis `a` in slot `t`."""
    put_at(side, at(side, ROW.moment + a, t) + both * at(side, ROW.φ + b, u), ROW.moment + a, t)
    put_at(side, at(side, ROW.linear + a, t) + 2.0 * both * at(side, ROW.half + b, u), ROW.linear + a, t)


@inlined
def half_w(springs, cell):
    """½ w of a cell, by the φ of its triples; 0 if `cell` is −1."""
    if cell < 0:
        return scale(0.0, three_at(springs.side, ROW.φ, 0))
    t, u = springs.slots[springs.cells[cell, 0]], springs.slots[springs.cells[cell, 1]]
    return scale(-1.0 / 12.0, cross(three_at(springs.side, ROW.φ, t), three_at(springs.side, ROW.φ, u)))


@inlined
def three_at(side, row, k):
    """As `three`, also for eight chains."""
    return at(side, row, k), at(side, row + 1, k), at(side, row + 2, k)


@inlined
def add_three_at(side, a, row, k):
    """Add a vector to the numbers that `three_at` reads."""
    for i in range(3):
        put_at(side, at(side, row + i, k) + pick(i, a[0], a[1], a[2]), row + i, k)


@recursion
def add_turns(springs, m, both):
    """Add what ½ w of a cell adds to the moments m by coupling m of `springs.pairs`, `both` = K_ij."""
    side, a, b, cell = springs.side, springs.pairs[m, 0], springs.pairs[m, 2], springs.pairs[m, 5]
    t, u, w = springs.pairs[m, 1], springs.pairs[m, 3], half_w(springs, cell)
    e, f, w_a, w_b = pick(a, X, Y, Z), pick(b, X, Y, Z), dot(w, pick(a, X, Y, Z)), dot(w, pick(b, X, Y, Z))
    M = scale(0.5 * both, add(scale(at(side, ROW.φ + b, u) + w_b, e), scale(at(side, ROW.φ + a, t) + w_a, f)))
    add_three_at(side, scale(both * w_b, e), ROW.moment, t)
    add_three_at(side, scale(both * w_a, f), ROW.moment, u)
    first, last = springs.slots[springs.cells[cell, 0]], springs.slots[springs.cells[cell, 1]]
    add_three_at(side, scale(-1.0 / 6.0, cross(three_at(side, ROW.φ, last), M)), ROW.moment, first)
    add_three_at(side, scale(-1.0 / 6.0, cross(M, three_at(side, ROW.φ, first))), ROW.moment, last)
