"""Reference solution of a scene by SciPy and independent formulas: input, laws, wrench, motion, kinematics, mass."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, CubicSpline, PPoly
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.common.types import Array

Signal = Callable[[float], Array]
SHAPERS = {"ZV": (1.0, 1.0), "ZVD": (1.0, 2.0, 1.0), "ZVDD": (1.0, 3.0, 3.0, 1.0), "EI": (0.2625, 0.475, 0.2625),
           "own_shaper.toml": (1.0, 1.0)}  # fmt: skip


class TooSlowError(Exception):
    """The reference solution is too expensive."""


def rows_in_time(times: Array, rows: Array, *, smooth: bool, hold: bool) -> Signal:
    """Interpolate a table in time; outside its times, its first or last row is used."""
    spline = CubicSpline(times, rows) if smooth and len(times) > 1 else None

    def at(t: float) -> Array:
        t = min(max(t, times[0]), times[-1])
        if spline is not None:
            return np.asarray(spline(t))
        if hold:
            return np.asarray(rows[max(0, int(np.searchsorted(times, t + 1e-12, side="right")) - 1)])
        return np.array([np.interp(t, times, column) for column in rows.T])

    return at


def own(slides: tuple[bool, ...], deg: Any, m: Any) -> Array:
    """Joint positions by link [rad] or [m], from a list in degrees and a list in metres."""
    count = len(slides)
    turned = np.radians(deg if deg is not None and len(deg) else np.zeros(count))
    return np.where(slides, m if m is not None else np.zeros(count), turned)


def fastest(distance: float, rate: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Durations of jerk, constant acceleration and constant speed of the fastest move."""
    t_j = min(
        acceleration / jerk if jerk < math.inf else 0.0, math.sqrt(rate / jerk), (distance / (2 * jerk)) ** (1 / 3)
    )
    top = acceleration if jerk == math.inf else jerk * t_j
    t_a = 0.0
    if math.isclose(top, acceleration):
        by_distance = (-3 * t_j + math.sqrt(t_j**2 + 4 * distance / top)) / 2
        t_a = max(0.0, min(rate / top - t_j if rate < math.inf else math.inf, by_distance))
    return t_j, t_a, max(0.0, distance / (top * (t_j + t_a)) - 2 * t_j - t_a)


def ramps(t_j: float, t_a: float, t_v: float) -> PPoly:
    """Move from 0 to 1 with phases of these durations, by integrating its acceleration."""
    lengths = np.array([t_j, t_a, t_j, t_v, t_j, t_a, t_j])
    ends = np.array([(0, 1), (1, 1), (1, 0), (0, 0), (0, -1), (-1, -1), (-1, 0)], float)
    there = lengths > 1e-12 * lengths.sum()
    lengths, ends = lengths[there], ends[there]
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    path = PPoly(np.stack([(ends[:, 1] - ends[:, 0]) / lengths, ends[:, 0]]), knots).antiderivative(2)
    path.c /= path(knots[-1])
    return path


def unit_move(reference: Any, profile: str, limits: list[float], distance: float) -> PPoly:
    """Move from 0 to 1 as fast as the limits allow, or within the duration."""
    quintic = PPoly(np.array([[6.0], [-15.0], [10.0], [0.0], [0.0], [0.0]]), np.array([0.0, 1.0]))
    if reference.duration is not None:
        thirds = {"trapezoidal": (0.0, 1 / 3, 1 / 3), "s_curve": (1 / 9, 1 / 9, 1 / 3)}
        return stretched(quintic if profile == "quintic" else ramps(*thirds[profile]), reference.duration)
    if profile == "quintic":
        parts = (15 / 8 / limits[0], math.sqrt(10 / math.sqrt(3) / limits[1]), (60 / limits[2]) ** (1 / 3))
        powers = (1.0, 0.5, 1 / 3)
        return stretched(quintic, max(part * distance**p for part, p in zip(parts, powers, strict=True)))
    return ramps(*fastest(distance, limits[0], limits[1], limits[2] if profile == "s_curve" else math.inf))


def stretched(path: PPoly, duration: float) -> PPoly:
    """Same path with another duration."""
    by = duration / path.x[-1]
    degree = len(path.c) - 1
    return PPoly(path.c / by ** np.arange(degree, -1, -1)[:, None], path.x * by)


