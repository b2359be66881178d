"""A continuous beam on a rotating hub, by its exact modes and matrix exponentials, with NumPy and SciPy only.

The beam (Euler-Bernoulli, inextensible, with rotary inertia ρI) is clamped to the hub, or held by a root spring k, and
carries a tip mass m with inertia J. In the axes of the hub, which turn by θ, its deflection is w = Σ φ_i(s) q_i(t). The
φ_i are the modes of the clamped beam,

    EI φ'''' = ω² ρA φ     φ(0) = φ'(0) = 0     EI φ''(L) = ω² J φ'(L), EI φ'''(L) = −ω² m φ(L)

and, with a root spring, the rotation φ_0 = s of its root. Points also move by ½ ∫ w'² ds towards the hub. With I the
inertia of hub and beam, c_i = ∫ ρA s φ_i ds, and the parts of the tip and of the rotary inertia in all integrals,

    I θ̈ + cᵀq̈ = τ − d θ̇ + r_θ          M q̈ + c θ̈ + η K_EI q̇ + K q = r
    r_θ = −qᵀN q θ̈ − 2 θ̇ q̇ᵀN q + g_y (S − ½ qᵀH q) − g_x aᵀq          N = M_w − G
    r   = θ̇² N q + g_y a − g_x H q        G, H = ∫ (∫_s^L ρA (σ, 1) dσ) φ'φ'ᵀ ds        a, S = ∫ ρA (φ, s) ds

with gravity (g_x, g_y) in the axes of the hub, which turn, and M_w without rotary inertia. The left sides are
integrated exactly; r is interpolated linearly within steps, and follows from the last solution until it no longer
changes. Neglected are terms of the order w³, (w/L)² of the bending: 1e-3 for w = L/30. Without r, except for gravity on
the beam at rest, the equations are linear; motions of 5 to 10° then differ by 1e-5 to 2e-4 of their range.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import PPoly
from scipy.linalg import expm, null_space
from scipy.optimize import brentq

Floats = np.ndarray


class Beam(NamedTuple):
    """Properties in SI units, with gravity in the plane of motion; without a root spring the root is clamped."""

    length: float
    EI: float
    rho_a: float
    rho_i: float = 0.0
    loss_time: float = 0.0
    tip_mass: float = 0.0
    tip_inertia: float = 0.0
    hub: float = 0.0
    viscous: float = 0.0
    root: float = np.inf
    gravity: tuple[float, float] = (0.0, 0.0)


class Drive(NamedTuple):
    """Torque kp (target − θ) − kd θ̇ + torque(t), the last constant between `jumps`; or a prescribed angle θ(t)."""

    kp: float = 0.0
    kd: float = 0.0
    target: float = 0.0
    jumps: tuple[float, ...] = (0.0,)
    torques: tuple[float, ...] = (0.0,)
    angle: PPoly | None = None


class Modes(NamedTuple):
    """Clamped modes: frequencies [rad/s] and coefficients of cos βs, sin βs, exp(−βs), exp(−β(L − s)); and φ_0."""

    length: float
    β: Floats
    ω: Floats
    shapes: Floats
    turns: bool = False

    def at(self, s: Floats | float, order: int) -> Floats:
        """Derivatives of this order of all functions φ at positions s, shape (functions, positions)."""
        β, x = self.β[:, None], np.atleast_1d(s)[None, :]
        phase = β * x + order * np.pi / 2
        parts = (np.cos(phase), np.sin(phase), (-1) ** order * np.exp(-β * x), np.exp(β * (x - self.length)))
        φ = β**order * sum(self.shapes[:, k : k + 1] * part for k, part in enumerate(parts))
        turn = (x, np.ones_like(x))[order] if order < 2 else np.zeros_like(x)
        return np.vstack([turn, φ]) if self.turns else np.asarray(φ)


class Matrices(NamedTuple):
    """The integrals of the equations of motion."""

    I: float
    c: Floats
    M: Floats
    K: Floats
    D: Floats
    N: Floats
    H: Floats
    a: Floats
    S: float


class Motion(NamedTuple):
    """A solution at times t; rows are samples. θ, w and torque are those after a jump."""

    beam: Beam
    modes: Modes
    t: Floats
    θ: Floats
    θd: Floats
    θdd: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    torque: Floats

    def tip(self) -> Floats:
        """Position of the tip in frame 0, shape (samples, 2)."""
        return self.position(self.beam.length)

    def position(self, s: float) -> Floats:
        """Position of the point s in frame 0, shape (samples, 2)."""
        w, along = self.q @ self.modes.at(s, 0)[:, 0], s - self._shortening(s, self.q, self.q) / 2
        cos, sin = np.cos(self.θ), np.sin(self.θ)
        return np.column_stack([along * cos - w * sin, along * sin + w * cos])

    def gyroscope(self, s: float) -> Floats:
        """Angular velocity of the section at s."""
        return np.asarray(self.θd + self.qd @ self.modes.at(s, 1)[:, 0])

    def strain(self, s: float, y: float) -> Floats:
        """Strain at the fibre y of the section at s."""
        return np.asarray(-y * (self.q @ self.modes.at(s, 2)[:, 0]))

    def accelerometer(self, s: float) -> Floats:
        """Acceleration minus gravity along the normal of the section at s."""
        φ, slope = self.modes.at(s, 0)[:, 0], self.q @ self.modes.at(s, 1)[:, 0]
        w, wd, wdd = self.q @ φ, self.qd @ φ, self.qdd @ φ
        u, ud = self._shortening(s, self.q, self.q) / 2, self._shortening(s, self.q, self.qd)
        udd = self._shortening(s, self.q, self.qdd) + self._shortening(s, self.qd, self.qd)
        g = _turned(self.beam.gravity, self.θ)
        along = -udd - w * self.θdd - 2 * wd * self.θd - (s - u) * self.θd**2 - g[0]
        across = wdd + (s - u) * self.θdd - w * self.θd**2 - 2 * ud * self.θd - g[1]
        return np.asarray(np.cos(slope) * across - np.sin(slope) * along)

    def _shortening(self, s: float, p: Floats, q: Floats) -> Floats:
        """∫₀ˢ w'_p w'_q dσ for two sets of coordinates."""
        nodes, weights = quadrature(s)
        φ = self.modes.at(nodes, 1)
        return np.asarray(((p @ φ) * (q @ φ)) @ weights)


def modes(beam: Beam, count: int) -> Modes:
    """The first clamped modes, with ∫ ρA φ² ds = 1 without the tip's part, and the rotation of a root on a spring."""
    step, found, x = 0.02, list[float](), 0.02
    before = _determinant(beam, x)
    while len(found) < count:
        after = _determinant(beam, x + step)
        if before * after < 0:
            found.append(float(brentq(lambda y: _determinant(beam, y), x, x + step, xtol=1e-13, rtol=1e-14)))
        x, before = x + step, after
    β = np.array(found) / beam.length
    shapes = np.array([null_space(_boundary(beam, y), rcond=1e-9)[:, 0] for y in found])
    raw = Modes(beam.length, β, β**2 * np.sqrt(beam.EI / beam.rho_a), shapes)
    nodes, weights = quadrature(beam.length)
    size = np.sqrt(beam.rho_a * raw.at(nodes, 0) ** 2 @ weights)
    return raw._replace(shapes=shapes / size[:, None], turns=bool(np.isfinite(beam.root)))


