"""Dynamics of any chain to 100 digits in O(n), with all spatial vectors about the origin of frame 0.

All motions (ω, v) and forces (n, f) refer to one fixed point, so those of neighbouring bodies add without transforms.
For hinge k with axis e through p, s = (e, p × e); Ī is the 6 × 6 inertia of a body; motion · force is power:

    V_k = V_k−1 + s_k q̇_k                      ṡ_k = V_k × s_k
    C_k = Ī_k + C_k+1                          M_jk = s_j · C_k s_k + A_k δ_jk,  j ≤ k                (composite bodies)
    F_k = Ī_k (Γ_k − g) + V_k ×* Ī_k V_k + F_k+1,  Γ_k = Γ_k−1 + ṡ_k q̇_k       T_GC,k = s_k · F_k
    U = I^A s,  D = s · U + A,  u = T − s · p^A,  I^A ← Ī + I^A − U Uᵀ/D       q̈ = (u − U · (Γ + ṡ q̇))/D  (Featherstone)

Here A is the rotor inertia, Γ the acceleration of a body at q̈ = 0, g gravity, T a hinge's torque, and I^A, p^A are
Featherstone's articulated inertia and bias force.

Using one fixed point loses some of the 100 digits; the results are rounded once, to float64.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from validation.oracles.planar_chain import joint_torques, joints_of
from validation.oracles.spatial_chain import Matrix, Vector, add, cross, exactly, product, sub, times, turn

DIGITS = 100


class _Hinge(NamedTuple):
    """Position and motion of a hinge about the origin of frame 0."""

    s: Vector
    bias: Vector  # ṡ q̇
    V: Vector  # spatial velocity of the attached body
    inertia: Matrix | None  # of the attached body; None between the axes of one joint


class CommonOrigin:
    """A chain at one state, without tip wrench: M(q), T_GC(q, q̇) and q̈ as floats, each rounded once."""

    def __init__(self, chain: Chain, q: Array, qd: Array) -> None:
        with mp.workdps(DIGITS):
            self.chain, self.n = chain, chain.n
            self.q, self.qd = exactly(q), exactly(qd)
            self.joints = joints_of(chain)
            self.lift = [mpf(0)] * 3 + [-x for x in exactly(chain.gravity)]
            self.hinges = self._placed()

    def mass_matrix(self) -> Array:
        """M(q) [kg m²], shape (n, n)."""
        M = np.empty((self.n, self.n))
        with mp.workdps(DIGITS):
            composite = [[mpf(0)] * 6 for _ in range(6)]
            for k in reversed(range(self.n)):
                composite = _sum(composite, self.hinges[k].inertia)
                force = times(composite, self.hinges[k].s)
                for j in range(k + 1):
                    value = mp.fdot(self.hinges[j].s, force) + (self.joints[k]["armature"] if j == k else 0)
                    M[j, k] = M[k, j] = float(value)
        return M

    def bias_torque(self) -> Array:
        """T_GC(q, q̇) [N m], shape (n,)."""
        torque = np.empty(self.n)
        with mp.workdps(DIGITS):
            forces, accelerations = self._gyroscopic(), self._biases()
            force = [mpf(0)] * 6
            for k in reversed(range(self.n)):
                hinge = self.hinges[k]
                if hinge.inertia is not None:
                    force = add(force, add(times(hinge.inertia, accelerations[k]), forces[k]))
                torque[k] = float(mp.fdot(hinge.s, force))
        return torque

    def forward_dynamics(self, tau: Array) -> Array:
        """q̈ [rad/s²] under drive torques T_EX, springs, dampers and dry friction, shape (n,)."""
        with mp.workdps(DIGITS):
            left = sub(exactly(tau), joint_torques(self.joints, self.q, self.qd))
            forces, zero = self._gyroscopic(), mpf(0)
            inertia, force = [[zero] * 6 for _ in range(6)], [zero] * 6
            solved: list[tuple[Vector, Any, Any]] = []
            for k in reversed(range(self.n)):
                hinge = self.hinges[k]
                inertia, force = _sum(inertia, hinge.inertia), add(force, forces[k])
                U = times(inertia, hinge.s)
                D, u = mp.fdot(hinge.s, U) + self.joints[k]["armature"], left[k] - mp.fdot(hinge.s, force)
                solved.append((U, D, u))
                scaled = [x / D for x in U]
                inertia = [
                    [x - a * b for x, b in zip(row, U, strict=True)] for row, a in zip(inertia, scaled, strict=True)
                ]
                force = add(force, add(times(inertia, hinge.bias), [x * u for x in scaled]))
            acceleration, qdd = self.lift, np.empty(self.n)
            for k, (U, D, u) in enumerate(reversed(solved)):
                hinge = self.hinges[k]
                acceleration = add(acceleration, hinge.bias)
                rate = (u - mp.fdot(U, acceleration)) / D
                acceleration = add(acceleration, [rate * x for x in hinge.s])
                qdd[k] = float(rate)
        return qdd

    def _gyroscopic(self) -> list[Vector]:
        """V ×* Ī V of the body attached to each hinge."""
        none = [mpf(0)] * 6
        return [
            none if hinge.inertia is None else _cross_force(hinge.V, times(hinge.inertia, hinge.V))
            for hinge in self.hinges
        ]

    def _biases(self) -> list[Vector]:
        """Accelerations of all bodies at q̈ = 0, minus gravity."""
        found, sum_of = [], self.lift
        for hinge in self.hinges:
            sum_of = add(sum_of, hinge.bias)
            found.append(sum_of)
        return found

    def _placed(self) -> list[_Hinge]:
        zero, one = mpf(0), mpf(1)
        R: Matrix = [[one, zero, zero], [zero, one, zero], [zero, zero, one]]
        p, V, hinges = [zero] * 3, [zero] * 6, []
        for row in self.chain.bodies:
            p = add(p, times(R, exactly(row["translation"])))
            R = product(R, [exactly(line) for line in row["rotation"]])
            for k in range(int(row["first"]), int(row["stop"])):
                axis = int(self.chain.hinges["axis"][k])
                e = [R[line][axis] for line in range(3)]
                s = e + cross(p, e)
                V = add(V, [self.qd[k] * x for x in s])
                hinges.append(_Hinge(s, [self.qd[k] * x for x in _cross_motion(V, s)], V, None))
                R = product(R, turn(axis, self.q[k]))
            if hinges and (row["mass"] or row["inertia"].any()):
                hinges[-1] = hinges[-1]._replace(inertia=_sum(_inertia(row, R, p), hinges[-1].inertia))
        return hinges


def _inertia(row: Any, R: Matrix, p: Vector) -> Matrix:
    """Ī of a body about the origin, [[I − m c̃ c̃, m c̃], [−m c̃, m]] with c its centre and c̃ x = c × x."""
    m, c = mpf(float(row["mass"])), add(p, times(R, exactly(row["center"])))
    about = product(product(R, [exactly(line) for line in row["inertia"]]), [list(x) for x in zip(*R, strict=True)])
    square, out = mp.fdot(c, c), [[mpf(0)] * 6 for _ in range(6)]
    tilde = [[mpf(0), -c[2], c[1]], [c[2], mpf(0), -c[0]], [-c[1], c[0], mpf(0)]]
    for i in range(3):
        for j in range(3):
            out[i][j] = about[i][j] - m * c[i] * c[j] + (m * square if i == j else 0)
            out[i][j + 3] = m * tilde[i][j]
            out[i + 3][j] = -m * tilde[i][j]
        out[i + 3][i + 3] = m
    return out


def _sum(A: Matrix, B: Matrix | None) -> Matrix:
    return A if B is None else [add(x, y) for x, y in zip(A, B, strict=True)]


def _cross_motion(V: Vector, s: Vector) -> Vector:
    """V × s of two motions."""
    return cross(V[:3], s[:3]) + add(cross(V[:3], s[3:]), cross(V[3:], s[:3]))


def _cross_force(V: Vector, F: Vector) -> Vector:
    """V ×* F of a motion V and a force F."""
    return add(cross(V[:3], F[:3]), cross(V[3:], F[3:])) + cross(V[:3], F[3:])


def of_state(chain: Chain, q: Array, qd: Array, tau: Array) -> dict[str, Array]:
    """M, T_GC and q̈, by name."""
    at = CommonOrigin(chain, q, qd)
    return {"M": at.mass_matrix(), "T_GC": at.bias_torque(), "q̈": at.forward_dynamics(tau)}
