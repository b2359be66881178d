"""Continuation of equilibria under a growing load, by arc length.

    r(q) = T_FL(q) + L(q) = 0,    L = T_GC(q, q̇) − τ        on the coordinates that are not locked

The load factor s grows from 0 to 1, while the torques that hold the springs at the initial q0 are released:

    F(q, s) = T_FL(q) + s L(q) − (1 − s) T_FL(q0)             for coordinates with a spring
    F(q, s) = T_FL(q) + L(q) − (1 − s) (T_FL(q0) + L(q0))     without stiffness at q0: always under the full load

The arc length is measured in (s, q) (Riks 1979; Crisfield 1981), so the path may turn back in s. A Newton step takes
O(n): ∂F/∂q is eliminated along the chain (`kernels.derivatives.small_motion`).
"""

from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.dynamics.forces import about, linearised, spring_torque
from flexlink.dynamics.free_motion import basis, first_joints, sums_of_squares
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.tangent import LoadedState, falls, load_torque, stiffness_matrix
from flexlink.kernels.tools.finite import is_finite

FIRST_ARC = 0.5
"""Length of the first arc [rad], the root of the sum of squares over all joints; displacements of sliding joints are
relative to the arm's length."""
LARGEST_ARC = 1.0  # largest length of an arc [rad]
SMALLEST_ARC = 1e-6  # length of an arc [rad] below which the path is given up as lost
CORRECTIONS = 12  # largest number of Newton steps of a corrector
WANTED = 6  # number of Newton steps below which the next arc may be longer
STEPS = 500  # largest number of points of a path
TRIES = (1.0, 0.2), (0.1, 0.2), (1.0, 3.0)
"""Successive tries: factor on the arc length, and the largest distance that a corrector may move, relative to the arc.
The last pair is for free joints without springs, whose path may begin with a jump."""


class LostError(Exception):
    """The path does not reach the full load; the error reports the largest load reached."""

    def __init__(self, path: list[Array]) -> None:
        furthest = max(path, key=lambda point: point[0])
        self.part, self.point, self.steps = float(furthest[0]), furthest, len(path)


class Equations:
    """F(x) for x = (s, q), shape (1 + n,), and its derivatives; their entries for locked coordinates are 0.

    `acting` is the initial configuration with its loads, `drive` are the torques T_EX.
    """

    motion: Any = None  # a SmallMotion of the hinges

    def __init__(self, chain: Chain, acting: LoadedState, drive: Array) -> None:
        self.chain, self.acting, self.drive = chain, acting, drive
        self.stiffness = linearised(chain, acting.q).stiffness
        self.sizes = rounding.largest_load_stiffness(chain, acting.qd, acting.wrench)
        self.scales = np.append(1.0, rounding.scales(chain))  # units of x in the arc length
        self.begin()
        self.sprung = self.stiffness > 0
        self.held = self.on(spring_torque(chain, acting.q)) + np.where(self.sprung, 0.0, self.on(self.load(acting.q)))

    def begin(self) -> None:
        """Choose the coordinates of the path and its start."""
        self.motion = SmallMotion(self.chain, *self.acting)
        self.start = np.append(0.0, self.acting.q)

    def posture(self, x: Array) -> Array:
        """Angles q (n,) of a point of the path."""
        return x[1:]

    def on(self, torques: Array) -> Array:
        """Torques of the joints (n,) on the coordinates of the path."""
        return np.where(self.motion.locked, 0.0, torques)

    def falls(self, x: Array) -> bool:
        """Whether an equilibrium is unstable under the full load."""
        return falls(self.chain, self.acting._replace(q=self.posture(x)), self.motion)

    def load(self, q: Array) -> Array:
        """L(q)."""
        return load_torque(self.chain, q, *self.acting[1:4]) - self.drive

    def value(self, x: Array) -> Array:
        """F(x)."""
        return self._value_and_slope(x)[0]

    def with_slope(self, x: Array) -> tuple[Array, Array]:
        """F(x) and ∂F/∂s at x; prepares ∂F/∂q for `solve`."""
        self.prepare(self.posture(x), np.where(self.sprung, x[0], 1.0))
        return self._value_and_slope(x)

    def _value_and_slope(self, x: Array) -> tuple[Array, Array]:
        s, q = x[0], self.posture(x)
        load = self.on(self.load(q))
        left = self.on(spring_torque(self.chain, q)) + np.where(self.sprung, s, 1.0) * load - (1 - s) * self.held
        return left, np.where(self.sprung, load, 0.0) + self.held

    def prepare(self, q: Array, w: Array) -> None:
        """Factorize ∂F/∂q at angles q, with the part w of the loads on each coordinate."""
        self.motion.set_position(q)
        self.motion.eliminate(K_ALONE, w, np.abs(linearised(self.chain, q).stiffness) + np.abs(w) * self.sizes)

    def solve(self, by_s: Array, row: Array, residual: Array, last: float, *, held: bool = False) -> Array:
        """Shortest solution (δs, δq) of F' δx = residual (n,) and row · δx = last, shape (1 + n,), or nan.

        F' is ∂F/∂(s, q) at the x of the last call of `with_slope`. ∂F/∂q is eliminated except for the coordinates d
        whose pivots are too small. Let q̂ and p̂ be the solutions for the residual and for ∂F/∂s with δq_d = 0, and N
        the homogeneous solutions with δq_d = 1. Then

            δq = q̂ − p̂ δs + N δq_d

        where δs and δq_d follow from the rows d, whose left sides the elimination returns, and from `row`.

        A joint without stiffness or load keeps its position. If it has a load but no stiffness, there is no solution
        unless a weak spring is added (`held`).
        """
        if not (is_finite(by_s) and is_finite(residual)):
            return np.full(len(row), np.nan)  # the corrector then fails
        skipped = self.motion.skipped
        x, of_skipped = self.motion.solve(np.array([by_s, residual]))
        columns = np.concatenate([-x[:1], x[2:]])
        along = columns @ row[1:]
        along[0] += row[0]
        right = last - row[1:] @ x[1]
        if len(skipped):
            small = np.empty((1 + len(skipped), 1 + len(skipped)))
            small[:-1, 0] = by_s[skipped] - of_skipped[0]
            small[:-1, 1:] = of_skipped[2:].T
            small[-1] = along
            sizes = np.append(self.motion.sizes[skipped], max(np.abs(along).max(), np.finfo(float).tiny))
            sizes[sizes == 0] = 1.0
            if held:
                small[:-1, 1:] += np.diag(np.sqrt(self.motion.rounding) * sizes[:-1])
            found = shortest(small, np.append(residual[skipped] - of_skipped[1], right), sizes, self.motion.rounding)
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                found = right / along
        return np.concatenate([found[:1], x[1] + found @ columns])


