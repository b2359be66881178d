"""Closed loops of another make: Pinocchio's dynamics with multipliers at acceleration level, integrated by SciPy."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.dynamics.ties import gaps, tie_rows
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.stepping.tie_rows import KIND, TIE

Torque = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""Torques (n,) of drives at t, q and q̇."""


def unaccelerated(chain: fl.Chain) -> np.ndarray:
    """Rows by which the motions of prescribed joints, which must have constant rates, become multipliers."""
    rows = np.zeros(np.count_nonzero(chain.held), TIE)
    rows["kind"], rows["a"], rows["b"] = KIND.joint, np.flatnonzero(chain.held), -1
    return rows


class TooHardError(Exception):
    """The integration would take too long."""


def undriven(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    return np.zeros(len(q))


def places(chain: fl.Chain, q: np.ndarray) -> np.ndarray:
    """Points of all bodies at angles (samples, n)."""
    return np.array([forward_kinematics(chain.arrays, each).points for each in np.ascontiguousarray(q)])


def placed(scene: fl.Scene, chain: fl.Chain, q: np.ndarray, link: str, **where: Any) -> np.ndarray:
    """Where a point of a link is in frame 0 [m]."""
    probe = {"name": "probe", "kind": "point", "link": link, "to": {"point": [0, 0, 0]}, **where}
    return gaps(tie_rows(scene.varied({"tie": [probe], "drive": {}}), chain), chain, q)[0]


def turned(scene: fl.Scene, chain: fl.Chain, q: np.ndarray, link: str) -> np.ndarray:
    """Axes of an unbent link in frame 0, in columns."""
    at = [placed(scene, chain, q, link, point=point) for point in (np.vstack([np.eye(3), np.zeros(3)]) / 8).tolist()]
    return 8 * (np.array(at[:3]) - at[3]).T


class Loop:
    """A chain, exported to URDF, whose points are tied: M q̈ + h + Jᵀ λ = τ, J q̈ + J̇ q̇ = 0.

    The points are where flexlink has them with all coordinates at zero; from there on, Pinocchio moves them. Hinges of
    links with strain modes move by q = q₀ + Φ z. Springs between hinges are flexlink's, which ties do not change.
    """

    def __init__(self, chain: fl.Chain, rows: np.ndarray, *, force: Sequence[float] = (), most: float = np.inf) -> None:
        """`force` (3,) in frame 0 acts on the tip; `most` evaluations of rates are allowed."""
        self.chain, self.rows, self.force, self.most = chain, rows, np.array(force), most
        self.bare = dataclasses.replace(chain, shapes=None, forces={})
        self.model = pin.buildModelFromXML(fl.to_urdf(self.bare, shapes=False))
        self.model.gravity.linear = np.asarray(chain.gravity)
        self.data = self.model.createData()
        self.order = np.array([self.model.joints[self.model.getJointId(name)].idx_v for name in chain.joint_names])
        self.Φ = np.eye(chain.n) if chain.shapes is None else chain.shapes.matrix
        pin.forwardKinematics(self.model, self.data, pin.neutral(self.model))
        self.ends = [
            (self._end(row["a"], row["point_a"]), self._end(row["b"], row["point_b"]))
            if row["kind"] != KIND.joint else ((0, np.zeros(3)),) * 2
            for row in rows
        ]  # fmt: skip
        self.tip = self._end(len(chain.bodies) - 1, np.zeros(3))

    def _end(self, body: int, point: np.ndarray) -> tuple[int, np.ndarray]:
        """Joint and point in its axes of a point of a body."""
        if body < 0:
            return 0, point
        pose = fl.frames(self.chain, np.zeros(self.chain.n))
        place = pose.points[body] + pose.rotations[body] @ point
        bodies = self.chain.bodies
        while body >= 0 and bodies["stop"][body] == bodies["first"][body]:
            body = bodies["parent"][body] - 1
        if body < 0:
            return 0, place
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
            a.linear + pin.skew(a.angular) @ arm + pin.skew(ω) @ (pin.skew(ω) @ arm),
        )

    def ties(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """g, J and J̇ q̇, in Pinocchio's order of the coordinates."""
        pin.forwardKinematics(self.model, self.data, q, qd, np.zeros(self.chain.n))
        pin.computeJointJacobians(self.model, self.data, q)
        found, known = [], {}
        for row, (one, other) in zip(self.rows, self.ends, strict=True):
            if row["kind"] == KIND.joint:
                k = self.order[row["a"]]
                J = np.eye(self.chain.n)[k]
                if row["b"] >= 0:
                    J[self.order[row["b"]]] = -row["ratio"]
                found.append((J @ q, J, 0.0))
                continue
            for end in (one, other):
                key = end[0], end[1].tobytes()
                if key not in known:
                    known[key] = self._moves(*end)
            (a, J_a, acc_a), (b, J_b, acc_b) = (known[end[0], end[1].tobytes()] for end in (one, other))
            if row["kind"] == KIND.point:
                u = row["along"]
                found.append((u @ (a - b), u @ (J_a - J_b), u @ (acc_a - acc_b)))
                continue
            far, v = np.linalg.norm(a - b), (J_a - J_b) @ qd
            u = (a - b) / far
            found.append((far - row["length"], u @ (J_a - J_b), u @ (acc_a - acc_b) + (v @ v - (u @ v) ** 2) / far))
        g, J, moved = zip(*found, strict=True)
        return np.array(g), np.array(J), np.array(moved)

    def open(self, at: np.ndarray, rate: np.ndarray, torque: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """M and τ − h without ties, in Pinocchio's order of the coordinates, in which positions and rates are."""
        order = self.order
        M = pin.crba(self.model, self.data, at)
        M = np.triu(M) + np.triu(M, 1).T
        M[order, order] += self.chain.hinges["armature"]
        f = -pin.nonLinearEffects(self.model, self.data, at, rate)
        f[order] += torque - self.resisting(at[order], rate[order])
        return M, f

    def accelerations(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """z̈ at q and q̇ (n,), under drive torques (n,)."""
        order = self.order
        at, rate = np.zeros((2, self.chain.n))
        at[order], rate[order] = q, qd
        M, f = self.open(at, rate, torque)
        _, J, moved = self.ties(at, rate)
        if len(self.force):
            f += self._moves(*self.tip)[1].T @ self.force
        Φ = np.empty_like(self.Φ)
        Φ[order] = self.Φ
        M, f, J = Φ.T @ M @ Φ, Φ.T @ f, J @ Φ
        both = np.linalg.solve(M, np.column_stack([f, J.T]))
        free, Y = both[:, 0], both[:, 1:]
        return free - Y @ np.linalg.lstsq(J @ Y, J @ free + moved, rcond=1e-10)[0]

    def resisting(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Torques (n,) of springs, dampers and friction."""
        chain, hinges, dampers = self.chain, self.chain.hinges, self.chain.force("dampers")
        if len(chain.couplings):
            found = fl.elastic_torque(self.bare, q) + fl.friction_torque(self.bare, qd)
        else:
            found = chain.stiffness * (q - chain.rest) + chain.damping * qd
            found = found + hinges["coulomb"] * np.tanh(qd / hinges["coulomb_width"])
        at = dampers["hinge"]
        found[at] += dampers["quadratic"] * np.abs(qd[at]) * qd[at]
        return found

    def fastest(self, q: np.ndarray) -> float:
        """Largest rate at which the arm without ties moves by itself, by vibration or by damping [1/s]."""
        hinges, Φ = self.chain.hinges, self.Φ
        M, K = (Φ.T @ each @ Φ for each in (fl.mass_matrix(self.bare, q), np.diag(self.chain.stiffness)))
        D = Φ.T @ np.diag(self.chain.damping + hinges["coulomb"] / hinges["coulomb_width"]) @ Φ
        zero, one = np.zeros_like(M), np.eye(len(M))
        A = np.block([[zero, one], [np.linalg.solve(M, -K), np.linalg.solve(M, -D)]])
        return float(np.abs(np.linalg.eigvals(A)).max())

    def run(
        self, q: np.ndarray, qd: np.ndarray, t: np.ndarray, torque: Torque = undriven, *,
        held: np.ndarray | None = None, method: str = "DOP853",
    ) -> np.ndarray:  # fmt: skip
        """Angles (samples, n) at the times t from a state at t[0]; a torque is constant from each time `held` on."""
        Φ, m, start = self.Φ, self.Φ.shape[1], q
        knots = np.unique(np.concatenate([t, t if held is None else held[held < t[-1]]]).round(12))
        y, found, count = np.concatenate([np.zeros(m), np.linalg.lstsq(Φ, qd)[0]]), [q], 0
        τ = np.zeros(len(q))

        def rates(now: float, y: np.ndarray) -> np.ndarray:
            nonlocal count
            count += 1
            if count > self.most or not np.isfinite(y).all():
                raise TooHardError
            q, qd = start + Φ @ y[:m], Φ @ y[m:]
            return np.concatenate([y[m:], self.accelerations(q, qd, torque(now, q, qd) if held is None else τ)])

        if held is None:
            pieces = [(t[0], t[-1], t)]
        else:
            pieces = [(a, b, np.array([a, b])) for a, b in itertools.pairwise(knots)]
        for begin, end, at in pieces:
            if held is not None and np.isclose(held, begin, rtol=0.0, atol=1e-11).any():
                τ = torque(begin, start + Φ @ y[:m], Φ @ y[m:])
            strict = 1e-10 if method == "DOP853" else 1e-8
            solved = solve_ivp(rates, (begin, end), y, method=method, rtol=strict, atol=1e-2 * strict, t_eval=at)
            if not solved.success:
                raise TooHardError(solved.message)
            y = solved.y[:, -1]
            wanted = np.isin(at[1:].round(12), t.round(12))
            found += list(start + solved.y[:m, 1:].T[wanted] @ Φ.T)
        return np.array(found)