def _boundary(beam: Beam, x: float) -> Floats:
    """Conditions at both ends for the four functions of a mode with βL = x, scaled to order 1."""
    L, m, J = beam.length, beam.tip_mass, beam.tip_inertia
    one = Modes(L, np.full(4, x / L), np.empty(4), np.eye(4))
    β, ends = x / L, np.array([0.0, L])
    d0, d1, d2, d3 = (one.at(ends, k) / β**k for k in range(4))
    moment, shear = J * β**3 / beam.rho_a, m * β / beam.rho_a
    end = ((d2[:, 1] - moment * d1[:, 1]) / (1 + moment), (d3[:, 1] + shear * d0[:, 1]) / (1 + shear))
    return np.array([d0[:, 0], d1[:, 0], *end])


def _determinant(beam: Beam, x: float) -> float:
    return float(np.linalg.det(_boundary(beam, x)))


def quadrature(length: float, panels: int = 40, points: int = 8) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss' rule on panels from 0 to a length."""
    x, w = leggauss(points)
    h = length / panels
    return (h * (np.arange(panels)[:, None] + (1 + x) / 2)).ravel(), np.tile(h / 2 * w, panels)


def matrices(beam: Beam, shapes: Modes) -> Matrices:
    """Integrals over beam, tip and hub."""
    L, m, J = beam.length, beam.tip_mass, beam.tip_inertia
    s, weights = quadrature(L)
    φ, slope, bend = (shapes.at(s, order) for order in range(3))
    end, turn = shapes.at(L, 0)[:, 0], shapes.at(L, 1)[:, 0]
    M_w = beam.rho_a * (φ * weights) @ φ.T + m * np.outer(end, end)
    rotary = beam.rho_i * (slope * weights) @ slope.T + J * np.outer(turn, turn)
    K = beam.EI * (bend * weights) @ bend.T
    D = beam.loss_time * K
    if shapes.turns:
        K = K + beam.root * np.outer(shapes.at(0.0, 1), shapes.at(0.0, 1))
    G = (slope * weights * (beam.rho_a * (L**2 - s**2) / 2 + m * L)) @ slope.T
    H = (slope * weights * (beam.rho_a * (L - s) + m)) @ slope.T
    c = beam.rho_a * (φ * weights) @ s + beam.rho_i * slope @ weights + m * L * end + J * turn
    a = beam.rho_a * φ @ weights + m * end
    total = beam.hub + beam.rho_a * L**3 / 3 + beam.rho_i * L + m * L**2 + J
    return Matrices(total, c, M_w + rotary, K, D, M_w - G, H, a, beam.rho_a * L**2 / 2 + m * L)


