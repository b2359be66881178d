"""Closed loops of another make: Pinocchio's dynamics with multipliers at acceleration level, integrated by SciPy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.kernels.stepping.ties import KIND


class Loop:
    """A chain, exported to URDF, whose points are tied: M q̈ + h + Jᵀ λ = τ, J q̈ + J̇ q̇ = 0.

    The points are where flexlink has them with all coordinates at zero; from there on, Pinocchio moves them.
    """

    def __init__(self, chain: fl.Chain, rows: np.ndarray) -> None:
        self.chain, self.rows = chain, rows
        self.model = pin.buildModelFromXML(fl.to_urdf(chain))
        self.model.gravity.linear = np.asarray(chain.gravity)
        self.data = self.model.createData()
        self.order = [self.model.joints[self.model.getJointId(name)].idx_v for name in chain.joint_names]
        pin.forwardKinematics(self.model, self.data, pin.neutral(self.model))
        self.ends = [(self._end(row["a"], row["point_a"]), self._end(row["b"], row["point_b"])) for row in rows]

    def _end(self, body: int, point: np.ndarray) -> tuple[int, np.ndarray]:
        """Joint and point in its axes of a point of a body."""
        if body < 0:
            return 0, point
        pose = fl.frames(self.chain, np.zeros(self.chain.n))
        place = pose.points[body] + pose.rotations[body] @ point
        bodies = self.chain.bodies
        while bodies["stop"][body] == bodies["first"][body]:
            body = bodies["parent"][body] - 1
        joint = self.model.getJointId(self.chain.joint_names[bodies["stop"][body] - 1])
        return joint, self.data.oMi[joint].actInv(place)

    def _moves(self, joint: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, Jacobian and acceleration without q̈ of a point."""
        if not joint:
            return point, np.zeros((3, self.chain.n)), np.zeros(3)
        model, data = self.model, self.data
        axes, arm = pin.LOCAL_WORLD_ALIGNED, data.oMi[joint].rotation @ point
        J, a = pin.getJointJacobian(model, data, joint, axes), pin.getClassicalAcceleration(model, data, joint, axes)
        ω = pin.getVelocity(model, data, joint, axes).angular
        return (
            data.oMi[joint].act(point),
            J[:3] - pin.skew(arm) @ J[3:],
            a.linear + np.cross(a.angular, arm) + np.cross(ω, np.cross(ω, arm)),
        )

    def ties(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """g, J and J̇ q̇, in Pinocchio's order of the coordinates."""
        pin.forwardKinematics(self.model, self.data, q, qd, np.zeros(self.chain.n))
        pin.computeJointJacobians(self.model, self.data, q)
        found = []
        for row, (one, other) in zip(self.rows, self.ends, strict=True):
            (a, J_a, acc_a), (b, J_b, acc_b) = self._moves(*one), self._moves(*other)
            if row["kind"] == KIND.point:
                u = row["along"]
                found.append((u @ (a - b), u @ (J_a - J_b), u @ (acc_a - acc_b)))
                continue
            far, v = np.linalg.norm(a - b), (J_a - J_b) @ qd
            u = (a - b) / far
            found.append((far - row["length"], u @ (J_a - J_b), u @ (acc_a - acc_b) + (v @ v - (u @ v) ** 2) / far))
        g, J, moved = zip(*found, strict=True)
        return np.array(g), np.array(J), np.array(moved)

    def run(self, q: np.ndarray, qd: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Angles (samples, n) at the times t from a state at t[0], without a drive."""
        chain, n, order = self.chain, self.chain.n, np.array(self.order)

        def rates(_t: float, y: np.ndarray) -> np.ndarray:
            q, qd = y[:n], y[n:]
            M = pin.crba(self.model, self.data, q)
            M = np.triu(M) + np.triu(M, 1).T
            M[order, order] += chain.hinges["armature"]
            f = -pin.nonLinearEffects(self.model, self.data, q, qd)
            f[order] -= chain.stiffness * (q[order] - chain.rest) + chain.damping * qd[order]
            _, J, moved = self.ties(q, qd)
            free, Y = np.linalg.solve(M, f), np.linalg.solve(M, J.T)
            λ = np.linalg.lstsq(J @ Y, J @ free + moved, rcond=1e-10)[0]
            return np.concatenate([qd, free - Y @ λ])

        start = np.zeros(2 * n)
        start[order], start[n + order] = q, qd
        solved = solve_ivp(rates, (t[0], t[-1]), start, method="DOP853", rtol=1e-10, atol=1e-12, t_eval=t)
        assert solved.success, solved.message
        return solved.y[:n].T[:, order]