def shortest(A: Array, b: Array, sizes: Array, rounding: float) -> Array:
    """Shortest solution of A x = b, or nan; rows below the rounding error of terms of magnitude `sizes` are 0."""
    scaled, right = A / sizes[:, None], b / sizes
    if not (np.isfinite(scaled).all() and np.isfinite(right).all()):
        return np.full(len(b), np.nan)
    columns = np.maximum(np.abs(scaled).max(axis=0), 1.0)
    found = np.linalg.lstsq(scaled / columns, right, rcond=rounding)[0] / columns
    consistent = np.abs(scaled @ found - right).max() <= rounding + np.sqrt(rounding) * np.abs(right).max()
    return np.asarray(found if consistent else np.full(len(b), np.nan))


def follow(equations: Equations, tolerance: float) -> list[Array]:
    """Return points x = (s, q) of the path from s = 0 to s = 1.

    Shorter arcs are tried if the path is lost or ends in an unstable equilibrium: it may have crossed to another branch
    of the equilibrium path, on which the arm remains straight although it should have buckled.
    """
    path, lost = list[Array](), list[LostError]()
    for part, off in TRIES:
        if path and off > 1:
            break
        try:
            path = _arcs(equations, tolerance, part, off)
        except LostError as error:
            lost.append(error)
            continue
        if not equations.falls(path[-1]):
            break
    if not path:
        raise max(lost, key=lambda error: error.part)
    return path


def _arcs(equations: Equations, tolerance: float, part: float, off: float) -> list[Array]:
    """Points of the path; `part` scales the arcs; a corrector moves by at most `off` steps from the predicted point."""
    point, arc = equations.start, part * FIRST_ARC
    path, direction = [point], np.append(1.0, np.zeros(len(point) - 1))
    while point[0] < 1:
        direction = _direction(equations, point, direction)
        while True:
            step = min(arc, (1 - point[0]) / direction[0]) if direction[0] > 0 else arc
            new, corrections = _corrected(equations, point, step, direction, tolerance, off)
            if new is not None:
                break
            arc = step / 4
            if arc < SMALLEST_ARC:
                raise LostError(path)
        point = new
        path.append(point)
        if len(path) > STEPS or point[0] < -1:  # too many steps, or the load is fully reversed
            raise LostError(path)
        if corrections < WANTED:
            arc = min(2 * arc, part * LARGEST_ARC)
    return path


