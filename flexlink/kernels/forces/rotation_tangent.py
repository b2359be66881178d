"""Derivatives of the excess torques of `rotation_springs`: tangent stiffness minus the chain's K, in 3 × 3 blocks.

With the symbols of `rotation_springs`, A = 1 + ½ φ × + g φ × φ ×, so that δφ = A e_k δθ_k and n = Aᵀ m,

    ∂τ_k/∂θ_j = (A e_k)·∂²V/∂φ² (A e_j) + e_k·∂Aᵀ/∂θ_j m + ∂e_k/∂θ_j·n

The last two terms occur only if k and j are in one triple. ∂e_k/∂θ_j = −e_j × e_k if hinge j is outboard of hinge k
(order X, Y, Z), otherwise 0. A cell adds

    W₁ = φ₂ × / 6        W₂ = −φ₁ × / 6        M = ∂V/∂w
    ∂²V/∂φ_i∂φ_j += β_i∘W_j + W_iᵀ β_j∘ + W_iᵀ γ∘W_j + (M × / 6 if i = 1, j = 2)

A coupling K_ij of two axes in a cell adds products of the gradients of φ_i + ½ w_i and φ_j + ½ w_j.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.rotation_springs import (
    COTANGENT,
    NEAR,
    ROW,
    RotationSprings,
    bending_of_cell,
    by_axis,
    find_excess,
    half_w,
    polynomial,
    rotation_springs,
    three,
    turned_back,
)
from flexlink.kernels.tools.axes3 import X, Y, Z, pick
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, scale, vector

SLOPE = tuple(k * c for k, c in enumerate(COTANGENT))[1:]  # series of dg/d|φ|²


class RotationTangent(NamedTuple):
    """Derivatives of the torques of springs of rotation vectors, with scratch."""

    springs: RotationSprings
    blocks: Any  # (b, 2) pairs t ≤ u of triples coupled by springs; first the diagonal (t, t)
    values: Any  # (b, 3, 3) ∂excess_t/∂θ_u, by the hinges about X, Y, Z; block u, t is the transpose
    bent: Any  # (b, 3, 3) ∂²V/∂φ_t∂φ_u
    of_pair: Any  # (m,) index of the block of each coupling in `springs.pairs`
    of_cell: Any  # (c,) index of the block between the two triples of each cell
    axes: Any  # (t, 3, 3) e_k
    turning: Any  # (t, 3, 3) A e_k


@recursion
def rotation_slopes(element, q, qd, by_angle, by_rate):
    """Add all blocks of the excess stiffness to ∂T/∂q, `by_angle` (n, n)."""
    if len(element.springs.hinges) > 0:
        add_tangent(q, element.springs, element, by_angle)


@kernel
def rotation_tangent(springs):
    """The derivatives of a chain's springs of rotation vectors, with scratch; empty arrays without such springs."""
    count, most = len(springs.hinges), len(springs.hinges) + len(springs.pairs) + len(springs.cells)
    if count == 0:
        none, values = springs.slots, np.empty((0, 3, 3))
        return RotationTangent(springs, springs.cells, values, values, none, none, values, values)
    blocks, b = np.empty((most, 2), np.int64), count
    of_pair, of_cell = np.empty(len(springs.pairs), np.int64), np.empty(len(springs.cells), np.int64)
    triple = np.empty(springs.numbers.shape[1], np.int64)
    for t in range(count):
        blocks[t, 0], blocks[t, 1], triple[springs.slots[t]] = t, t, t
    for m in range(len(springs.pairs)):
        of_pair[m] = block_of(triple[springs.pairs[m, 1]], triple[springs.pairs[m, 3]], blocks, b)
        b = max(b, of_pair[m] + 1)
    for c in range(len(springs.cells)):
        of_cell[c] = block_of(springs.cells[c, 0], springs.cells[c, 1], blocks, b)
        b = max(b, of_cell[c] + 1)
    values, axes = np.zeros((2, b, 3, 3)), np.zeros((2, count, 3, 3))
    return RotationTangent(springs, blocks[:b].copy(), values[0], values[1], of_pair, of_cell, axes[0], axes[1])


@allocating
def block_of(t, u, blocks, count):
    """Index of the block of two triples among the first `count`; a new block is entered at index `count`."""
    t, u = min(t, u), max(t, u)
    for b in range(count - 1, -1, -1):
        if blocks[b, 0] == t and blocks[b, 1] == u:
            return b
    blocks[count, 0], blocks[count, 1] = t, u
    return count


@kernel
def excess_stiffness(bodies, hinges, couplings, q):
    """Blocks (b, 2) as pairs of triples, hinges (t, 3) of the triples, and block values (b, 3, 3) at angles q."""
    springs = rotation_springs(bodies, hinges, couplings)
    tangent = rotation_tangent(springs)
    find_tangent(q, springs, tangent)
    return tangent.blocks, springs.hinges, tangent.values