class Course:
    """Reference of all joints in time: position, rate, acceleration, and the times at which it is not smooth."""

    def __init__(self, scene: fl.Scene) -> None:
        reference, slides = scene.drive.reference, scene.arm.slides
        assert reference is not None
        self.initial = own(slides, scene.initial.joint_deg, scene.initial.joint_m)
        self.shifts, self.weights = impulses(reference.shaper)
        self.breaks, self.paths = np.zeros(0), list[Callable[[float, int], Array]]()
        if reference.times is None:
            self.move(scene, reference, slides)
        else:
            self.table(reference, slides)
        self.breaks = np.unique(np.add.outer(self.shifts, self.breaks))

    def move(self, scene: fl.Scene, reference: Any, slides: tuple[bool, ...]) -> None:
        """Reference given as a move of every joint from rest to rest."""
        goal = own(slides, reference.to_deg, reference.to_m)
        first = np.where(slides, reference.from_m if reference.from_m else self.initial,
                         np.radians(reference.from_deg) if reference.from_deg else self.initial)  # fmt: skip
        units: dict[int, PPoly] = {}
        for k, slide in enumerate(slides):
            if goal[k] == first[k] or scene.arm.links[k].joint.locked:
                continue
            given = [
                getattr(reference, f"max_{key}_{'m' if slide else 'deg'}") for key in ("rate", "acceleration", "jerk")
            ]
            limits = [math.inf if row is None else (row[k] if slide else math.radians(row[k])) for row in given]
            units[k] = unit_move(reference, reference.profile, limits, abs(goal[k] - first[k]))
        last = max((unit.x[-1] for unit in units.values()), default=1.0)
        units = {k: stretched(unit, last) for k, unit in units.items()}
        self.breaks = np.unique(np.concatenate([reference.start + unit.x for unit in units.values()] or [np.zeros(0)]))

        def at(t: float, order: int) -> Array:
            inside = 0.0 <= t - reference.start <= last
            s = [float(u(np.clip(t - reference.start, 0.0, last), order)) if inside or not order else 0.0
                 for u in units.values()]  # fmt: skip
            found = np.array(first if not order else np.zeros(len(slides)), float)
            for (k, _), part in zip(units.items(), s, strict=True):
                found[k] += (goal[k] - first[k]) * part
            return found

        self.at = at

    def table(self, reference: Any, slides: tuple[bool, ...]) -> None:
        """Reference given as a table of positions at times."""
        t = self.breaks = np.array(reference.times)
        first, last = t[0], t[-1]
        names = (("angle_deg", "position_m"), ("rate_deg", "rate_m"), ("acceleration_deg", "acceleration_m"))
        known = []
        for deg, m in names:
            d, e = getattr(reference, deg), getattr(reference, m)
            if d is not None or e is not None:
                known.append(np.array([own(slides, d and d[k], e and e[k]) for k in range(len(t))]))
        if reference.profile == "hold":
            held = rows_in_time(t, known[0], smooth=False, hold=True)
            self.at = lambda t, order: held(t) if not order else np.zeros(len(slides))
            return
        if reference.profile == "linear":
            slopes = np.diff(known[0], axis=0) / np.diff(t)[:, None]
            path: Any = PPoly(np.stack([slopes, known[0][:-1]]), t)
        else:
            path = (
                CubicSpline(t, known[0], bc_type="clamped")
                if len(known) == 1
                else BPoly.from_derivatives(t, np.stack(known, 1))
            )

        def on_path(t: float, order: int) -> Array:
            if order and not first <= t < last:
                return np.zeros(len(slides))
            return np.asarray(path(np.clip(t, first, last), order))

        self.at = on_path

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """Position, rate and acceleration of the joints of all links."""
        found = [
            sum(w * self.at(t - s, order) for s, w in zip(self.shifts, self.weights, strict=True)) for order in range(3)
        ]
        return found[0], found[1], found[2]


def impulses(shaper: Any) -> tuple[Array, Array]:
    """Times and weights of a shaper's impulses; the impulses of all modes are convolved."""
    times, weights = np.zeros(1), np.ones(1)
    if shaper is None:
        return times, weights
    poles = [complex(*pole) for pole in shaper.poles or ()]
    for k, hertz in enumerate(shaper.frequency_hz or ()):
        w, z = 2 * math.pi * hertz, (shaper.damping or [0.0] * 9)[k]
        poles.append(complex(-z * w, w * math.sqrt(1 - z**2)))
    for pole in poles:
        own_weights = np.array(SHAPERS[shaper.kind.rpartition("/")[2]])
        h = np.arange(len(own_weights))
        a = own_weights * np.exp(pole.real * math.pi / pole.imag * h)
        times = np.add.outer(times, h * math.pi / pole.imag).ravel()
        weights = np.multiply.outer(weights, a / a.sum()).ravel()
    return times, weights