def _turned(gravity: tuple[float, float], θ: Floats | float) -> tuple[Floats, Floats]:
    """Gravity in the axes of the hub."""
    (x, y), cos, sin = gravity, np.cos(θ), np.sin(θ)
    return x * cos + y * sin, y * cos - x * sin


def simulate(beam: Beam, drive: Drive, t: Floats, *, count: int = 14, finer: int = 10, linear: bool = False) -> Motion:
    """Motion from rest at θ = 0 (or the prescribed angle), at equally spaced times t from 0.

    `finer` is the number of steps per sample; jumps of the torque and breaks of the angle must be at these steps. The
    beam starts in static equilibrium with the hub held. `linear` neglects all of r but gravity on the beam at rest.
    """
    shapes = modes(beam, count)
    parts = matrices(beam, shapes)
    times = np.linspace(t[0], t[-1], (len(t) - 1) * finer + 1)
    system = _Prescribed(beam, drive, parts, times) if drive.angle is not None else _Driven(beam, drive, parts, times)
    g = np.array(_turned(beam.gravity, system.start))
    rest = np.linalg.solve(parts.K + g[0] * parts.H, g[1] * parts.a)
    r, found = np.zeros((len(times), len(rest) + 1)), system.still(rest)
    for _ in range(40):
        before = found
        r = remainder(parts, beam.gravity, found)
        found = system.solved(rest, r)
        change = max(float(abs(new - old).max()) for new, old in zip(found[:4], before[:4], strict=True))
        if linear or change < 1e-11:
            break
    else:
        raise ArithmeticError(f"no convergence: last change {change:.2g}")
    every = [part[::finer] for part in (*found, system.torque(found, r))]
    return Motion(beam, shapes, times[::finer], *every)


State = tuple[Floats, Floats, Floats, Floats, Floats, Floats]
"""θ, θ̇, θ̈, q, q̇, q̈ at all steps."""


def remainder(parts: Matrices, gravity: tuple[float, float], state: State) -> Floats:
    """(r_θ, r) at all steps, shape (steps, 1 + modes)."""
    θ, θd, θdd, q, qd, _ = state
    along, across = _turned(gravity, θ)
    Nq, Hq = q @ parts.N, q @ parts.H
    hub = -(q * Nq).sum(1) * θdd - 2 * θd * (qd * Nq).sum(1)
    hub += across * (parts.S - (q * Hq).sum(1) / 2) - along * (q @ parts.a)
    beam = θd[:, None] ** 2 * Nq + across[:, None] * parts.a - along[:, None] * Hq
    return np.column_stack([hub, beam])


