"""Recursive Newton-Euler for any arm with all operations, the baseline for the gain by removing redundant operations.

It has the body frames and terms of `flexlink/kernels/bodies/rne.py`, but every hinge is a separate joint with a body
(possibly massless), a rotation matrix of nine numbers, and an axis and an offset of three numbers each. So products
with 0 and 1 and sums with 0 are computed like all others. Each column of M takes one complete inverse dynamics, in
which gravity, rates and tip wrench are zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.kernels.tools.axes3 import cos_sin
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.vec3 import ZERO, add, apply, apply_transposed, cross, dot, put, scale, vector


class Rows(NamedTuple):
    """A row for each hinge, and for each body without a hinge (its axis is 0)."""

    hinge: NDArray[np.int64]  # index of the hinge; 0 (unused) for a body without hinges
    axis: Array  # (m, 3)
    placement: Array  # (m, 3, 3)
    offset: Array  # (m, 3)
    mass: Array  # (m,)
    center: Array  # (m, 3)
    inertia: Array  # (m, 3, 3)
    armature: Array  # (m,)
    gravity: Array  # (3,)


def rows_of(chain: Chain) -> Rows:
    """The chain with one joint per row: a hinge before the last one of its body moves a massless body."""
    parts: list[tuple[Any, ...]] = []
    for body in chain.bodies:
        hinges = range(body.first, body.stop)
        for place, k in enumerate(hinges or [0]):
            axis = np.eye(3)[chain.hinges[k].axis] if hinges else np.zeros(3)
            armature = chain.hinges[k].armature if hinges else 0.0
            fixed = (np.array(body.rotation), np.array(body.translation)) if place == 0 else (np.eye(3), np.zeros(3))
            last = place == max(len(hinges), 1) - 1
            load = (body.mass, body.center, body.inertia) if last else (0.0, np.zeros(3), np.zeros((3, 3)))
            parts.append((k, axis, *fixed, *load, armature))
    columns = [np.array(column) for column in zip(*parts, strict=True)]
    return Rows._make([*columns, np.array(chain.gravity)])


@kernel
def turned(rows: Any, q: Any) -> Any:
    """The rotation of every row, (m, 3, 3): placement times c 1 + s [e]× + (1 − c) e eᵀ."""
    rotations, R = np.empty(rows.placement.shape), np.empty((3, 3))
    for i in range(len(rows.mass)):
        x, y, z = vector(rows.axis[i])
        c, s = cos_sin(q[rows.hinge[i]]) if x + y + z > 0.0 else (1.0, 0.0)
        v = 1.0 - c
        R[0, 0], R[0, 1], R[0, 2] = c + v * x * x, v * x * y - s * z, v * x * z + s * y
        R[1, 0], R[1, 1], R[1, 2] = v * x * y + s * z, c + v * y * y, v * y * z - s * x
        R[2, 0], R[2, 1], R[2, 2] = v * x * z - s * y, v * y * z + s * x, c + v * z * z
        for row in range(3):
            for column in range(3):
                total = 0.0
                for k in range(3):
                    total += rows.placement[i, row, k] * R[k, column]
                rotations[i, row, column] = total
    return rotations


@kernel
def newton_euler(rows: Any, rotations: Any, gravity: Any, wrench: Any, qd: Any, qdd: Any, tau: Any, loads: Any) -> None:
    """τ = M q̈ + T_GC, written to `tau`; gravity and wrench in frame 0."""
    ω = α = ZERO
    a = scale(-1.0, gravity)
    f_tip, n_tip = vector(wrench), (wrench[3], wrench[4], wrench[5])
    for i in range(len(rows.mass)):
        R, r, e, c = rotations[i], vector(rows.offset[i]), vector(rows.axis[i]), vector(rows.center[i])
        k = rows.hinge[i]
        a = apply_transposed(R, add(a, add(cross(α, r), cross(ω, cross(ω, r)))))
        ω, α = apply_transposed(R, ω), apply_transposed(R, α)
        α = add(α, add(scale(qdd[k], e), cross(ω, scale(qd[k], e))))
        ω = add(ω, scale(qd[k], e))
        f_tip, n_tip = apply_transposed(R, f_tip), apply_transposed(R, n_tip)
        F = scale(rows.mass[i], add(a, add(cross(α, c), cross(ω, cross(ω, c)))))
        I = rows.inertia[i]
        put(loads[i, 0], F)
        put(loads[i, 1], add(add(apply(I, α), cross(ω, apply(I, ω))), cross(c, F)))
    f, n = scale(-1.0, f_tip), scale(-1.0, n_tip)
    for i in range(len(rows.mass) - 1, -1, -1):
        R, r, e = rotations[i], vector(rows.offset[i]), vector(rows.axis[i])
        k = rows.hinge[i]
        f, n = add(f, vector(loads[i, 0])), add(n, vector(loads[i, 1]))
        tau[k] += dot(e, n) + rows.armature[i] * qdd[k]
        f, n = apply(R, f), apply(R, n)
        n = add(n, cross(r, f))


@kernel
def bias_loop(rows: Any, q: Any, qd: Any, calls: int) -> Any:
    """Compute T_GC (q̈ = 0) `calls` times, cycling through the states (s, n)."""
    n = q.shape[1]
    rest, wrench, tau, loads = np.zeros(n), np.zeros(6), np.zeros(n), np.empty((len(rows.mass), 2, 3))
    for i in range(calls):
        s = i % len(q)
        tau[:] = 0.0
        newton_euler(rows, turned(rows, q[s]), vector(rows.gravity), wrench, qd[s], rest, tau, loads)
    return tau


@kernel
def mass_loop(rows: Any, q: Any, calls: int) -> Any:
    """Compute M `calls` times by method 1, cycling through the angles (s, n); rotations are computed once per M."""
    n = q.shape[1]
    rest, one, wrench, column = np.zeros(n), np.zeros(n), np.zeros(6), np.empty(n)
    M, loads = np.empty((n, n)), np.empty((len(rows.mass), 2, 3))
    for i in range(calls):
        rotations = turned(rows, q[i % len(q)])
        for j in range(n):
            one[j] = 1.0
            column[:] = 0.0
            newton_euler(rows, rotations, ZERO, wrench, rest, one, column, loads)
            M[:, j] = column
            one[j] = 0.0
    return M