def _corrected(
    equations: Equations, point: Array, step: float, direction: Array, tolerance: float, off: float
) -> tuple[Array | None, int]:
    """Return the next point of the path, at s ≤ 1, or None if no point is near, and the number of Newton steps."""
    scales, target = equations.scales, point + step * direction
    new, corrections = _correct(equations, target, direction / scales**2, tolerance)
    if new is not None and new[0] + 1e-12 >= 1:  # end of the path: solve at s = 1
        target = point + (new - point) * ((1 - point[0]) / (new[0] - point[0]))
        target[0] = 1.0
        new, _ = _correct(equations, target, np.append(1.0, np.zeros(len(point) - 1)), tolerance)
    if new is None or np.linalg.norm((new - target) / scales) > off * step:  # possibly another path
        return None, corrections
    return new, corrections


def _direction(equations: Equations, point: Array, before: Array) -> Array:
    """Unit tangent t of the path at a point, F' t = 0, on the same side as the previous direction."""
    scales, (_, by_s) = equations.scales, equations.with_slope(point)
    still, row = np.zeros(len(before) - 1), before / scales**2
    t = equations.solve(by_s, row, still, 1.0)
    if not np.isfinite(t).all():  # singular at a limit load: add weak springs
        t = equations.solve(by_s, row, still, 1.0, held=True)
    return np.asarray(t / np.linalg.norm(t / scales))


def _correct(equations: Equations, target: Array, row: Array, tolerance: float) -> tuple[Array | None, int]:
    """Return the path's point in the plane row · (x − target) = 0, or None, and the number of Newton steps."""
    x, k, scales = target.copy(), 0, equations.scales
    while k < CORRECTIONS and is_finite(x) and np.linalg.norm((x - target) / scales) <= 100 * LARGEST_ARC:
        value, by_s = equations.with_slope(x)
        change = equations.solve(by_s, row, value, float(row @ (x - target)))
        x, k = x - change, k + 1
        if np.abs(change / scales).max() <= tolerance:
            return x, k
    return None, CORRECTIONS


# Equilibria of a chain whose hinges move by shapes, q = q₀ + B z: the load path in the coordinates z.
#
# F(z, s) = Bᵀ (T_FL(q) + s L(q) − (1 − s) T_FL(q₀))        coordinates with springs; the others under the full load


class ShapedEquations(Equations):
    """F(x) for x = (s, z), shape (1 + f,), and its derivatives; locked coordinates are not among z."""

    def begin(self) -> None:
        """Choose the coordinates of the path and its start."""
        chain, free = self.chain, self.acting.free
        self.B = basis(chain, free)
        self.stiffness = sums_of_squares(self.stiffness, chain, free)
        self.sizes = sums_of_squares(self.sizes, chain, free)
        self.scales = np.append(1.0, self.scales[1:][first_joints(chain, free)])
        self.start = np.zeros(len(self.scales))
        self.rounding = len(self.sizes) * rounding.of_load_stiffness(chain)

    def posture(self, x: Array) -> Array:
        """Angles q (n,) of a point of the path."""
        return np.asarray(self.acting.q + self.B @ x[1:])

    def on(self, torques: Array) -> Array:
        """Torques of the joints (n,) on the coordinates of the path."""
        return np.asarray(self.B.T @ torques)

    def prepare(self, q: Array, w: Array) -> None:
        """Compute ∂F/∂z at angles q, with the part w of the loads on each coordinate."""
        elastic = about(self.chain, q).matrix("stiffness")
        whole = stiffness_matrix(self.chain, q, *self.acting[1:4])
        self.slope = self.B.T @ elastic @ self.B + w[:, None] * (self.B.T @ (whole - elastic) @ self.B)
        self.terms = self.stiffness + np.abs(w) * self.sizes

    def solve(self, by_s: Array, row: Array, residual: Array, last: float, *, held: bool = False) -> Array:
        """Shortest solution (δs, δz) of F' δx = residual and row · δx = last, or nan; `held` adds weak springs."""
        terms = np.where(self.terms > 0, self.terms, 1.0)
        slope = self.slope + np.diag(np.sqrt(self.rounding) * terms) if held else self.slope
        whole = np.block([[by_s[:, None], slope], [row[None]]])
        sizes = np.append(terms, max(np.abs(row).max(), np.finfo(float).tiny))
        return shortest(whole, np.append(residual, last), sizes, self.rounding)


def equations_of(chain: Chain, acting: LoadedState, drive: Array) -> Equations:
    """Equations of the load path of a chain, with or without shapes."""
    return (Equations if chain.shapes is None else ShapedEquations)(chain, acting, drive)