@recursion
def add_tangent(q, springs, tangent, K):
    """Add all blocks and their transposes to the matrix K (n, n)."""
    find_tangent(q, springs, tangent)
    for b in range(len(tangent.blocks)):
        t, u = tangent.blocks[b, 0], tangent.blocks[b, 1]
        for k in range(3):
            for j in range(3):
                i, column = springs.hinges[t, k], springs.hinges[u, j]
                K[i, column] += tangent.values[b, k, j]
                if t != u:
                    K[column, i] += tangent.values[b, k, j]


@subroutine
def find_tangent(q, springs, tangent):
    """Write the values ∂excess_t/∂θ_u of all blocks."""
    find_excess(q, springs)
    bend_blocks(springs, tangent)
    for t in range(len(springs.hinges)):
        turn_vectors(springs, t, tangent)
    for b in range(len(tangent.blocks)):
        t, u = tangent.blocks[b, 0], tangent.blocks[b, 1]
        for j in range(3):
            v = vec_of(tangent.turning[u], j, 0)
            B = tangent.bent[b]
            bent = dot(vector(B[0]), v), dot(vector(B[1]), v), dot(vector(B[2]), v)
            for k in range(3):
                tangent.values[b, k, j] = dot(vec_of(tangent.turning[t], k, 0), bent)
        if t == u:
            add_turning(springs.numbers, springs.slots[t], tangent.axes[t], tangent.turning[t], tangent.values[b])
    take_off_linear(springs, tangent)


@recursion
def turn_vectors(springs, t, tangent):
    """Write e_k and A e_k of the hinges about X, Y, Z of triple t, for the angles σ (θ − θ₀)."""
    numbers, k = springs.numbers, springs.slots[t]
    σ, φ = numbers[ROW.sense, k], three(numbers, ROW.φ, k)
    c, s = three(numbers, ROW.cosine, k), three(numbers, ROW.sine, k)
    Cy, Cz, Sy, Sz = c[1] * c[1] - s[1] * s[1], c[2] * c[2] - s[2] * s[2], 2.0 * σ * c[1] * s[1], 2.0 * σ * c[2] * s[2]
    for j in range(3):
        e = pick(j, (Cy * Cz, -Cy * Sz, Sy), (Sz, Cz, 0.0), Z)
        once = cross(φ, e)
        put_vec_of(tangent.axes[t], e, j, 0)
        turned = add_scaled(add_scaled(e, 0.5 * σ, once), numbers[ROW.g, k], cross(φ, once))
        put_vec_of(tangent.turning[t], turned, j, 0)


@recursion
def add_turning(numbers, slot, axes, turning, values):
    """Add e_k·∂Aᵀ/∂θ_j m and ∂e_k/∂θ_j·n to the diagonal block of the triple in a slot, for the angles σ (θ − θ₀)."""
    σ, g = numbers[ROW.sense, slot], numbers[ROW.g, slot]
    φ, m = scale(σ, three(numbers, ROW.φ, slot)), scale(σ, three(numbers, ROW.moment, slot))
    n, once = turned_back(1.0, g, φ, m), cross(φ, m)
    slope = slope_of_g(numbers[ROW.w, slot], numbers[ROW.square, slot], φ, g)
    for j in range(3):
        δ = vec_of(turning, j, 0)
        δn = add_scaled(scale(-0.5, cross(δ, m)), g, add(cross(δ, once), cross(φ, cross(δ, m))))
        δn = add_scaled(δn, 2.0 * slope * dot(φ, δ), cross(φ, once))
        for k in range(3):
            e = vec_of(axes, k, 0)
            values[k, j] += dot(e, δn)
            if j > k:
                values[k, j] -= dot(cross(vec_of(axes, j, 0), e), n)


@recursion
def slope_of_g(w, square, φ, g):
    """dg/d|φ|² at a quaternion with scalar part w, v·v = `square` and rotation vector φ."""
    x = dot(φ, φ)
    if square < NEAR and w >= 0.0:
        return polynomial(SLOPE, x)
    half, sine = 0.5 * math.sqrt(x), math.sqrt(square)
    return ((half / square - w / sine) / (4.0 * half * half) - 2.0 * g / half) / (8.0 * half)


@recursion
def bend_blocks(springs, tangent):
    """Write ∂²V/∂φ_t∂φ_u of all blocks."""
    bent, pairs, numbers = tangent.bent, springs.pairs, springs.numbers
    for b in range(len(bent)):
        for k in range(3):
            for j in range(3):
                bent[b, k, j] = 0.0
    for t in range(len(springs.hinges)):
        for k in range(3):
            bent[t, k, k] = numbers[ROW.stiffness + k, springs.slots[t]]
    for m in range(len(pairs)):
        if pairs[m, 5] >= 0:
            bend_coupling(springs, m, tangent)
        else:
            add_coupling(springs, m, bent[tangent.of_pair[m]], 1.0)
    for c in range(len(springs.cells)):
        t, u = springs.cells[c, 0], springs.cells[c, 1]
        bend_cell_blocks(numbers, springs.slots[t], springs.slots[u], bent[t], bent[u], bent[tangent.of_cell[c]])


