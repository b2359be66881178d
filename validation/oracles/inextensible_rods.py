"""Inextensible rods in a plane, one after the other on free joints, by Galerkin's method, with NumPy and SciPy only.

The angle of each rod to the x axis is a sum of Legendre polynomials, θ(s) = Σ a_k P_k. Points follow by integration,
r(s) = r_0 + ∫ (cos θ, sin θ) ds, and Lagrange's equations

    ∫ ρA (∂r/∂a)ᵀ (r̈ − g) ds + ∫ ρI P θ̈ ds + ∫ EI P' θ' ds + m (∂r_tip/∂a)ᵀ (r̈_tip − g) + J P(0) θ̈(0) = P(0) τ

are solved with all integrals by Gauss quadrature. Nothing is linearised. The error falls exponentially with the number
of polynomials. The first joint has the rotor J and the torque τ or a moved angle, the last tip the mass m.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

Floats = np.ndarray


class Rod(NamedTuple):
    """A uniform rod and the angle at which it starts, straight and at rest."""

    length: float
    mass: float  # ρA [kg/m]
    rotary: float  # ρI [kg m]
    bending: float  # EI [N m²]
    angle: float = 0.0


class Arm(NamedTuple):
    """Rods with their loads; `moved` is the angular acceleration of the first joint over time, instead of a torque."""

    rods: tuple[Rod, ...]
    gravity: tuple[float, float] = (0.0, 0.0)
    rotor: float = 0.0
    payload: float = 0.0
    torque: Callable[[float], float] | None = None
    moved: Callable[[float], float] | None = None


class Motion:
    """Equations of an arm with a number of polynomials per rod."""

    def __init__(self, arm: Arm, polynomials: int) -> None:
        self.arm, self.K, self.n = arm, polynomials, polynomials * len(arm.rods)
        x, weights = legendre.leggauss(2 * polynomials + 24)
        at_nodes = legendre.legvander(x, len(x) - 1)
        basis = np.linalg.inv(at_nodes)
        self.w = weights / 2
        self.into = np.array([legendre.legval(x, legendre.legint(c, lbnd=-1)) for c in basis.T]).T / 2
        self.P = legendre.legvander(x, polynomials - 1)
        slopes = [legendre.legval(x, legendre.legder(row)) for row in np.eye(polynomials)]
        self.D = 2 * np.array(slopes).T
        self.root = legendre.legvander(np.array([-1.0]), polynomials - 1)[0]

    def start(self) -> Floats:
        """Coordinates and rates of straight rods at rest."""
        a = np.zeros((len(self.arm.rods), self.K))
        a[:, 0] = [rod.angle for rod in self.arm.rods]
        return np.concatenate([a.ravel(), np.zeros(self.n)])

    def tip(self, y: Floats) -> Floats:
        """Position of the tip, shape (2,)."""
        angles = self._angles(y[: self.n])
        ends = [rod.length * (_along(θ) @ self.w) for rod, θ in zip(self.arm.rods, angles, strict=True)]
        return np.asarray(np.sum(ends, axis=0))

    def _angles(self, a: Floats) -> list[Floats]:
        return [self.P @ part for part in a.reshape(-1, self.K)]

    def rates(self, t: float, y: Floats) -> Floats:
        """Derivative of coordinates and rates."""
        a, rates = y[: self.n], y[self.n :]
        M, force = np.zeros((self.n, self.n)), np.zeros(self.n)
        J, centripetal = np.zeros((2, self.n)), np.zeros(2)  # of the start of each rod
        gravity = np.array(self.arm.gravity)
        for k, (rod, θ) in enumerate(zip(self.arm.rods, self._angles(a), strict=True)):
            own = slice(k * self.K, (k + 1) * self.K)
            along, across = _along(θ), np.array([-np.sin(θ), np.cos(θ)])
            turned = across[:, :, None] * self.P
            slopes = np.repeat(J[:, None, :], len(θ), axis=1)
            slopes[:, :, own] += rod.length * (self.into @ turned)
            pull = along * (self.P @ rates[own]) ** 2
            free = (gravity + rod.length * (self.into @ pull.T) - centripetal).T
            weights = np.tile(rod.mass * rod.length * self.w, 2)
            flat = slopes.reshape(-1, self.n)
            M += flat.T @ (weights[:, None] * flat)
            force += flat.T @ (weights * free.ravel())
            M[own, own] += rod.rotary * rod.length * (self.P.T * self.w) @ self.P
            force[own] -= rod.bending / rod.length * (self.D.T * self.w) @ (self.D @ a[own])
            J = J.copy()
            J[:, own] += rod.length * np.tensordot(turned, self.w, (1, 0))
            centripetal = centripetal - rod.length * (pull @ self.w)
        M += self.arm.payload * J.T @ J
        force += self.arm.payload * J.T @ (gravity - centripetal)
        M[: self.K, : self.K] += self.arm.rotor * np.outer(self.root, self.root)
        return np.concatenate([rates, self._accelerations(t, M, force)])

    def _accelerations(self, t: float, M: Floats, force: Floats) -> Floats:
        if self.arm.torque is not None:
            force[: self.K] += self.arm.torque(t) * self.root
        if self.arm.moved is None:
            return np.linalg.solve(M, force)
        row = np.concatenate([self.root, np.zeros(self.n - self.K), [0.0]])
        system = np.block([[M, row[:-1, None]], [row[None]]])
        return np.linalg.solve(system, np.append(force, self.arm.moved(t)))[:-1]


def _along(θ: Floats) -> Floats:
    return np.array([np.cos(θ), np.sin(θ)])


def tips(arm: Arm, times: Floats, polynomials: int, tolerance: float) -> Floats:
    """Tip at the given times, shape (samples, 2), by SciPy's DOP853 with this relative tolerance."""
    motion, span = Motion(arm, polynomials), (0.0, float(times[-1]))
    found = solve_ivp(motion.rates, span, motion.start(), "DOP853", times, rtol=tolerance, atol=tolerance / 10)
    return np.array([motion.tip(y) for y in found.y.T])