class Truth:
    """Equation of motion of a scene: M, T_GC etc. from flexlink, all inputs from independent formulas."""

    def __init__(self, scene: fl.Scene, chain: fl.Chain, most: int = 15_000) -> None:
        self.scene, self.chain, self.left = scene, chain, most
        self.slides, links = scene.arm.slides, scene.arm.links
        self.driven = [k for k, link in enumerate(links) if not link.joint.locked]
        self.a = chain.active
        drive, wrench = scene.drive, scene.wrench
        self.course = Course(scene) if drive.reference is not None else None
        self.breaks: list[float] = list(self.course.breaks) if self.course else []
        self.torques: Signal | None = None
        if drive.times is not None and drive.torques is not None:
            rows = np.array(drive.torques)
            self.torques = rows_in_time(np.array(drive.times), rows, smooth=drive.smooth, hold=drive.hold)
        self.effort = np.array(drive.effort or [math.inf] * len(links))[self.driven]
        self.rigid = (
            fl.lump(scene.rigidified()) if drive.kind in {"pd", "computed_torque"} and not chain.has_free_base else None
        )
        zeros = np.zeros((len(wrench.times or ()), 3))
        table = np.hstack([zeros if rows is None else np.array(rows) for rows in (wrench.forces, wrench.moments)]) \
            if wrench.times is not None else np.zeros((0, 6))  # fmt: skip
        self.pull = rows_in_time(np.array(wrench.times), table, smooth=wrench.smooth, hold=wrench.hold) \
            if wrench.times is not None else (lambda _: np.array((*wrench.force, *wrench.moment)))  # fmt: skip
        self.breaks += [*(drive.times or ()), *(wrench.times or ())]
        self.motions = [self.motion(motion) for motion in scene.motion]
        self.breaks += [t for motion in scene.motion for t in motion.times]
        self.held: dict[tuple[float, ...], Array] = {}
        self.spline: Any = None

    def motion(self, motion: Any) -> tuple[int, Callable[[float], Array]]:
        """Number of the prescribed coordinate, and its position, rate and acceleration as a function of time."""
        number = self.scene.arm.number(motion.link) - 1
        rows = np.column_stack(motion.columns)
        rows = rows if self.slides[number] else np.radians(rows)
        t = np.array(motion.times)
        path = BPoly.from_derivatives(t, rows[:, :3]) if len(t) > 1 else None

        def at(time: float) -> Array:
            if path is None or time >= t[-1]:
                return np.array([rows[-1, 0] + rows[-1, 1] * (time - t[-1]), rows[-1, 1], 0.0])
            return np.array([float(path(time, order)) for order in range(3)])

        return int(self.a[self.driven.index(number)]), at

    def gravity(self, t: float, r: Array) -> Array:
        """Torque that the control law adds to hold the arm at the reference position r."""
        kind = self.scene.drive.gravity
        if kind == "none":
            return np.zeros(len(self.a))
        if kind == "rigid":
            assert self.rigid is not None
            return np.array(fl.gravity_torque(self.rigid, r))
        if self.course is None or self.scene.drive.reference.profile == "hold":  # type: ignore[union-attr]
            return self.holding(r)
        if self.spline is None:
            inner = [b for b in self.course.breaks if self.start < b < self.end]
            times = np.unique(np.concatenate([np.linspace(self.start, self.end, 61), inner]))
            times = times[np.concatenate([[True], np.diff(times) > 1e-6])]
            self.spline = CubicSpline(times, [self.holding(self.course(s)[0][self.driven]) for s in times])
        return np.asarray(self.spline(t))

    def holding(self, r: Array) -> Array:
        """Torques T_EX that hold the joints at rest at the reference position r."""
        if self.chain.n == len(self.a):  # rigid arm
            return np.array(fl.gravity_torque(self.chain, r))
        key = tuple(np.round(r, 13))
        if key not in self.held:
            q = self.chain.rest.copy()
            q[self.a] = r
            self.held[key] = fl.solve_static(self.chain, q, locked=self.a.tolist()).tau[self.a]
        return self.held[key]

    def law(self, t: float, q: Array, qd: Array) -> Array:
        """Torques T_EX that the drive applies to the driven joints."""
        drive, place, rate = self.scene.drive, q[self.a], qd[self.a]
        if drive.kind == "none":
            return np.zeros(len(self.a))
        if drive.kind == "constant":
            return np.array(np.clip(np.array(drive.torque)[self.driven], -self.effort, self.effort))
        if self.torques is not None:
            return np.clip(self.torques(t)[self.driven], -self.effort, self.effort)
        if self.course is not None:
            r, rd, rdd = (row[self.driven] for row in self.course(t))
        else:
            r = own(self.slides, drive.target_deg, drive.target_m)[self.driven]
            rd = rdd = np.zeros(len(r))
        ahead = np.array(drive.kp)[self.driven] * (r - place) + np.array(drive.kd)[self.driven] * (rd - rate)
        if drive.kind == "pd":
            return np.clip(ahead + self.gravity(t, r), -self.effort, self.effort)
        assert self.rigid is not None
        tau = fl.mass_matrix(self.rigid, place) @ (rdd + ahead) + fl.bias_torque(self.rigid, place, rate)
        return np.clip(tau, -self.effort, self.effort)

    def accelerations(self, t: float, q: Array, qd: Array, torque: Array) -> Array:
        """Solve the equation of motion with a Gauss method."""
        chain, wrench = self.chain, self.scene.wrench
        tau = np.zeros(chain.n)
        tau[self.a] = torque
        load, on = self.pull(t), wrench.on or None
        if on and load.any():
            slope = fl.jacobian(chain, q, tip=on)
            turn = np.eye(3) if wrench.frame == "world" else fl.frames(chain, q).rotations[chain.tip_body(on)]
            tau += slope.linear.T @ (turn @ load[:3]) + slope.angular.T @ (turn @ load[3:])
            load = np.zeros(6)
        if not self.motions:
            return fl.forward_dynamics(chain, q, qd, tau, tip_wrench=load, frame=wrench.frame)
        left = fl.bias_torque(chain, q, qd, tip_wrench=load, frame=wrench.frame) + fl.elastic_torque(chain, q)
        left += fl.friction_torque(chain, qd) + fl.drag_torque(chain, q, qd)
        mass, qdd = fl.mass_matrix(chain, q), np.zeros(chain.n)
        for k, at in self.motions:
            qdd[k] = at(t)[2]
        free = np.delete(np.arange(chain.n), [k for k, _ in self.motions])
        qdd[free] = np.linalg.solve(mass[np.ix_(free, free)], (tau - left - mass @ qdd)[free])
        return qdd

    def split(self, t: float, y: Array) -> tuple[Array, Array]:
        """Replace prescribed angles and rates by their exact values."""
        q, qd = y[: self.chain.n].copy(), y[self.chain.n :].copy()
        for k, at in self.motions:
            q[k], qd[k] = at(t)[:2]
        return q, qd

    def tangent(self, t: float, y: Array, torque: Array | None) -> Array:
        """Approximate Jacobian of ẏ, accurate enough for Newton's iteration."""
        (q, qd), n = self.split(t, y), self.chain.n
        slopes = fl.forward_dynamics_derivatives(self.chain, q, qd, np.zeros(n))
        out = np.block([[np.zeros((n, n)), np.eye(n)], [slopes.dq, slopes.dqd]])
        drive = self.scene.drive
        if torque is None and drive.kp is not None and drive.kd is not None:
            column = slopes.dtau[:, self.a]
            out[n:, self.a] -= column * np.array(drive.kp)[self.driven]
            out[n:, n + self.a] -= column * np.array(drive.kd)[self.driven]
        return out

    def slope(self, t: float, y: Array, torque: Array | None) -> Array:
        """Derivative ẏ of the state y = (q, q̇) for the integrator."""
        self.left -= 1
        if self.left < 0:
            raise TooSlowError
        q, qd = self.split(t, y)
        try:
            return np.concatenate([qd, self.accelerations(t, q, qd, self.law(t, q, qd) if torque is None else torque)])
        except fl.errors.ArgumentError:  # overflow in a step that is far too long
            return np.full_like(y, np.nan)

    def end_state(self, q: Array, qd: Array, start: float, end: float, tight: float = 1e-9) -> tuple[Array, Array]:
        """Final position of the tips."""
        self.start, self.end = start, end
        rate, stiff = self.scene.drive.rate, self.fastest(q, qd) * (end - start) > 4000
        stops = {start, end, *(t for t in self.breaks if start + 1e-9 < t < end - 1e-9)}
        if rate:
            stops |= {
                k / rate for k in range(math.ceil(start * rate), math.ceil(end * rate)) if start < k / rate < end - 1e-9
            }
        times = sorted(stops)
        times = [times[0], *(b for a, b in itertools.pairwise(times) if b - a > 1e-10)]
        y, torque = np.concatenate([q, qd]), None
        for a, b in itertools.pairwise(times):
            if rate and abs(a * rate - round(a * rate)) < 1e-6:
                torque = self.law(a + 1e-12, *self.split(a, y))
            inside = lambda t, y, a=a, b=b, u=torque: self.slope(min(max(t, a + 1e-12), b - 1e-12), y, u)  # noqa: E731
            jac = {"jac": lambda t, y, u=torque: self.tangent(t, y, u)} if stiff else {}
            found = solve_ivp(
                inside, (a, b), y, "Radau" if stiff else "DOP853", t_eval=[b], rtol=tight, atol=tight * 1e-2, **jac
            )
            if not found.success:
                raise TooSlowError
            y = found.y[:, -1]
        return self.split(end, y)

    def fastest(self, q: Array, qd: Array) -> float:
        """Largest eigenvalue of the arm's linearized motion [1/s]."""
        held = np.zeros(len(self.a)) if self.scene.drive.rate else None
        y = np.concatenate([q, qd])
        return float(np.abs(np.linalg.eigvals(self.tangent(self.scene.initial.time, y, held))).max())


