"""Lagrangian of a planar chain in absolute angles, to 50 digits; it shares no algorithm with the kernels.

Points of the plane are complex numbers. Body i turns by φ_i = α_i + Σ_j≤i q_j, and its centre is at
p_i = p_0 + Σ_j≤i d_ij exp(iφ_j), with d_ij the offset of the next hinge (j < i) or of the centre (j = i). With
W_jk = Σ_i m_i conj(d_ij) d_ik and E_jk = exp(i(φ_k − φ_j)) W_jk, Lagrange's equation for φ_j reads

    Σ_k Re(E_jk) φ̈_k + I_j φ̈_j − Σ_k Im(E_jk) φ̇_k² − Σ_i m_i Re(conj(i d_ij exp(iφ_j)) g) = generalised torque

and φ = α + L q, with L the lower triangle of ones, transforms it to joint angles: M = Lᵀ H L with
H_jk = Re(E_jk) + I_j δ_jk, plus the rotors, and T_GC is Lᵀ times the terms without φ̈.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpmath import mp, mpc, mpf

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError

DIGITS = 50
Vector = list[Any]


class PlanarChain:
    """A chain of one-axis hinges with axes normal to one plane.

    Every method takes and returns mpmath numbers; call them inside `mp.workdps(DIGITS)`.

    Raises
    ------
    ArgumentError
        The axes of the chain are not parallel.
    """

    def __init__(self, chain: Chain) -> None:
        bodies, hinges = chain.bodies[:-1], chain.hinges  # the last body is the tip frame
        if (bodies["stop"] - bodies["first"] != 1).any() or (hinges["axis"] != 2).any():
            raise ArgumentError(f"{chain.name}: not planar; every body needs one hinge, about Z")
        if not all(np.array_equal(b["rotation"][2], (0, 0, 1)) for b in bodies[1:]):
            raise ArgumentError(f"{chain.name}: not planar; the hinge axes are not parallel")
        with mp.workdps(DIGITS):
            self.n = chain.n
            base = bodies[0]["rotation"]  # its columns are the plane's axes and normal in frame 0
            along = [sum((mpf(g) * mpf(c) for g, c in zip(chain.gravity, base[:, k], strict=True))) for k in (0, 1)]
            self.g = mpc(*along)
            self.mounts = [mpf(0)] + [mp.atan2(mpf(b["rotation"][1, 0]), mpf(b["rotation"][0, 0])) for b in bodies[1:]]
            offsets = [_plane(b["translation"]) for b in bodies[1:]]
            self.masses = [mpf(m) for m in bodies["mass"]]
            self.inertias = [mpf(J[2, 2]) for J in bodies["inertia"]]
            centers = [_plane(c) for c in bodies["center"]]
            self.d = [[*offsets[:i], centers[i]] for i in range(self.n)]
            self.W = [[self._weight(j, k) for k in range(self.n)] for j in range(self.n)]
            self.first_moments = [
                mp.fsum(self.masses[i] * self.d[i][j] for i in range(j, self.n)) for j in range(self.n)
            ]
            self.joints = joints_of(chain)

    def _weight(self, j: int, k: int) -> Any:
        return mp.fsum(self.masses[i] * mp.conj(self.d[i][j]) * self.d[i][k] for i in range(max(j, k), self.n))

    def _turned(self, q: Sequence[Any]) -> tuple[Vector, list[Vector]]:
        """exp(iφ_j) of every body, and the matrix E_jk, as defined above."""
        φ = _running_sum([a + x for a, x in zip(self.mounts, q, strict=True)])
        e = [mp.expj(x) for x in φ]
        return e, [[mp.conj(e[j]) * e[k] * self.W[j][k] for k in range(self.n)] for j in range(self.n)]

    def mass_matrix(self, q: Sequence[Any]) -> Any:
        """M(q) [kg m²], an mpmath matrix (n, n)."""
        return self._mass(self._turned(q)[1])

    def _mass(self, E: list[Vector]) -> Any:
        H = [[mp.re(x) for x in row] for row in E]
        for j in range(self.n):
            H[j][j] += self.inertias[j]
        rows = [_sum_from_end(row) for row in H]  # H L
        columns = [_sum_from_end([row[k] for row in rows]) for k in range(self.n)]  # Lᵀ (H L), column by column
        M = mp.matrix(self.n, self.n)
        for k, column in enumerate(columns):
            for j, value in enumerate(column):
                M[j, k] = value + (self.joints[k]["armature"] if j == k else 0)
        return M

    def bias_torque(self, q: Sequence[Any], qd: Sequence[Any]) -> Vector:
        """T_GC(q, q̇) [N m], without tip wrench."""
        return self._bias(*self._turned(q), qd)

    def _bias(self, e: Vector, E: list[Vector], qd: Sequence[Any]) -> Vector:
        squares = [x * x for x in _running_sum(qd)]
        weights = [mp.re(mp.conj(mpc(0, 1) * m * x) * self.g) for m, x in zip(self.first_moments, e, strict=True)]
        return _sum_from_end([-mp.fdot([mp.im(x) for x in E[j]], squares) - weights[j] for j in range(self.n)])

    def forward_dynamics(self, q: Sequence[Any], qd: Sequence[Any], tau: Sequence[Any] | None = None) -> Vector:
        """q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR [rad/s²]."""
        e, E = self._turned(q)
        rest = zip(tau or [mpf(0)] * self.n, self._bias(e, E, qd), joint_torques(self.joints, q, qd), strict=True)
        return list(mp.lu_solve(self._mass(E), mp.matrix([t - b - s for t, b, s in rest])))

    def energy(self, q: Sequence[Any], qd: Sequence[Any]) -> Any:
        """Kinetic + gravity + elastic energy [J]; gravity is zero if all mass is at the first hinge."""
        e, E = self._turned(q)
        M = self._mass(E)
        kinetic = mp.fsum(M[j, k] * qd[j] * qd[k] for j in range(self.n) for k in range(self.n)) / 2
        gravity = -mp.fsum(mp.re(mp.conj(m * x) * self.g) for m, x in zip(self.first_moments, e, strict=True))
        elastic = mp.fsum(h["stiffness"] * (x - h["rest"]) ** 2 for h, x in zip(self.joints, q, strict=True)) / 2
        return kinetic + gravity + elastic


def joints_of(chain: Chain) -> list[dict[str, Any]]:
    """Constants of the springs, dampers, friction and rotors of the hinges as exact numbers."""
    names = ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature")
    return [{name: mpf(float(hinge[name])) for name in names} for hinge in chain.hinges]


def joint_torques(joints: Sequence[Mapping[str, Any]], q: Sequence[Any], qd: Sequence[Any]) -> Vector:
    """T_FL + T_FR of joints from `joints_of` [N m]."""
    rubbing = [
        h["coulomb"] * mp.tanh(v / h["coulomb_width"]) if h["coulomb"] else 0 for h, v in zip(joints, qd, strict=True)
    ]
    return [
        h["stiffness"] * (x - h["rest"]) + h["damping"] * v + rub
        for h, x, v, rub in zip(joints, q, qd, rubbing, strict=True)
    ]


def _plane(v: Any) -> Any:
    return mpc(float(v[0]), float(v[1]))


def _running_sum(values: Sequence[Any]) -> Vector:
    """L v, the running sums of v."""
    total, out = mpf(0), []
    for value in values:
        total += value
        out.append(total)
    return out


def _sum_from_end(values: Sequence[Any]) -> Vector:
    """Lᵀ v, the sums of v from each element to the last."""
    return _running_sum(values[::-1])[::-1]