class _Driven:
    """The hub moves under a torque; generalized coordinates (θ, q)."""

    start = 0.0

    def __init__(self, beam: Beam, drive: Drive, parts: Matrices, times: Floats) -> None:
        n = len(parts.c) + 1
        self.M = np.block([[np.array([[parts.I]]), parts.c[None]], [parts.c[:, None], parts.M]])
        self.K, self.D = np.zeros((n, n)), np.zeros((n, n))
        self.K[1:, 1:], self.D[1:, 1:] = parts.K, parts.D
        self.K[0, 0], self.D[0, 0] = drive.kp, drive.kd + beam.viscous
        after = np.searchsorted(drive.jumps, times + 1e-9, side="right") - 1
        self.given, self.drive = np.asarray(drive.torques)[after], drive
        self.h = float(times[1] - times[0])
        self.step = Exponential(self.M, self.D, self.K, self.h, 1)

    def still(self, rest: Floats) -> State:
        q = np.tile(rest, (len(self.given), 1))
        zero = np.zeros(len(self.given))
        return zero, zero, zero, q, 0 * q, 0 * q

    def solved(self, rest: Floats, r: Floats) -> State:
        force = r.copy()
        force[:, 0] += self.drive.kp * self.drive.target
        slope = np.diff(force, axis=0, append=force[-1:]) / self.h
        force[:, 0] += self.given
        start = np.append(0.0, rest)
        y, yd = self.step.run(start, 0 * start, np.stack([force, slope], axis=1))
        ydd = np.linalg.solve(self.M, (force - y @ self.K - yd @ self.D).T).T
        return y[:, 0], yd[:, 0], ydd[:, 0], y[:, 1:], yd[:, 1:], ydd[:, 1:]

    def torque(self, found: State, r: Floats) -> Floats:
        return np.asarray(self.drive.kp * (self.drive.target - found[0]) - self.drive.kd * found[1] + self.given)


class _Prescribed:
    """The hub's angle is given as a piecewise polynomial, of degree 5 at most, with its breaks at steps."""

    def __init__(self, beam: Beam, drive: Drive, parts: Matrices, times: Floats) -> None:
        assert drive.angle is not None
        self.parts, self.viscous = parts, beam.viscous
        self.h = float(times[1] - times[0])
        self.θ = [drive.angle.derivative(k)(times + 1e-9 * self.h) if k else drive.angle(times) for k in range(6)]
        self.start = float(self.θ[0][0])
        self.step = Exponential(parts.M, parts.D, parts.K, self.h, 3)

    def still(self, rest: Floats) -> State:
        q = np.tile(rest, (len(self.θ[0]), 1))
        return self.θ[0], self.θ[1], self.θ[2], q, 0 * q, 0 * q

    def solved(self, rest: Floats, r: Floats) -> State:
        c, M = self.parts.c, self.parts.M
        forces = np.stack([-np.outer(part, c) for part in self.θ[2:]], axis=1)
        forces[:, 0] += r[:, 1:]
        forces[:, 1] += np.diff(r[:, 1:], axis=0, append=r[-1:, 1:]) / self.h
        q, qd = self.step.run(rest, 0 * rest, forces)
        qdd = np.linalg.solve(M, (forces[:, 0] - q @ self.parts.K - qd @ self.parts.D).T).T
        return self.θ[0], self.θ[1], self.θ[2], q, qd, qdd

    def torque(self, found: State, r: Floats) -> Floats:
        return np.asarray(self.parts.I * self.θ[2] + found[5] @ self.parts.c + self.viscous * self.θ[1] - r[:, 0])


class Exponential:
    """Exact steps of M ÿ + D ẏ + K y = f, with f a polynomial of this degree in each step."""

    def __init__(self, M: Floats, D: Floats, K: Floats, h: float, degree: int) -> None:
        n = len(M)
        A = np.zeros(((degree + 3) * n,) * 2)
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n] = np.hstack([np.linalg.solve(M, np.hstack([-K, -D, np.eye(n)])), np.zeros((n, degree * n))])
        for k in range(2, degree + 2):
            A[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
        self.n, self.E = n, expm(A * h)[: 2 * n]

    def run(self, y: Floats, yd: Floats, force: Floats) -> tuple[Floats, Floats]:
        """Coordinates and rates at all steps; `force` has f and its derivatives, shape (steps, degree + 1, n)."""
        state = np.empty((len(force), 2 * self.n))
        state[0] = np.concatenate([y, yd])
        own, given = self.E[:, : 2 * self.n].T.copy(), force.reshape(len(force), -1) @ self.E[:, 2 * self.n :].T
        for k in range(len(force) - 1):
            state[k + 1] = state[k] @ own + given[k]
        return state[:, : self.n], state[:, self.n :]