def places(scene: fl.Scene) -> tuple[float, Array, Array]:
    """Mass, centre of mass and tip of an arm with springs at rest, from independent transforms."""
    initial, arm = scene.initial, scene.arm
    joint = own(arm.slides, initial.joint_deg, initial.joint_m)
    root, bodies = np.eye(4), list[tuple[float, Array]]()
    if arm.base.free:
        b = initial.base
        turn = (
            Rotation.from_quat(np.roll(b.quaternion, -1))
            if b.quaternion
            else Rotation.from_euler("xyz", b.rpy_deg, degrees=True)
        )
        root = frame(turn.as_matrix(), b.xyz)
        bodies.append((arm.base.mass, (root @ (*arm.base.center, 1))[:3]))
    ends, starts, tip = {"base": root, "": root}, {"base": root, "": root}, root
    before = ""
    for link, angle in zip(arm.links, joint, strict=True):
        on = link.on or before
        slide = frame(np.eye(3), link.joint.direction * angle) if link.joint.slides else \
            frame(Rotation.from_rotvec(link.joint.direction * angle).as_matrix(), (0, 0, 0))  # fmt: skip
        rpy = link.mount.rpy or np.radians(link.mount.rpy_deg)
        mounted = ends[on] @ frame(Rotation.from_euler("xyz", rpy).as_matrix(), link.mount.xyz)
        here, dh = mounted @ slide, link.dh
        start, stop = link.line or ((0, 0, 0), (link.length, 0, 0))
        if dh is not None:
            if dh.convention == "standard":
                here = mounted @ about("z", dh.theta_deg) @ slide
                end = here @ frame(np.eye(3), (dh.a, 0, dh.d)) @ about("x", dh.alpha_deg)
                stop = stop if link.length else (dh.a, 0, dh.d)
            else:
                here = starts[on] @ about("x", dh.alpha_deg) @ frame(np.eye(3), (dh.a, 0, 0)) @ about("z", dh.theta_deg)
                end = here = here @ frame(np.eye(3), (0, 0, dh.d)) @ slide
        beam_end = here @ frame(np.eye(3), stop)
        if dh is None:
            end = beam_end
        tip = end if dh is not None and dh.convention == "standard" else beam_end
        mass, part = beam_mass(arm, link)
        middle = np.array(start) + part * np.subtract(stop, start)
        for m, place in ((link.hub.mass, here @ (*link.hub.center, 1)), (mass, here @ (*middle, 1)),
                         (link.end.mass, tip @ (*link.end.center, 1))):  # fmt: skip
            bodies.append((m, place[:3]))
        ends[link.name], starts[link.name], before = end, here, link.name
    bodies.append((arm.tip.mass, (tip @ (*arm.tip.center, 1))[:3]))
    total = sum(m for m, _ in bodies)
    return total, np.asarray(sum(m * p for m, p in bodies) / total), tip[:3, 3]


