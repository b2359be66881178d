"""Springs, walls and ropes of another make: Pinocchio's dynamics, integrated by SciPy from corner to corner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.kernels.stepping.tie_rows import KIND
from tests.support.loops import Loop, TooHardError, Torque, undriven

FREE, SPRING, HIGH, LOW, HELD = range(5)
ENDS = {HIGH: "high", LOW: "low"}


class Touching(Loop):
    """A chain whose points are held or on springs, some of which have a free range: M q̈ + h + Jᵀ λ = τ.

    `moves` gives times and lengths of the rows whose length moves.
    """

    def __init__(self, chain: fl.Chain, ties: tuple, moves: dict | None = None, **more: object) -> None:
        super().__init__(chain, ties[0], **more)
        self.moves = moves or {}
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
            if row["kind"] == KIND.joint:
                k = self.order[row["a"]]
                found.append((q[k], np.eye(n)[k]))
                continue
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
        depth = side * (g[k] - row[ENDS[law]])
        return float(row["stiffness"] * depth * (1 + row["dissipation"] * side * v[k] * (depth > 0)))

    def leaves(self, k: int, law: int, end: int, g: np.ndarray, v: np.ndarray) -> float:
        """How far a spring is beyond its law at one end of its range."""
        if law == FREE:
            return self.pressed(k, end, g, v)
        return -self.pressed(k, law, g, v) if law == end else -1.0

    def law(self, k: int, g: np.ndarray, v: np.ndarray) -> int:
        row = self.rows[k]
        if np.isinf(row["stiffness"]):
            return HELD
        if row["low"] == row["high"]:
            return SPRING
        return next((end for end in (HIGH, LOW) if self.pressed(k, end, g + 1e-12 * v, v) > 0), FREE)

    def length(self, k: int, t: float) -> tuple[float, float]:
        """Length of a row that moves, and its rate; from rest to rest by s = 10 x³ − 15 x⁴ + 6 x⁵."""
        times, lengths = self.moves[k]
        if t >= times[-1]:
            return lengths[-1], 0.0
        i = int(np.searchsorted(times, t, side="right")) - 1
        long, far = times[i + 1] - times[i], lengths[i + 1] - lengths[i]
        x = (t - times[i]) / long
        return lengths[i] + far * x**3 * (10 - 15 * x + 6 * x**2), far / long * 30 * x**2 * (1 - x) ** 2

    def state(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """g, J and ġ of all rows."""
        n = self.chain.n
        g, J = self.springs(y[:n], y[n:])
        v = J @ y[n:]
        for k in self.moves:
            l, rate = self.length(k, t)
            g[k], v[k] = g[k] - l, v[k] - rate
        return g, J, v

    def run(
        self, q: np.ndarray, qd: np.ndarray, t: np.ndarray, torque: Torque = undriven, held: np.ndarray | None = None,
        method: str = "DOP853",
    ) -> tuple[np.ndarray, int]:  # fmt: skip
        """Angles (samples, n) at the times t from a state at t[0], and the number of pieces.

        A torque is constant from each time `held` on.
        """
        n, order, r, count = self.chain.n, self.order, range(len(self.rows)), 0
        exact = [k for k in r if np.isinf(self.rows[k]["stiffness"])]

        def rates(now: float, y: np.ndarray, laws: list[int], τ: np.ndarray | None) -> np.ndarray:
            nonlocal count
            count += 1
            if count > self.most:
                raise TooHardError
            at, v = y[:n], y[n:]
            M, f = self.open(at, v, torque(now, at[order], v[order]) if τ is None else τ)
            if len(self.force):
                f += self._moves(*self.tip)[1].T @ self.force
            g, J, ġ = self.state(now, y)
            for k, law in enumerate(laws):
                if law == SPRING:
                    f -= J[k] * (self.rows[k]["stiffness"] * g[k] + self.rows[k]["damping"] * ġ[k])
                elif law and law != HELD:
                    f -= J[k] * self.pressed(k, law, g, ġ) * (1 if law == HIGH else -1)
            free = np.linalg.solve(M, np.column_stack([f, J[exact].T]))
            if not exact:
                return np.concatenate([v, free[:, 0]])
            _, J, bent = self.ties(at, v)
            Y, a, J = free[:, 1:], free[:, 0], J[exact]
            return np.concatenate([v, a - Y @ np.linalg.lstsq(J @ Y, J @ a + bent[exact], rcond=1e-10)[0]])

        def event(k: int, end: int) -> Callable[..., float]:
            """Of one row and end: one that is just beyond its law would hide the others in a maximum over all."""

            def leaves(now: float, y: np.ndarray, laws: list[int], _τ: np.ndarray | None) -> float:
                g, _, v = self.state(now, y)
                return self.leaves(k, laws[k], end, g, v)

            leaves.terminal, leaves.direction = True, 1
            return leaves

        ranges = [k for k in r if self.rows[k]["low"] < self.rows[k]["high"]]
        ends = [event(k, end) for k in ranges for end in (HIGH, LOW) if np.isfinite(self.rows[k][ENDS[end]])]
        y, time, angles, pieces = np.zeros(2 * n), t[0], np.full((len(t), n), np.nan), 0
        y[order], y[n + order], τ = q, qd, None
        moving = [at for times, _ in self.moves.values() for at in times]
        instants = np.unique(np.concatenate([t[-1:], moving, [] if held is None else held]).round(12))
        for stop in instants[(instants > t[0]) & (instants <= t[-1])]:
            if held is not None and (τ is None or np.isclose(held, time, rtol=0.0, atol=1e-11).any()):
                τ = torque(time, y[:n][order], y[n:][order])
            while time < stop:
                g, _, v = self.state(time, y)
                laws = [self.law(k, g, v) for k in r]
                found = solve_ivp(
                    rates, (time, stop), y, method, args=(laws, τ), events=ends, rtol=1e-9, atol=1e-11,
                    dense_output=True, max_step=0.02,
                )  # fmt: skip
                assert found.success, found.message
                there = (t >= time) & (t <= found.t[-1])
                if there.any():
                    angles[there] = found.sol(t[there])[:n][order].T
                time, y, pieces = found.t[-1], found.y[:, -1], pieces + 1
        return angles, pieces