@recursion
def bend_cell_blocks(numbers, t, u, own, others, mixed):
    """Add the ∂²V/∂φ_i∂φ_j of the cell in slots `t` and `u` to its three blocks."""
    φ1, φ2, both = three(numbers, ROW.φ, t), three(numbers, ROW.φ, u), three(numbers, ROW.coupled, t)
    β1, β2, γ = bending_of_cell(three(numbers, ROW.stiffness, t), three(numbers, ROW.stiffness, u), both)
    w, W1, W2 = scale(-1.0 / 6.0, cross(φ1, φ2)), scale(1.0 / 6.0, φ2), scale(-1.0 / 6.0, φ1)
    add_curvature(own, β1, β1, γ, W1, W1)
    add_curvature(others, β2, β2, γ, W2, W2)
    add_curvature(mixed, β1, β2, γ, W1, W2)
    M = scale(1.0 / 6.0, add(add(by_axis(β1, φ1), by_axis(β2, φ2)), by_axis(γ, w)))
    for j in range(3):
        column = cross(M, pick(j, X, Y, Z))
        for k in range(3):
            mixed[k, j] += column[k]
        mixed[j, j] += both[j]


@recursion
def bend_coupling(springs, m, tangent):
    """Add the ∂²V/∂φ_i∂φ_j of coupling m of `springs.pairs` to the three blocks of its cell."""
    numbers, K, c = springs.numbers, springs.coupled[m, 0], springs.pairs[m, 5]
    a, t, b, u = springs.pairs[m, 0], springs.pairs[m, 1], springs.pairs[m, 2], springs.pairs[m, 3]
    inner, outer, w = springs.cells[c, 0], springs.cells[c, 1], half_w(springs, c)
    first, last = springs.slots[inner], springs.slots[outer]
    e, f, φ1, φ2 = pick(a, X, Y, Z), pick(b, X, Y, Z), three(numbers, ROW.φ, first), three(numbers, ROW.φ, last)
    W1, W2 = scale(1.0 / 12.0, φ2), scale(-1.0 / 12.0, φ1)  # of ½ w
    e1, e2 = add_scaled(cross(e, W1), 1.0 * (t == first), e), add_scaled(cross(e, W2), 1.0 * (t == last), e)
    f1, f2 = add_scaled(cross(f, W1), 1.0 * (u == first), f), add_scaled(cross(f, W2), 1.0 * (u == last), f)
    add_products(tangent.bent[inner], K, e1, f1, f1, e1)
    add_products(tangent.bent[outer], K, e2, f2, f2, e2)
    add_products(tangent.bent[tangent.of_cell[c]], K, e1, f2, f1, e2)
    M = add(scale(numbers[ROW.φ + b, u] + dot(w, f), e), scale(numbers[ROW.φ + a, t] + dot(w, e), f))
    for j in range(3):
        column = cross(scale(K / 12.0, M), pick(j, X, Y, Z))
        for k in range(3):
            tangent.bent[tangent.of_cell[c], k, j] += column[k]


@inlined
def add_products(block, K, a, b, c, d):
    """Add K (a bᵀ + c dᵀ)."""
    for k in range(3):
        for j in range(3):
            block[k, j] += K * (a[k] * b[j] + c[k] * d[j])


@recursion
def add_curvature(block, β1, β2, γ, W1, W2):
    """Add β₁∘W₂ + W₁ᵀ β₂∘ + W₁ᵀ γ∘W₂; the arguments W are the vectors of the matrices W ×."""
    for j in range(3):
        e = pick(j, X, Y, Z)
        column = cross(W2, e)
        for k in range(3):
            f = pick(k, X, Y, Z)
            row = cross(W1, f)
            block[k, j] += β1[k] * column[k] + row[j] * β2[j]
            block[k, j] += row[0] * γ[0] * column[0] + row[1] * γ[1] * column[1] + row[2] * γ[2] * column[2]


@inlined
def add_coupling(springs, m, block, sign):
    """Add ± K_ij of coupling m in `springs.pairs` to its block, at its two axes."""
    a, b, k = springs.pairs[m, 0], springs.pairs[m, 2], sign * springs.coupled[m, 0]
    block[a, b] += k  # row: axis of the inner hinge, whose triple comes first or also contains the outer hinge
    if springs.pairs[m, 1] == springs.pairs[m, 3]:
        block[b, a] += k


@recursion
def take_off_linear(springs, tangent):
    """Subtract the chain's K from the values of the blocks."""
    numbers = springs.numbers
    for t in range(len(springs.hinges)):
        for k in range(3):
            tangent.values[t, k, k] -= numbers[ROW.stiffness + k, springs.slots[t]]
    for m in range(len(springs.pairs)):
        add_coupling(springs, m, tangent.values[tangent.of_pair[m]], -1.0)
    for c in range(len(springs.cells)):
        for k in range(3):
            held = numbers[ROW.coupled + k, springs.slots[springs.cells[c, 0]]]
            tangent.values[tangent.of_cell[c], k, k] -= held