def about(axis: str, deg: float) -> Array:
    """Transform of a rotation about an axis."""
    return frame(Rotation.from_euler(axis, deg, degrees=True).as_matrix(), (0, 0, 0))


def frame(turn: Array, place: Any) -> Array:
    """Transform of a pose."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, place
    return out


def beam_mass(arm: fl.Arm, link: fl.Link) -> tuple[float, float]:
    """Mass of a beam, and its centre as a fraction of the length."""
    x, w = np.polynomial.legendre.leggauss(40)
    x, w, length = (x + 1) / 2, w / 2, link.beam.length
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        fine = np.linspace(0, 1, 200_001)[:-1] + 2.5e-6
        rho = (
            np.interp(fine * length, np.array(table.x) + np.arange(len(table.x)) * 1e-9, table.rho_a)
            * table.mass_factor
        )
        return float(rho.mean() * length), float((rho * fine).mean() / rho.mean())
    if link.section is None:
        return 0.0, 0.0
    first = arm.sections[link.section]
    last = arm.sections[link.section_tip or link.section]
    area = np.array([_area(first, last, part) for part in x]) * w
    return float(arm.materials[link.material or ""].density * area.sum() * length), float(area @ x / area.sum())


def sizes(first: fl.Section, last: fl.Section, part: float) -> Callable[[str], float]:
    """Dimensions by name, at a fraction of the length of a tapered beam."""
    return lambda key: float((1 - part) * getattr(first, key) + part * getattr(last, key))


def compliance(arm: fl.Arm, link: fl.Link) -> dict[str, float]:
    """Rotation of a beam's end under unit moments about x, y, z of the section [rad/(N m)]."""
    x = (np.arange(20_000) + 0.5) / 20_000
    wanted = {"z": "z", "yz": "yz", "xyz": "xyz"}[link.flex]
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        at = np.array(table.x) / table.x[-1] + np.arange(len(table.x)) * 1e-12
        rows = {"x": table.gj, "y": table.ei_y, "z": table.ei_z}
        rigid = {axis: np.interp(x, at, rows[axis] or (1.0,) * len(at)) * table.stiffness_factor for axis in wanted}
    else:
        first = arm.sections[link.section or ""]
        last, material = arm.sections[link.section_tip or link.section or ""], arm.materials[link.material or ""]
        shear = material.young / (2 * (1 + material.poisson))
        both = [_second_moments(first, last, part) for part in x]
        rigid = {axis: np.array([row["xyz".index(axis)] for row in both]) * (shear if axis == "x" else material.young)
                 for axis in wanted}  # fmt: skip
    return {axis: float((1 / row).mean() * link.beam.length) for axis, row in rigid.items()}


