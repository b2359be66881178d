"""Newton-Euler equations of any chain, projected on its hinges, to 50 digits; shares no recursion with the kernels.

In frame 0 every body i has a centre c_i, a rotation R_i and the Jacobians of its centre and of its rotation,

    v_ik = e_k × (c_i − p_k)        w_ik = e_k        for the hinges k between it and the base, 0 for the others,

with e_k the axis of hinge k and p_k a point on it; a sliding hinge has v_ik = e_k and w_ik = 0. With a_i, α_i the
accelerations at q̈ = 0, J_i = R_i I_i R_iᵀ and A_k the rotor inertia, the principle of virtual power (Kane) reads

    M_jk = Σ_i m_i v_ij·v_ik + w_ij·J_i w_ik + A_k δ_jk
    T_GC_j = Σ_i v_ij·m_i (a_i − g) + w_ij·(J_i α_i + ω_i × J_i ω_i)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from validation.oracles.planar_chain import DIGITS, joint_torques, joints_of

STEP = mpf(10) ** -20
"""Step of central differences [rad, rad/s]."""
DIFFERENCES = 60
"""Working digits for central differences, which lose 20 and are accurate to 40; inverting M at 89.99° loses 8."""
Vector = list[Any]
Matrix = list[Vector]


class Body(NamedTuple):
    """A body with inertia: its position, and its motion at q̈ = 0, in frame 0."""

    mass: Any
    inertia: Matrix
    center: Vector
    rate: Vector
    acceleration: Vector
    angular: Vector
    hinges: tuple[int, ...]  # numbers of the hinges between it and the base


class Frame(NamedTuple):
    """Pose and motion of a body frame at q̈ = 0, in frame 0."""

    R: Matrix
    p: Vector
    ω: Vector
    α: Vector
    a: Vector
    hinges: tuple[int, ...]


class Hinges(NamedTuple):
    """All hinges: axes and points on them in frame 0, and whether they slide."""

    axes: list[Vector]
    points: list[Vector]
    slide: list[bool]

    def moves(self, k: int, place: Vector) -> Vector:
        """Velocity of a point if hinge k moves at unit rate."""
        return self.axes[k] if self.slide[k] else cross(self.axes[k], sub(place, self.points[k]))

    def turns(self, k: int) -> Vector:
        """Angular velocity if hinge k moves at unit rate."""
        return [mpf(0)] * 3 if self.slide[k] else self.axes[k]


class Row(NamedTuple):
    """A body of the chain, with its floats converted to exact numbers."""

    parent: int
    hinges: range
    translation: Vector
    rotation: Matrix
    mass: Any
    center: Vector
    inertia: Matrix
    has_inertia: bool


def _row(body: Any) -> Row:
    rotation, inertia = ([exactly(line) for line in body[name]] for name in ("rotation", "inertia"))
    return Row(
        int(body["parent"]), range(int(body["first"]), int(body["stop"])), exactly(body["translation"]), rotation,
        mpf(float(body["mass"])), exactly(body["center"]), inertia, bool(body["mass"] or body["inertia"].any()),
    )  # fmt: skip


class SpatialChain:
    """A chain or tree of any layout, without tip wrench.

    Every method takes and returns mpmath numbers; call them inside `mp.workdps(DIGITS)`.
    """

    def __init__(self, chain: Chain) -> None:
        self.n, self.chain = chain.n, chain
        self.g = [mpf(float(x)) for x in chain.gravity]
        self.joints = joints_of(chain)
        self.rows = [_row(body) for body in chain.bodies]

    def equations(self, q: Sequence[Any], qd: Sequence[Any]) -> tuple[Any, Vector]:
        """M(q) [kg m²], an mpmath matrix (n, n), and T_GC(q, q̇) [N m]."""
        hinges, bodies, _ = self.place(q, qd)
        M, bias = mp.zeros(self.n, self.n), [mpf(0)] * self.n
        for body in bodies:
            v = {k: hinges.moves(k, body.center) for k in body.hinges}
            w = {k: hinges.turns(k) for k in body.hinges}
            Jw = {k: times(body.inertia, w[k]) for k in body.hinges}
            force = [body.mass * (a - g) for a, g in zip(body.acceleration, self.g, strict=True)]
            spin = times(body.inertia, body.rate)
            moment = add(times(body.inertia, body.angular), cross(body.rate, spin))
            for j in body.hinges:
                bias[j] += mp.fdot(v[j], force) + mp.fdot(w[j], moment)
                for k in (k for k in body.hinges if k <= j):
                    M[j, k] += body.mass * mp.fdot(v[j], v[k]) + mp.fdot(w[j], Jw[k])
        for j in range(self.n):
            M[j, j] += self.joints[j]["armature"]
            for k in range(j):
                M[k, j] = M[j, k]
        return M, bias

    def load(self, q: Sequence[Any], wrench: Sequence[Any]) -> Vector:
        """Jᵀ w of a wrench on the tip, axes of frame 0 [N m]."""
        hinges, _, frames = self.place(q, [mpf(0)] * self.n)
        return self._load(hinges, frames, wrench)

    def _load(self, hinges: Hinges, frames: Sequence[Frame], wrench: Sequence[Any]) -> Vector:
        tip = frames[1 + self.chain.loaded]
        force, moment, load = list(wrench[:3]), list(wrench[3:]), [mpf(0)] * self.n
        for k in tip.hinges:
            load[k] = mp.fdot(hinges.moves(k, tip.p), force) + mp.fdot(hinges.turns(k), moment)
        return load

    def drag(self, q: Sequence[Any], qd: Sequence[Any]) -> Vector:
        """T_DRAG = −Σ Jᵀ f over all drag points of the links [N m]."""
        hinges, _, frames = self.place(q, qd)
        return self._drag(hinges, frames, qd)

    def _drag(self, hinges: Hinges, frames: Sequence[Frame], qd: Sequence[Any]) -> Vector:
        found = [mpf(0)] * self.n
        for row in self.chain.drag:
            frame = frames[1 + int(row["body"])]
            place = add(frame.p, times(frame.R, exactly(row["point"])))
            moves = {k: hinges.moves(k, place) for k in frame.hinges}
            v = [mp.fsum(qd[k] * moves[k][axis] for k in frame.hinges) for axis in range(3)]
            across = [times(frame.R, exactly(axis)) for axis in row["across"]]
            speeds = [mp.fdot(v, axis) for axis in across]
            speed = mp.sqrt(mp.fsum(s * s for s in speeds))
            for d, s, axis in zip(exactly(row["drag"]), speeds, across, strict=True):
                for k in frame.hinges:
                    found[k] += d * speed * s * mp.fdot(moves[k], axis)
        return found

    def torque(self, q: Vector, qd: Vector, qdd: Vector, wrench: Vector) -> Vector:
        """M q̈ + T_GC − Jᵀ w + T_FL + T_FR + T_DRAG [N m], summed over the bodies without forming M."""
        hinges, bodies, frames = self.place(q, qd)
        found = add(joint_torques(self.joints, q, qd), self._drag(hinges, frames, qd))
        for k, joint in enumerate(self.joints):
            found[k] += joint["armature"] * qdd[k]
        for body in bodies:
            a, α = body.acceleration, body.angular
            moves = {k: hinges.moves(k, body.center) for k in body.hinges}
            turns = {k: hinges.turns(k) for k in body.hinges}
            for k in body.hinges:
                a, α = add(a, [qdd[k] * x for x in moves[k]]), add(α, [qdd[k] * x for x in turns[k]])
            force = [body.mass * (x - g) for x, g in zip(a, self.g, strict=True)]
            moment = add(times(body.inertia, α), cross(body.rate, times(body.inertia, body.rate)))
            for k in body.hinges:
                found[k] += mp.fdot(moves[k], force) + mp.fdot(turns[k], moment)
        return sub(found, self._load(hinges, frames, wrench))

    def slopes(self, q: Vector, qd: Vector, qdd: Vector, wrench: Vector) -> tuple[Any, Any]:
        """∂T/∂q and ∂T/∂q̇ of `torque`, (n, n), by central differences with an error of order STEP²."""
        by_angle, by_rate = mp.zeros(self.n, self.n), mp.zeros(self.n, self.n)
        for j in range(self.n):
            h = [STEP * (k == j) for k in range(self.n)]
            by_angle[:, j] = self._slope([self.torque(step(q, h), qd, qdd, wrench) for step in (add, sub)])
            by_rate[:, j] = self._slope([self.torque(q, step(qd, h), qdd, wrench) for step in (add, sub)])
        return by_angle, by_rate

    def _slope(self, torques: Sequence[Vector]) -> Any:
        return mp.matrix([x / (2 * STEP) for x in sub(*torques)])

    def forward_slopes(self, q: Vector, qd: Vector, tau: Vector, wrench: Vector) -> tuple[Vector, list[Any]]:
        """q̈, then ∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX = M⁻¹, (n, n)."""
        M, bias = self.equations(q, qd)
        rest = zip(tau, bias, joint_torques(self.joints, q, qd), self.load(q, wrench), strict=True)
        inverse = M**-1
        qdd = list(inverse * mp.matrix([t - b - joint + w for t, b, joint, w in rest]))
        by_angle, by_rate = self.slopes(q, qd, qdd, wrench)
        return qdd, [-inverse * by_angle, -inverse * by_rate, inverse]

    def forward_dynamics(self, q: Sequence[Any], qd: Sequence[Any], tau: Sequence[Any]) -> Vector:
        """q̈ from M q̈ = T_EX − T_GC − T_FL − T_FR [rad/s²]."""
        M, bias = self.equations(q, qd)
        rest = [t - b - s for t, b, s in zip(tau, bias, joint_torques(self.joints, q, qd), strict=True)]
        return list(mp.lu_solve(M, mp.matrix(rest)))

    def place(self, q: Sequence[Any], qd: Sequence[Any]) -> tuple[Hinges, list[Body], list[Frame]]:
        """The hinges, the bodies with inertia, and the frames of the base and all bodies."""
        zero, one = mpf(0), mpf(1)
        rest = [zero] * 3
        frames = [Frame([[one, zero, zero], [zero, one, zero], [zero, zero, one]], rest, rest, rest, rest, ())]
        hinges, bodies = Hinges([], [], []), []
        for row in self.rows:
            R, p, ω, α, a, before = frames[row.parent]
            r = times(R, row.translation)
            p, a = add(p, r), add(a, add(cross(α, r), cross(ω, cross(ω, r))))
            R = product(R, row.rotation)
            for k in row.hinges:
                slides, axis = divmod(int(self.chain.hinges["axis"][k]), 3)
                e = [R[line][axis] for line in range(3)]
                hinges.axes.append(e)
                hinges.points.append(p)
                hinges.slide.append(bool(slides))
                before = (*before, k)
                if slides:
                    out = [q[k] * x for x in e]
                    p, a = add(p, out), add(a, add(cross(α, out), cross(ω, cross(ω, out))))
                    a = add(a, [2 * qd[k] * x for x in cross(ω, e)])
                    continue
                α = add(α, [qd[k] * x for x in cross(ω, e)])
                ω = add(ω, [qd[k] * x for x in e])
                R = product(R, turn(axis, q[k]))
            frames.append(Frame(R, p, ω, α, a, before))
            if row.has_inertia:
                c = times(R, row.center)
                inertia = product(product(R, row.inertia), [list(column) for column in zip(*R, strict=True)])
                acceleration = add(a, add(cross(α, c), cross(ω, cross(ω, c))))
                bodies.append(Body(row.mass, inertia, add(p, c), ω, acceleration, α, before))
        return hinges, bodies, frames


def accelerations(chain: Chain, *states: Sequence[Any]) -> list[NDArray[np.float64]]:
    """q̈ [rad/s²] of states (q, q̇, T_EX), rounded once."""
    oracle = SpatialChain(chain)
    with mp.workdps(2 * DIGITS):  # M loses up to 36 digits at gimbal lock
        exact = [oracle.forward_dynamics(*(exactly(part) for part in state)) for state in states]
        return [np.array(values, dtype=np.float64) for values in exact]


def derivatives(chain: Chain, *state: Any) -> list[NDArray[np.float64]]:
    """∂q̈/∂q, ∂q̈/∂q̇ and M⁻¹ (n, n) at (q, q̇, T_EX, wrench), rounded once."""
    with mp.workdps(DIFFERENCES):
        _, found = SpatialChain(chain).forward_slopes(*(exactly(part) for part in state))
        return [np.array(part.tolist(), dtype=np.float64) for part in found]


def exactly(values: Any) -> Vector:
    """Convert floats exactly."""
    return [mpf(float(x)) for x in values]


def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return [x + y for x, y in zip(a, b, strict=True)]


def sub(a: Vector, b: Vector) -> Vector:
    """a − b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def times(A: Matrix, b: Vector) -> Vector:
    """A b."""
    return [mp.fdot(row, b) for row in A]


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = list(zip(*B, strict=True))
    return [[mp.fdot(row, column) for column in columns] for row in A]


def turn(axis: int, angle: Any) -> Matrix:
    """Rotation about a coordinate axis."""
    R = [[mpf(i == j) for j in range(3)] for i in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i][i] = R[j][j] = mp.cos(angle)
    R[j][i] = mp.sin(angle)
    R[i][j] = -R[j][i]
    return R
