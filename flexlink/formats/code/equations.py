"""Equations of motion of a chain on a tape: ẋ = f(x, u) with x = (z, ż), and the position of the tip.

The algorithms are independent of the kernels, so the self-test of the generated code checks both. All vectors are in
frame 0. Hinges that move one by one: articulated bodies (Featherstone 1983). The bodies outboard of a hinge require at
its point

    n = J α + H a + n₀        f = Hᵀ α + M a + f₀        D = e·J e + A        u = T − e·(n₀ + J ζ)

Shapes: Φᵀ M Φ z̈ = Φᵀ T − Φᵀ T_GC with the columns of Φᵀ M Φ and T_GC by recursive Newton-Euler, and L D Lᵀ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.free_motion import all_motions
from flexlink.formats.code.placed import Placed
from flexlink.formats.code.tape import Number, Tape, function
from flexlink.formats.code.vectors import (
    ZERO,
    Real,
    Vector,
    add,
    apply,
    constant,
    cross,
    dot,
    minus,
    minus_dyad,
    plus,
    product,
    scale,
    skew,
    swung,
    transposed,
)


class Model(NamedTuple):
    """Equations of a chain on a tape."""

    chain: Chain
    tape: Tape
    x: list[Number]  # z, ż
    u: list[Number]  # torques of the driven joints
    rate: list[Real]  # ẋ
    tip: list[Real]  # position [m]

    @property
    def states(self) -> list[str]:
        """Names and units of the states."""
        chain = self.chain
        joints = np.arange(chain.n) if chain.shapes is None else np.argmax(chain.shapes.matrix != 0, axis=0)
        units = [chain.joint_units[k] for k in joints]
        names = list(zip(chain.freedom_names, units, strict=True))
        return [f"q {name} [{unit}]" for name, unit in names] + [f"qd {name} [{unit}/s]" for name, unit in names]

    @property
    def inputs(self) -> list[str]:
        """Names and units of the inputs."""
        return [f"tau {self.chain.joint_name(int(k))} [{self.chain.torque_units[k]}]" for k in self.chain.active]


def model_of(chain: Chain) -> Model:
    """Equations of motion of a chain.

    Raises
    ------
    ArgumentError
        The chain has a feature that generated code does not contain.
    """
    refuse(chain)
    tape, m = Tape(), chain.freedoms
    x, u = [tape.input() for _ in range(2 * m)], [tape.input() for _ in chain.active]
    z, zd = x[:m], x[m:]
    q, qd = _joints(chain, z, chain.rest.tolist()), _joints(chain, zd, [0.0] * chain.n)
    arm = Placed(chain, q, qd)
    torques = _torques(chain, q, qd, u)
    zdd = _articulated(arm, torques) if chain.shapes is None else _projected(arm, torques)
    return Model(chain, tape, x, u, [*zd, *zdd], list(arm.points[-1]))


def refuse(chain: Chain) -> None:
    """Refuse features that generated code does not contain."""
    reasons = {
        "a free base": chain.has_free_base,
        "joints with prescribed motion": bool(chain.hinges["prescribed"].any()),
        "springs of rotation vectors": chain.has_rotation_springs,
        "drag, quadratic or lagging friction": bool(chain.forces),
    }
    for reason, there in reasons.items():
        if there:
            raise ArgumentError(
                f"{chain.name}: code with {reason} is not supported; leave it out, or use the URDF, MJCF or SDF export",
                id="code-not-supported",
            )


def _joints(chain: Chain, z: list[Number], rest: list[float]) -> list[Real]:
    """Angles or rates of all joints, θ₀ + Φ z; without shapes z are these angles."""
    if chain.shapes is None:
        return list(z)
    Φ, found = chain.shapes.matrix.tolist(), list[Real](rest)
    for k, row in enumerate(Φ):
        for j, weight in enumerate(row):
            if weight != 0.0:
                found[k] = found[k] + z[j] * weight
    return found


def _torques(chain: Chain, q: list[Real], qd: list[Real], u: list[Number]) -> list[Real]:
    """T_EX − T_FL − T_FR of every joint."""
    T: list[Real] = [0.0] * chain.n
    for i, k in enumerate(chain.active.tolist()):
        T[k] = u[i]
    bent = [q[k] - float(chain.rest[k]) for k in range(chain.n)]
    for k, hinge in enumerate(chain.hinges):
        T[k] = T[k] - bent[k] * float(hinge["stiffness"]) - qd[k] * float(hinge["damping"])
        if hinge["coulomb"] > 0:
            slip = qd[k] / float(hinge["coulomb_width"])
            T[k] = T[k] - function("tanh", slip, math.nan) * float(hinge["coulomb"])
    for pair in chain.couplings:
        stiffness, damping = float(pair["stiffness"]), float(pair["damping"])
        for i, j in ((pair["inner"], pair["outer"]), (pair["outer"], pair["inner"])):
            T[i] = T[i] - bent[j] * stiffness - qd[j] * damping
    return T


def _articulated(arm: Placed, T: list[Real]) -> list[Real]:
    """q̈ by articulated bodies."""
    chain, bodies = arm.chain, arm.chain.bodies
    zero = constant(np.zeros((3, 3)))
    J, H, M = ([zero] * len(bodies) for _ in range(3))
    n, f = ([ZERO] * len(bodies) for _ in range(2))
    hinges: list[tuple[Vector, Vector, Real, Real]] = [(ZERO, ZERO, 0.0, 0.0)] * chain.n
    for i in range(len(bodies) - 1, -1, -1):
        m, mc, inertia = arm.inertias[i]
        ω = arm.ω[i]
        J[i], H[i] = plus(J[i], inertia), plus(H[i], skew(mc))
        M[i] = plus(M[i], constant(m * np.eye(3)))
        n[i], f[i] = add(n[i], cross(ω, apply(inertia, ω))), add(f[i], swung(ω, mc))
        for k in range(bodies[i]["stop"] - 1, bodies[i]["first"] - 1, -1):
            e, ζ = arm.axes[k], arm.ζ[k]
            if arm.slides[k]:
                by_α, by_a = apply(H[i], e), apply(M[i], e)
                own, n[i], f[i] = by_a, add(n[i], apply(H[i], ζ)), add(f[i], apply(M[i], ζ))
                rest = dot(e, f[i])
            else:
                by_α, by_a = apply(J[i], e), apply(transposed(H[i]), e)
                own, n[i], f[i] = by_α, add(n[i], apply(J[i], ζ)), add(f[i], apply(transposed(H[i]), ζ))
                rest = dot(e, n[i])
            inverse = 1.0 / (dot(e, own) + float(chain.hinges[k]["armature"]))
            free = (T[k] - rest) * inverse
            hinges[k] = by_α, by_a, inverse, free
            J[i], H[i] = minus_dyad(J[i], by_α, by_α, inverse), minus_dyad(H[i], by_α, by_a, inverse)
            M[i] = minus_dyad(M[i], by_a, by_a, inverse)
            n[i], f[i] = add(n[i], scale(free, by_α)), add(f[i], scale(free, by_a))
        parent = arm.parents[i]
        if parent >= 0:
            r, b = skew(arm.levers[i]), arm.centripetal(i)
            force = add(f[i], apply(M[i], b))
            moment = add(add(n[i], apply(H[i], b)), cross(arm.levers[i], force))
            across = minus(transposed(H[i]), product(M[i], r))
            J[parent] = plus(J[parent], plus(minus(J[i], product(H[i], r)), product(r, across)))
            H[parent] = plus(H[parent], plus(H[i], product(r, M[i])))
            M[parent] = plus(M[parent], M[i])
            n[parent], f[parent] = add(n[parent], moment), add(f[parent], force)
    return _accelerate(arm, hinges)


def _accelerate(arm: Placed, hinges: list[tuple[Vector, Vector, Real, Real]]) -> list[Real]:
    """Forward pass of articulated bodies."""
    chain, found = arm.chain, list[Real]([0.0] * arm.chain.n)
    α: list[Vector] = []
    a: list[Vector] = []
    for i, body in enumerate(chain.bodies):
        parent = arm.parents[i]
        α_i = α[parent] if parent >= 0 else ZERO
        a_i: Vector = a[parent] if parent >= 0 else tuple((-chain.gravity).tolist())
        a_i = add(add(a_i, cross(α_i, arm.levers[i])), arm.centripetal(i))
        for k in range(body["first"], body["stop"]):
            by_α, by_a, inverse, free = hinges[k]
            found[k] = free - (dot(by_α, α_i) + dot(by_a, a_i)) * inverse
            moved = add(arm.ζ[k], scale(found[k], arm.axes[k]))
            if arm.slides[k]:
                a_i = add(a_i, moved)
            else:
                α_i = add(α_i, moved)
        α.append(α_i)
        a.append(a_i)
    return found


def _mass(arm: Placed) -> list[list[Real]]:
    """Lower triangle of Φᵀ M Φ, with rotors."""
    chain, Φ = arm.chain, all_motions(arm.chain)
    rotors, M = Φ.T @ (chain.hinges["armature"][:, None] * Φ), list[list[Real]]()
    columns = [_newton_euler(arm, column, moves=False) for column in Φ.T.tolist()]
    for j in range(Φ.shape[1]):
        torques = [_along(Φ[:, j], column) for column in columns]
        M.append([torque + float(rotor) for torque, rotor in zip(torques, rotors[j], strict=True)])
    return M


def _along(shape: Any, torque: list[Real]) -> Real:
    """Σ_k Φ_kj τ_k."""
    total: Real = 0.0
    for k in np.flatnonzero(shape).tolist():
        total = total + torque[k] * float(shape[k])
    return total


def _projected(arm: Placed, T: list[Real]) -> list[Real]:
    """z̈ of the shapes."""
    still = _newton_euler(arm, [0.0] * arm.chain.n, moves=True)
    left = [own - bias for own, bias in zip(T, still, strict=True)]
    return _solved(_mass(arm), [_along(shape, left) for shape in all_motions(arm.chain).T])


def slopes_of(model: Model) -> tuple[list[list[Real]], list[list[Real]]]:
    """Columns of ∂ẋ/∂x and ∂ẋ/∂u: at constant z̈, −(Φᵀ M Φ)⁻¹ Φᵀ times the derivatives of M q̈ + T_GC − T."""
    chain, m, tape = model.chain, model.chain.freedoms, model.tape
    z, zd, zdd = model.x[:m], model.x[m:], model.rate[m:]
    q, qd = _joints(chain, z, chain.rest.tolist()), _joints(chain, zd, [0.0] * chain.n)
    arm, Φ = Placed(chain, q, qd), all_motions(chain)
    qdd = [_along(row, zdd) for row in Φ]
    T, torque = _torques(chain, q, qd, model.u), _newton_euler(arm, qdd, moves=True)  # rotors have constant torques
    left = [_along(shape, [own - asked for own, asked in zip(T, torque, strict=True)]) for shape in Φ.T]
    M, still = _mass(arm), [0.0] * m
    by_x = []
    for k, by in enumerate(model.x):
        rates: list[Real] = [1.0 if k == m + j else 0.0 for j in range(m)]
        by_x.append([*rates, *_solved(M, tape.slopes(left, by, zdd))])
    by_u = [[*still, *_solved(M, Φ[k].tolist())] for k in chain.active.tolist()]
    return by_x, by_u


def _newton_euler(arm: Placed, qdd: Sequence[Real], *, moves: bool) -> list[Real]:
    """M q̈ + T_GC if the arm `moves`, else M q̈, without rotors, by recursive Newton-Euler."""
    chain, bodies = arm.chain, arm.chain.bodies
    α: list[Vector] = []
    a: list[Vector] = []
    n: list[Vector] = []
    f: list[Vector] = []
    for i, body in enumerate(bodies):
        parent = arm.parents[i]
        base: Vector = tuple((-chain.gravity).tolist()) if moves else ZERO
        α_i, a_i = (α[parent], a[parent]) if parent >= 0 else (ZERO, base)
        a_i = add(a_i, cross(α_i, arm.levers[i]))
        if moves:
            a_i = add(a_i, arm.centripetal(i))
        for k in range(body["first"], body["stop"]):
            change = scale(qdd[k], arm.axes[k])
            change = add(change, arm.ζ[k]) if moves else change
            α_i, a_i = (α_i, add(a_i, change)) if arm.slides[k] else (add(α_i, change), a_i)
        m, mc, J = arm.inertias[i]
        force, moment = add(scale(m, a_i), cross(α_i, mc)), add(apply(J, α_i), cross(mc, a_i))
        if moves:
            force = add(force, swung(arm.ω[i], mc))
            moment = add(moment, cross(arm.ω[i], apply(J, arm.ω[i])))
        α.append(α_i)
        a.append(a_i)
        n.append(moment)
        f.append(force)
    torque: list[Real] = [0.0] * chain.n
    for i in range(len(bodies) - 1, -1, -1):
        for k in range(bodies[i]["first"], bodies[i]["stop"]):
            torque[k] = dot(arm.axes[k], f[i] if arm.slides[k] else n[i])
        parent = arm.parents[i]
        if parent >= 0:
            f[parent], n[parent] = add(f[parent], f[i]), add(n[parent], add(n[i], cross(arm.levers[i], f[i])))
    return torque


def _solved(M: list[list[Real]], r: list[Real]) -> list[Real]:
    """Solution of M y = r by M = L D Lᵀ, from the lower triangle."""
    m = len(r)
    L, D, y = [row[:] for row in M], list[Real](), r[:]
    for j in range(m):
        D.append(L[j][j])
        for l in range(j):
            D[j] = D[j] - L[j][l] * L[j][l] * D[l]
        for i in range(j + 1, m):
            for l in range(j):
                L[i][j] = L[i][j] - L[i][l] * L[j][l] * D[l]
            L[i][j] = L[i][j] / D[j]
    for j in range(m):
        for l in range(j):
            y[j] = y[j] - L[j][l] * y[l]
    for j in range(m - 1, -1, -1):
        y[j] = y[j] / D[j]
        for i in range(j + 1, m):
            y[j] = y[j] - L[i][j] * y[i]
    return y
