"""Static equilibrium under gravity, tip wrench and drive torque: Newton's method along an arc-length path.

    r(q) = T_FL(q) + L(q) = 0,    L = T_GC(q, q̇) − τ        on the coordinates that are not locked

The load grows in proportion to s from 0 to 1, while the torques that hold the springs at the posture q0 are let go:

    F(q, s) = T_FL(q) + s L(q) − (1 − s) T_FL(q0)             where there is a spring
    F(q, s) = L(q) − (1 − s) L(q0)                            where there is none: a load too small would not hold

The path F = 0 is followed by its arc length in (s, q) (Riks 1979; Crisfield 1981), so that it may turn back in s.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from flexlink.chain.arguments import positive, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain, Joints
from flexlink.common.errors import ConvergenceError
from flexlink.common.types import Array
from flexlink.describe.conditions import Frame
from flexlink.dynamics import rounding
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.tangent import load_torque, stiffness_matrix, tangent, unlocked
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.wrench import turns_with_tip

Function = Callable[[Array], Array]

FIRST_ARC, LARGEST_ARC, SMALLEST_ARC = 0.5, 1.0, 1e-6  # rad over all joints
CORRECTIONS, WANTED = 12, 6  # Newton steps after which a corrector has failed; below which the arc may grow
STEPS = 500


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(SavedResult):
    """A posture in which all torques balance.

    Attributes
    ----------
    q
        Angles [rad], shape (n,).
    tau
        T_EX with which it rests, shape (n,) [N m]: T_GC + T_FL where a coordinate is locked or its motion prescribed,
        what holds it there; elsewhere as given. About it, `linearize(chain, rest.q, tau=rest.tau)` has ẋ = 0.
    residual
        Largest torque left over on a coordinate that is not locked [N m].
    stable
        No coordinate can fall: no eigenvalue of the tangent stiffness has a negative real part, beyond rounding; a
        joint that nothing holds rests. (A follower wrench can also flutter: see `modes`.)
    path
        The (s, q) of all steps, shape (steps, 1 + n); s is the part of the load that is on.
    """

    q: Array
    tau: Array
    residual: float
    stable: bool
    path: Array

    def __repr__(self) -> str:
        most = np.degrees(np.abs(self.q).max())
        return (
            f"<Equilibrium: {'' if self.stable else 'un'}stable; {len(self.q)} joints at angles up to {most:.4g}°, "
            f"{self.residual:.2g} N m left over>"
        )


def solve_static(
    chain: Chain,
    q: ArrayLike | None = None,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    locked: Joints = (),
    tolerance: float = 1e-9,
) -> Equilibrium:
    """Posture in which gravity, springs, tip wrench and drive torque balance: T_GC(q, q̇) + T_FL(q) = T_EX.

    Newton's method along the arc length of the path on which the load grows (Riks 1979; Crisfield 1981).

    Parameters
    ----------
    chain
        The chain.
    q
        Posture to start from [rad], shape (n,); default: springs slack, joints at zero. Locked ones stay there.
    qd
        Constant rates [rad/s], shape (n,), for the relative equilibrium of a steadily turning arm.
    tau
        Drive torque T_EX [N m], shape (n,).
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame,
        with which they turn.
    locked
        Coordinates that do not move: names or sequential indices of joints, names of links, or a boolean mask,
        shape (n,).
    tolerance
        Newton's method stops after a correction of no angle by more than this [rad]; the error that is left is of
        the order of its square, or rounding.

    Returns
    -------
    Equilibrium
        The posture [rad], whether it is stable, and the path to it.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    ConvergenceError
        The path from q does not reach the full load; the error holds the posture at the largest part reached.
    """
    n = require_type("chain", chain, Chain).n
    follower, tolerance = turns_with_tip(frame), positive("tolerance", tolerance)
    start = chain.rest.copy() if q is None else vector("q", q, n).copy()
    wrench = wrench_vector(tip_wrench)
    drive = np.zeros(n) if tau is None else vector("tau", tau, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    free = unlocked(chain, locked)

    def whole(part: Array) -> Array:
        posture = start.copy()
        posture[free] = part
        return posture

    def load(part: Array) -> Array:
        return (load_torque(chain, whole(part), rates, wrench, follower) - drive)[free]

    def slope(part: Array) -> Array:
        K = stiffness_matrix(chain, whole(part), rates, wrench, follower)
        return (K - np.diag(chain.stiffness))[np.ix_(free, free)]

    k, rest = chain.stiffness[free], chain.rest[free]
    equations = _Equations(k, rest, load, slope, start[free])
    try:
        path = _follow(equations, tolerance)
    except _LostError as lost:
        loose = np.intersect1d(chain.active, free)
        hint = "; hold free joints with locked=chain.active, if they are meant to stay" if len(loose) else ""
        left = np.abs(equations.value(np.concatenate([[1.0], lost.q]))).max()
        raise ConvergenceError(
            f"solve_static: no equilibrium found; {lost.steps} steps from q reached {lost.part:.6g} of the load, "
            f"where the full load leaves {left:.3g} N m unbalanced{hint}",
            q=whole(lost.q),
            load=lost.part,
        ) from None
    posture = _as_known(chain, whole(path[-1][1:]), free, rates, wrench)
    holding = load_torque(chain, posture, rates, wrench, follower) + elastic_torque(chain, posture)
    holding[free] = drive[free]
    return Equilibrium(
        posture,
        holding,
        float(np.abs(equations.value(np.array([1.0, *posture[free]]))).max()),
        not tangent(chain, posture, rates, wrench, free, follower).falls,
        np.array([[point[0], *whole(point[1:])] for point in path]),
    )


def buckling_loads(
    chain: Chain,
    q: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    locked: Joints = (),
) -> Array:
    """Factors (dimensionless) of the present load, gravity and tip wrench together, at which the posture can buckle.

    Linear buckling: K_elastic + s K_load(q) is singular, with the posture held at q, and joints without a spring, too.
    Only real positive s count; loads that soften nothing give none.

    Parameters
    ----------
    chain
        The chain.
    q
        Posture [rad], shape (n,); default: springs slack, joints at zero.
    tip_wrench
        Force and moment on the tip [N, N m], shape (6,), axes of frame 0.
    locked
        Coordinates that do not move, as in `solve_static`.

    Returns
    -------
    Array
        Factors s, smallest first.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    """
    n = require_type("chain", chain, Chain).n
    q = chain.rest.copy() if q is None else vector("q", q, n)
    wrench = wrench_vector(tip_wrench)
    free = unlocked(chain, locked)
    sprung = free[chain.stiffness[free] > 0]
    k = chain.stiffness[sprung]
    load = stiffness_matrix(chain, q, np.zeros(chain.n), wrench)[np.ix_(sprung, sprung)] - np.diag(k)
    inverse = linalg.eigvals(-load / np.sqrt(np.outer(k, k)))  # 1/s
    rounding = len(k) * np.finfo(float).eps * np.abs(inverse).max(initial=0.0)
    softening = inverse.real > rounding
    real = np.abs(inverse.imag) <= np.sqrt(np.finfo(float).eps) * np.abs(inverse)  # of a double eigenvalue, too
    return np.asarray(np.sort(1 / inverse.real[softening & real]))


def _as_known(chain: Chain, q: Array, free: NDArray[np.intp], qd: Array, wrench: Array) -> Array:
    """q with the deflection of every spring to the decimals that its load is known to, that is to ΔL / k.

    No torque changes by more than rounding has left open, and what the solver's own roundings have put into digits
    that mean nothing, other ones on other CPUs, goes: an angle that is 0 by symmetry is 0.
    """
    q = q.copy()
    for i, decimals in known_decimals(chain, free, qd, wrench):
        q[i] = chain.rest[i] + round(float(q[i] - chain.rest[i]), decimals)
    return q


def known_decimals(chain: Chain, free: NDArray[np.intp], qd: Array, wrench: Array) -> list[tuple[int, int]]:
    """Of every spring the decimals of its deflection that its load leaves known."""
    open_ = rounding.of_loads(chain, qd, wrench)
    sprung = free[(chain.stiffness[free] > 0) & (open_[free] > 0)]
    return [(i, math.ceil(math.log10(chain.stiffness[i] / open_[i]))) for i in sprung.tolist()]


class _LostError(Exception):
    def __init__(self, path: list[Array]) -> None:
        furthest = max(path, key=lambda point: point[0])
        self.part, self.q, self.steps = float(furthest[0]), furthest[1:], len(path)


class _Equations:
    """F(x) and its slopes for x = (s, q)."""

    def __init__(self, k: Array, rest: Array, load: Function, slope: Function, start: Array) -> None:
        self.k, self.rest, self.load, self.slope = k, rest, load, slope
        self.sprung = k > 0
        self.start = np.concatenate([[0.0], start])
        self.held = np.where(self.sprung, k * (start - rest), load(start))

    def value(self, x: Array) -> Array:
        s, q = x[0], x[1:]
        loaded = np.where(self.sprung, s, 1.0) * self.load(q)
        return np.asarray(self.k * (q - self.rest) + loaded - (1 - s) * self.held)

    def slopes(self, x: Array) -> Array:
        s, q = x[0], x[1:]
        by_q = np.diag(self.k) + np.where(self.sprung, s, 1.0)[:, None] * self.slope(q)
        by_s = np.where(self.sprung, self.load(q), 0.0) + self.held
        return np.column_stack([by_s, by_q])


def _follow(equations: _Equations, tolerance: float) -> list[Array]:
    """Points x = (s, q) from s = 0 to s = 1: predictor along the tangent, corrector orthogonal to it."""
    point, arc = equations.start, FIRST_ARC
    direction = along_s = np.eye(len(point))[0]
    path = [point]
    while point[0] < 1:
        direction = _direction(equations.slopes(point), direction)
        while True:
            step = min(arc, (1 - point[0]) / direction[0]) if direction[0] > 0 else arc
            new, corrections = _correct(equations, point + step * direction, direction, tolerance)
            if new is not None and new[0] + 1e-12 >= 1:  # arrived: land on s = 1
                landing = point + (new - point) * ((1 - point[0]) / (new[0] - point[0]))
                landing[0] = 1.0
                new, _ = _correct(equations, landing, along_s, tolerance)
            if new is not None and np.linalg.norm(new - point) <= 2 * step:
                break
            arc = step / 4
            if arc < SMALLEST_ARC:
                raise _LostError(path)
        point = new
        path.append(point)
        if len(path) > STEPS:
            raise _LostError(path)
        if corrections < WANTED:
            arc = min(2 * arc, LARGEST_ARC)
    return path


def _direction(slopes: Array, before: Array) -> Array:
    """Unit tangent of the path, on the side of the direction before: F' t = 0."""
    t = _solve(np.vstack([slopes, before]), np.eye(len(before))[-1])
    return np.asarray(t / np.linalg.norm(t))


def _correct(equations: _Equations, target: Array, row: Array, tolerance: float) -> tuple[Array | None, int]:
    """Newton back to the path in the plane row · (x − target) = 0; None if it does not converge."""
    x, k = target.copy(), 0
    while k < CORRECTIONS and np.isfinite(x).all() and np.linalg.norm(x - target) <= 100 * LARGEST_ARC:
        left = np.append(equations.value(x), row @ (x - target))
        change = _solve(np.vstack([equations.slopes(x), row]), left)
        x, k = x - change, k + 1
        if np.abs(change).max() <= tolerance:
            return x, k
    return None, CORRECTIONS


def _solve(A: Array, b: Array) -> Array:
    """Shortest least-squares solution: a joint that nothing holds and nothing pushes stays where it is."""
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        return np.full(A.shape[1], np.nan)  # which the corrector gives up on
    return np.asarray(np.linalg.lstsq(A, b)[0])
