"""Springs, walls and ropes of another make: Pinocchio's dynamics, integrated by SciPy from corner to corner."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.kernels.stepping.tie_rows import KIND
from tests.support.loops import Loop

FREE, SPRING, HIGH, LOW = range(4)


class Touching(Loop):
    """A chain whose points are on springs, some of which have a free range: M q̈ + h + Jᵀ λ = τ."""

    def __init__(self, chain: fl.Chain, ties: tuple) -> None:
        super().__init__(chain, ties[0])
        pose = fl.frames(chain, np.zeros(chain.n))
        pin.forwardKinematics(self.model, self.data, pin.neutral(self.model))
        self.turned = [  # of the bodies b at zero, against the axes of their joints
            pose.rotations[row["b"]].T @ self.data.oMi[end[1][0]].rotation if row["b"] >= 0 else np.eye(3)
            for row, end in zip(self.rows, self.ends, strict=True)
        ]

    def springs(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """g and J."""
        model, data, n = self.model, self.data, self.chain.n
        pin.forwardKinematics(model, data, q, qd, np.zeros(n))
        pin.computeJointJacobians(model, data, q)
        found = []
        for row, (one, other), turned in zip(self.rows, self.ends, self.turned, strict=True):
            (a, J_a, _), (b, J_b, _) = self._moves(*one), self._moves(*other)
            if row["kind"] == KIND.distance:
                far = np.linalg.norm(a - b)
                found.append((far - row["length"], (a - b) / far @ (J_a - J_b)))
                continue
            u, J_ω = row["along"], np.zeros((3, n))
            if other[0]:
                u = data.oMi[other[0]].rotation @ turned.T @ u
                J_ω = pin.getJointJacobian(model, data, other[0], pin.LOCAL_WORLD_ALIGNED)[3:]
            found.append((u @ (a - b), u @ (J_a - J_b) + np.cross(u, a - b) @ J_ω))
        g, J = zip(*found, strict=True)
        return np.array(g), np.array(J)

    def pressed(self, k: int, law: int, g: np.ndarray, v: np.ndarray) -> float:
        """λ at one end of the range of a spring, positive where it presses."""
        row, side = self.rows[k], 1 if law == HIGH else -1
        depth = side * (g[k] - row["high" if law == HIGH else "low"])
        return float(row["stiffness"] * depth * (1 + row["dissipation"] * side * v[k] * (depth > 0)))

    def leaves(self, k: int, law: int, g: np.ndarray, v: np.ndarray) -> float:
        """How far a spring is beyond its law."""
        if law in (HIGH, LOW):
            return -self.pressed(k, law, g, v)
        return max(self.pressed(k, end, g, v) for end in (HIGH, LOW)) if law == FREE else -1.0

    def law(self, k: int, g: np.ndarray, v: np.ndarray) -> int:
        row = self.rows[k]
        if row["low"] == row["high"]:
            return SPRING
        return next((end for end in (HIGH, LOW) if self.pressed(k, end, g + 1e-12 * v, v) > 0), FREE)

    def run(self, q: np.ndarray, qd: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, int]:
        """Angles (samples, n) at the times t from a state at t[0], without a drive, and the number of pieces."""
        n, order, r = self.chain.n, self.order, range(len(self.rows))

        def rates(_t: float, y: np.ndarray, laws: list[int]) -> np.ndarray:
            q, qd = y[:n], y[n:]
            M, f = self.open(q, qd)
            g, J = self.springs(q, qd)
            for k, law in enumerate(laws):
                if law == SPRING:
                    f -= J[k] * (self.rows[k]["stiffness"] * g[k] + self.rows[k]["damping"] * (J[k] @ qd))
                elif law:
                    f -= J[k] * self.pressed(k, law, g, J @ qd) * (1 if law == HIGH else -1)
            return np.concatenate([qd, np.linalg.solve(M, f)])

        y, time, angles, pieces = np.zeros(2 * n), t[0], np.full((len(t), n), np.nan), 0
        y[order], y[n + order] = q, qd
        while np.isnan(angles[-1]).any():
            g, J = self.springs(y[:n], y[n:])
            laws = [self.law(k, g, J @ y[n:]) for k in r]

            def ends(_t: float, y: np.ndarray, laws: list[int]) -> float:
                g, J = self.springs(y[:n], y[n:])
                return max(self.leaves(k, laws[k], g, J @ y[n:]) for k in r)

            ends.terminal, ends.direction = True, 1
            found = solve_ivp(
                rates, (time, t[-1]), y, "DOP853", args=(laws,), events=ends, rtol=1e-9, atol=1e-11, dense_output=True,
                max_step=0.05,
            )  # fmt: skip
            assert found.success, found.message
            there = (t >= time) & (t <= found.t[-1])
            if there.any():
                angles[there] = found.sol(t[there])[:n][order].T
            time, y, pieces = found.t[-1], found.y[:, -1], pieces + 1
        return angles, pieces
