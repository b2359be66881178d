"""A scene as y' = f(t, y), with y = (q, q̇) of the joints that move freely, for solvers independent of flexlink.

Only `lump`, `initial_state` and the public `forward_dynamics` of flexlink are used. Drives and motions are evaluated
independently, by SciPy's splines and Hermite polynomials. A prescribed joint p is free in this chain; a torque x_p
produces its prescribed acceleration. q̈ is affine in the torques, so with columns c_p = q̈(τ + e_p) − q̈(τ)

    (c_p)_p x = q̈_p − q̈(τ)_p,        q̈ = q̈(τ) + Σ c_p x_p.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, CubicSpline

import flexlink as fl
from flexlink.common.errors import ArgumentError, FlexlinkError, MissingDependencyError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.initial_state import initial_state
from validation.trade.work_precision import Run

OfTime = Callable[[float], Array]
OfState = Callable[[float, Array], Array]
ABSOLUTE_OF_RELATIVE = 1e-2  # absolute tolerance [rad, rad/s] of a solver divided by its relative tolerance


class Solved(NamedTuple):
    """Angles (samples, n) [rad] and tip (samples, 3) [m] at the samples; evaluations of f, including Jacobians."""

    q: Array
    tip: Array
    evaluations: int


class FirstOrder:
    """The right-hand side of a scene, and its runs by independent solvers.

    Attributes
    ----------
    evaluations
        Number of evaluations of f so far.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.chain = fl.lump(msgspec.structs.replace(scene, motion=()))
        self.led = [self.chain.index(scene.arm.number(motion.link), 0, 0) for motion in scene.motion]
        self.free = np.setdiff1d(np.arange(self.chain.n), self.led)
        self.motions = [_hermite(motion) for motion in scene.motion]
        self.joints = np.setdiff1d(self.chain.active, self.led)
        links = [self.chain.coordinate(int(k)).link - 1 for k in self.joints]
        self.torque, self.kp, self.kd, self.target = _drive(scene, links)
        self.wrench = scene.tip_wrench
        self.evaluations = 0

    @property
    def start(self) -> Array:
        """y at t = 0."""
        q, qd = initial_state(self.scene, self.chain)
        return np.concatenate([q[self.free], qd[self.free]])

    def __call__(self, t: float, y: Array) -> Array:
        """f(t, y), shape (2 f,), or for many states in rows, (b, 2 f)."""
        self.evaluations += y.size // len(self.free) // 2
        q, qd, wanted = self._states(t, y)
        tau = np.zeros_like(q)
        held = self.kp * (self.target - q[..., self.joints]) - self.kd * qd[..., self.joints]
        tau[..., self.joints] = self.torque(t) + held
        qdd = self._accelerations(q, qd, tau)
        if self.led:
            unit = np.eye(self.chain.n)
            c = np.stack([self._accelerations(q, qd, tau + unit[p]) - qdd for p in self.led], axis=-1)
            x = np.linalg.solve(c[..., self.led, :], (wanted - qdd[..., self.led])[..., None])
            qdd = qdd + (c @ x)[..., 0]
        return np.concatenate([y[..., len(self.free) :], qdd[..., self.free]], axis=-1)

    def _accelerations(self, q: Array, qd: Array, tau: Array) -> Array:
        return fl.forward_dynamics(self.chain, q, qd, tau, tip_wrench=self.wrench)

    def jacobian(self, t: float, y: Array) -> Array:
        """∂f/∂y by forward differences with step √eps times the size of each unknown, at least 1."""
        steps = np.sqrt(np.finfo(float).eps) * np.maximum(1.0, np.abs(y))
        values = self(t, np.vstack([y, y + np.diag(steps)]))
        return np.asarray((values[1:] - values[0]).T / steps)

    def _states(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        """q and q̇ of all joints, q̈ of the prescribed ones."""
        q, qd = np.zeros((2, *y.shape[:-1], self.chain.n))
        q[..., self.free], qd[..., self.free] = y[..., : len(self.free)], y[..., len(self.free) :]
        led = [motion(t) for motion in self.motions]
        for p, (angle, rate, _) in zip(self.led, led, strict=True):
            q[..., p], qd[..., p] = angle, rate
        return q, qd, np.array([acceleration for _, _, acceleration in led])

    def by(self, solver: str, relative: float) -> Solved:
        """Run with SUNDIALS' "CVODE" or a SciPy method; raises the same errors as `by_cvode` and `by_scipy`."""
        return self.by_cvode(relative) if solver == "CVODE" else self.by_scipy(solver, relative)

    def compiled(self) -> FirstOrder:
        """Itself, after calls that compile its functions."""
        for y in (self.start, np.vstack([self.start, self.start])):
            self(0.0, y)
        return self

    def run(self, solver: str, relative: float) -> Run:
        """Run with a relative tolerance as a contestant; its CPU time includes the interpreter."""
        begun = time.thread_time()
        solved = self.by(solver, relative)
        return Run(solved.q, time.thread_time() - begun, solved.evaluations)

    def by_scipy(self, method: str, relative: float) -> Solved:
        """Run with `scipy.integrate.solve_ivp`, restarted at knots of drive and motions, where f is not smooth.

        Raises
        ------
        FlexlinkError
            The solver gives up.
        """
        takes: dict[str, Any] = {"jac": self.jacobian} if method in {"Radau", "BDF", "LSODA"} else {}
        absolute = ABSOLUTE_OF_RELATIVE * relative

        def solve(t: float, y: Array, ends: Array) -> Array:
            found = solve_ivp(self, (t, ends[-1]), y, method, t_eval=ends, rtol=relative, atol=absolute, **takes)
            if not found.success:
                raise FlexlinkError(f"{self.scene.name}: SciPy's {method} gives up: {found.message}")
            return np.asarray(found.y.T)

        return self._pieces(solve)

    def by_cvode(self, relative: float) -> Solved:
        """Run with the stiff method of SUNDIALS' CVODE, through scikit-sundae.

        Raises
        ------
        MissingDependencyError
            scikit-sundae is not installed.
        FlexlinkError
            The solver gives up.
        """
        try:
            from sksundae.cvode import CVODE  # noqa: PLC0415  an optional solver
        except ImportError:
            raise MissingDependencyError(
                "CVODE needs scikit-sundae; install it with: python -m pip install scikit-sundae"
            ) from None

        def right(t: float, y: Array, out: Array) -> None:
            out[:] = self(t, y)

        def jacobian(t: float, y: Array, _: Array, out: Array) -> None:
            out[:] = self.jacobian(t, y)

        solver = CVODE(
            right, method="BDF", rtol=relative, atol=ABSOLUTE_OF_RELATIVE * relative, linsolver="dense",
            jacfn=jacobian, max_num_steps=10**7,
        )  # fmt: skip

        def solve(t: float, y: Array, ends: Array) -> Array:
            found = solver.solve(np.append(t, ends), y)
            if not found.success:
                raise FlexlinkError(f"{self.scene.name}: CVODE gives up: {found.message}")
            return np.asarray(found.y[1:])

        return self._pieces(solve)

    def by_rk4(self, steps: int) -> Solved:
        """Run RK4 with `steps` steps between two samples, as flexlink does; nan if the run diverges."""
        y, h = self.start, self.scene.run.spacing / steps
        rows, before = [y], self.evaluations
        with np.errstate(all="ignore"):
            for sample in range(1, self.scene.run.samples):
                for step in range((sample - 1) * steps, sample * steps if np.isfinite(y).all() else 0):
                    y = _rk4(self, step * h, y, h)
                rows.append(y)
        q = np.array([self._states(t, row)[0] for t, row in zip(self.scene.run.times, rows, strict=True)])
        good = np.isfinite(q).all(axis=1)
        tip = np.full((len(q), 3), np.nan)
        tip[good] = fl.tip_position(self.chain, q[good])
        return Solved(q, tip, self.evaluations - before)

    def _pieces(self, solve: Callable[[float, Array, Array], Array]) -> Solved:
        """Integrate over the samples, restarting at each knot; `solve` returns y at times that end at the next knot."""
        before, y, t = self.evaluations, self.start, 0.0
        times = self.scene.run.times
        knots = [*self._knots(), times[-1]]
        rows = [y]
        for end in knots:
            within = times[(times > t) & (times <= end)]
            ends = np.union1d(within, end)
            found = solve(t, y, ends)
            rows += list(found[: len(within)])
            t, y = end, found[-1]
        q = np.array([self._states(at, row)[0] for at, row in zip(times, rows, strict=True)])
        return Solved(q, fl.tip_position(self.chain, q), self.evaluations - before)

    def _knots(self) -> list[float]:
        """Times in the run at which f is not smooth: knots of motions and linear tables, ends of smooth tables."""
        drive, run = self.scene.drive, self.scene.run
        inside: set[float] = set()
        if drive.times is not None:
            inside |= {drive.times[0], drive.times[-1]} if drive.smooth else set(drive.times)
        inside = inside.union(*(motion.times for motion in self.scene.motion))
        near = {t: float(run.times[np.abs(run.times - t).argmin()]) for t in inside}
        close = 1e-9 * run.spacing  # tolerance to match samples: decimal input is rounded
        return sorted({s if abs(s - t) < close else t for t, s in near.items() if close < t < run.times[-1] - close})


def _hermite(motion: fl.PrescribedMotion) -> OfTime:
    """Angle, rate and acceleration [rad, s] of a prescribed joint: quintic pieces, then motion at the last rate."""
    table = np.radians(motion.columns).T
    end, (angle, rate, _) = motion.times[-1], table[-1]
    pieces = BPoly.from_derivatives(motion.times, table) if len(motion.times) > 1 else None
    slopes = [] if pieces is None else [pieces, pieces.derivative(1), pieces.derivative(2)]

    def at(t: float) -> Array:
        if t >= end:
            return np.array([angle + rate * (t - end), rate, 0.0])
        return np.array([float(slope(t)) for slope in slopes])

    return at


def _drive(scene: Scene, links: list[int]) -> tuple[OfTime, Array, Array, Array]:
    """Torque at the driven joints as a function of time; gains and targets, each (d,)."""
    drive, nothing = scene.drive, np.zeros(len(links))
    if drive.gravity != "none" or drive.reference is not None:
        raise ArgumentError(f"{scene.name}: a drive with gravity or a reference is not described here; use target_deg")
    of_links = [np.array(each)[links] if each else nothing for each in (drive.kp, drive.kd, drive.target_deg)]
    kp, kd, target = of_links[0], of_links[1], np.radians(of_links[2])
    if drive.kind != "table":
        constant = np.array(drive.torque)[links] if drive.torque else nothing
        return lambda _: constant, kp, kd, target
    times, torques = np.array(drive.times), np.array(drive.torques)[:, links]
    spline = CubicSpline(times, torques) if drive.smooth else None

    def torque(t: float) -> Array:
        t = min(max(t, times[0]), times[-1])
        if spline is not None:
            return np.asarray(spline(t))
        return np.array([np.interp(t, times, column) for column in torques.T])

    return torque, kp, kd, target


def _rk4(f: OfState, t: float, y: Array, h: float) -> Array:
    """y at t + h, by one step of RK4."""
    k1 = f(t, y)
    k2 = f(t + h / 2, y + h / 2 * k1)
    k3 = f(t + h / 2, y + h / 2 * k2)
    k4 = f(t + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
