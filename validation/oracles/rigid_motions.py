"""Motions of rigid bodies by formulas and SciPy: step response, saturated motor, tumbling satellite."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


class Servo(NamedTuple):
    """I θ̈ = kp (θ_d − θ) − kd θ̇ from rest at 0, underdamped."""

    inertia: float
    kp: float
    kd: float
    target: float

    @property
    def _σω(self) -> tuple[float, float]:
        σ = self.kd / (2 * self.inertia)
        return σ, math.sqrt(self.kp / self.inertia - σ**2)

    def angle(self, t: float) -> float:
        """θ(t)."""
        σ, ω = self._σω
        return self.target * (1 - math.exp(-σ * t) * (math.cos(ω * t) + σ / ω * math.sin(ω * t)))

    @property
    def peak(self) -> float:
        """The largest angle, which is reached after half a period."""
        σ, ω = self._σω
        return self.target * (1 + math.exp(-σ * math.pi / ω))

    def settled(self, within: float) -> float:
        """Last time at which the angle differs from its target by `within`."""
        _, ω = self._σω
        half, k = math.pi / ω, 0
        while abs(self.angle((k + 1) * half) - self.target) > within:
            k += 1

        def off(t: float) -> float:
            return abs(self.angle(t) - self.target) - within

        return float(brentq(off, k * half, self._crossing(k), xtol=1e-13))

    def _crossing(self, k: int) -> float:
        """Time at which the angle crosses its target after its k-th extremum."""
        _, ω = self._σω
        return float(brentq(lambda t: self.angle(t) - self.target, k * math.pi / ω, (k + 1) * math.pi / ω))


class Motor(NamedTuple):
    """A rotor and a link, coupled by a spring and damper; a PD controller with limited torque holds the rotor at 0."""

    rotor: float
    link: float
    stiffness: float
    damping: float
    kp: float
    kd: float
    effort: float

    def link_angles(self, start: float, times: np.ndarray) -> np.ndarray:
        """The link's angle, starting from rest; torque switches are events, between which the equation is smooth."""
        y, t, found = np.array([start, start, 0.0, 0.0]), 0.0, np.full(len(times), start)
        while t < times[-1] - 1e-14:
            branch = self._branch(y)
            run = solve_ivp(self._slope, (t, times[-1]), y, "DOP853", args=(branch,), rtol=1e-13, atol=1e-14,
                            events=self._switches(), dense_output=True, first_step=1e-7)  # fmt: skip
            here = (times > t) & (times <= run.t[-1] + 1e-15)
            found[here] = run.sol(times[here])[1]
            t, y = run.t[-1], run.y[:, -1]
            if run.status == 0:
                break
            after = self._branch(y, branch)
            off = solve_ivp(self._slope, (t, min(times[-1], t + 1e-10)), y, args=(after,), rtol=1e-13, atol=1e-15)
            t, y = off.t[-1], off.y[:, -1]
        return found

    def _wanted(self, y: np.ndarray) -> float:
        return float(-self.kp * y[0] - self.kd * y[2])

    def _branch(self, y: np.ndarray, left: int | None = None) -> int:
        """−1, 0 or 1: the torque is below, within or above its limits; at a switch, the branch after leaving `left`."""
        if left is not None:
            return int(np.sign(self._wanted(y))) if left == 0 else 0
        return int(np.sign(self._wanted(y))) if abs(self._wanted(y)) > self.effort else 0

    def _slope(self, _: float, y: np.ndarray, branch: int) -> list[float]:
        held = self.stiffness * (y[0] - y[1]) + self.damping * (y[2] - y[3])
        torque = branch * self.effort if branch else self._wanted(y)
        return [y[2], y[3], (torque - held) / self.rotor, held / self.link]

    def _switches(self) -> list[object]:
        def at(limit: float) -> object:
            def event(_: float, y: np.ndarray, __: int) -> float:
                return self._wanted(y) - limit

            event.terminal = True  # type: ignore[attr-defined]
            return event

        return [at(self.effort), at(-self.effort)]


class Body(NamedTuple):
    """A rigid body: its mass, its centre of mass, and its inertia about this centre, in body axes."""

    mass: float
    center: np.ndarray
    inertia: np.ndarray

    def with_another(self, other: Body) -> Body:
        """Both bodies, rigidly joined."""
        mass = self.mass + other.mass
        center = (self.mass * self.center + other.mass * other.center) / mass
        parts = [one.inertia + one.mass * _moment(one.center - center) for one in (self, other)]
        return Body(mass, center, parts[0] + parts[1])

    def tumbling(self, attitude: np.ndarray, spin: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torque-free motion by Euler's equations: quaternions w, x, y, z and angular velocities in body axes."""
        inverse = np.linalg.inv(self.inertia)

        def slope(_: float, y: np.ndarray) -> np.ndarray:
            (w, *v), ω = y[:4], y[4:]
            turn = 0.5 * np.concatenate([[-np.dot(v, ω)], w * ω + np.cross(v, ω)])
            return np.concatenate([turn, -inverse @ np.cross(ω, self.inertia @ ω)])

        start = np.concatenate([attitude / np.linalg.norm(attitude), spin])
        run = solve_ivp(slope, (times[0], times[-1]), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-14)
        return run.y[:4].T, run.y[4:].T


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion of any norm."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * K + 2 * K @ K)


def _moment(r: np.ndarray) -> np.ndarray:
    """Inertia of a unit point mass at r, about the origin."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