def _second_moments(first: fl.Section, last: fl.Section, part: float) -> tuple[float, float, float]:
    """J, I_y and I_z of a section; J of rectangles and boxes is NaN, because it is not checked."""
    size = sizes(first, last, part)
    if first.shape == "general":
        return size("torsion"), size("i_y"), size("i_z")
    if first.shape in {"circle", "tube"}:
        outer, inner = (size("diameter"), 0.0) if first.shape == "circle" else (size("outer"), size("inner"))
        i = math.pi / 64 * (outer**4 - inner**4)
        return 2 * i, i, i
    h, w = size("height"), size("width")
    inner_h, inner_w = (h - 2 * size("wall"), w - 2 * size("wall")) if first.shape == "box" else (0.0, 0.0)
    return math.nan, (h * w**3 - inner_h * inner_w**3) / 12, (w * h**3 - inner_w * inner_h**3) / 12


def _area(first: fl.Section, last: fl.Section, part: float) -> float:
    size = sizes(first, last, part)
    if first.shape == "rectangle":
        return float(size("height") * size("width"))
    if first.shape == "circle":
        return float(math.pi / 4 * size("diameter") ** 2)
    if first.shape == "tube":
        return float(math.pi / 4 * (size("outer") ** 2 - size("inner") ** 2))
    if first.shape == "box":
        return float(
            size("height") * size("width") - (size("height") - 2 * size("wall")) * (size("width") - 2 * size("wall"))
        )
    return float(size("area"))
