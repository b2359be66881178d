"""Static equilibrium under gravity, tip wrench and drive torque: Newton's method along an arc-length path.

    r(q) = T_FL(q) + L(q) = 0,    L = T_GC(q, q̇) − τ        on the coordinates that are not locked

The load grows in proportion to s from 0 to 1, while the torques that hold the springs at the posture q0 are let go:

    F(q, s) = T_FL(q) + s L(q) − (1 − s) T_FL(q0)             where there is a spring
    F(q, s) = L(q) − (1 − s) L(q0)                            where there is none: a load too small would not hold

The path F = 0 is followed by its arc length in (s, q) (Riks 1979; Crisfield 1981), so that it may turn back in s. A
step of Newton's method takes O(n): ∂F/∂q is eliminated along the chain (`kernels.derivatives.small_motion`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import positive, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain, Joints
from flexlink.common.errors import ConvergenceError
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics import rounding
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.springs import about, spring_torque
from flexlink.dynamics.tangent import falls, load_torque, stiffness_matrix, unlocked
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.wrench import turns_with_tip

FIRST_ARC, LARGEST_ARC, SMALLEST_ARC = 0.5, 1.0, 1e-6  # rad over all joints; of those that slide, of the arm's length
CORRECTIONS, WANTED = 12, 6  # Newton steps after which a corrector has failed; below which the arc may grow
STEPS = 500
TRIES = (1.0, 0.2), (0.1, 0.2), (1.0, 3.0)
"""Lengths of arcs, over the usual one, and how far a corrector may leave the end of an arc, over its length: the last
where the others are lost, for free joints that no spring holds and whose path begins with a jump."""


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
    slides
        Which joints slide, shape (n,).
    """

    q: Array
    tau: Array
    residual: float
    stable: bool
    path: Array
    slides: NDArray[np.bool_]

    def __repr__(self) -> str:
        turned, slid = (np.abs(self.q[which]).max(initial=0.0) for which in (~self.slides, self.slides))
        out = [f"angles up to {np.degrees(turned):.4g}°"] if not self.slides.all() else []
        out += [f"places up to {slid:.4g} m"] if self.slides.any() else []
        return (
            f"<Equilibrium: {'' if self.stable else 'un'}stable; {len(self.q)} joints at {' and '.join(out)}, "
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
        Newton's method stops after a correction of no angle by more than this [rad], of joints that slide by so much
        of the arm's length; the error that is left is of the order of its square, or rounding.

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

    Examples
    --------
    >>> rest = fl.solve_static(chain, q, locked=["upper", "fore"])
    >>> print(rest.stable, rest.tau[chain.active].round(2))  # N m that hold the driven joints
    True [77.6  30.31]
    """
    n = require_type("chain", chain, Chain).n
    follower, tolerance = turns_with_tip(frame), positive("tolerance", tolerance)
    start = chain.rest.copy() if q is None else vector("q", q, n).copy()
    wrench = wrench_vector(tip_wrench)
    drive = np.zeros(n) if tau is None else vector("tau", tau, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    free = unlocked(chain, locked)
    equations = _Equations(chain, _Load(rates, wrench, follower, drive), free, start)
    try:
        path = _follow(equations, tolerance, lambda posture: not falls(chain, posture, rates, wrench, free, follower))
    except _LostError as lost:
        loose = np.intersect1d(chain.active, free)
        hint = "; hold free joints with locked=chain.active, if they are meant to stay" if len(loose) else ""
        left = np.abs(equations.value(np.concatenate([[1.0], lost.q]))).max()
        raise ConvergenceError(
            f"solve_static: no equilibrium found; {lost.steps} steps from q reached {lost.part:.6g} of the load, "
            f"where the full load leaves {left:.3g} N m unbalanced{hint}",
            q=lost.q,
            load=lost.part,
        ) from None
    posture = _as_known(chain, path[-1][1:], free, rates, wrench)
    holding = load_torque(chain, posture, rates, wrench, follower) + elastic_torque(chain, posture)
    holding[free] = drive[free]
    return Equilibrium(
        posture,
        holding,
        float(np.abs(equations.value(np.concatenate([[1.0], posture]))).max()),
        not falls(chain, posture, rates, wrench, free, follower),
        np.array(path),
        chain.slides,
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

    Examples
    --------
    >>> standing = np.where(np.arange(chain.n) == 0, np.pi / 2, 0.0)  # rad; upright
    >>> factors = fl.strength.buckling_loads(chain, standing, locked=["upper", "fore"])
    >>> print(factors[0].round(1))  # times its weight and load
    140.9
    """
    n = require_type("chain", chain, Chain).n
    q = chain.rest.copy() if q is None else vector("q", q, n)
    wrench = wrench_vector(tip_wrench)
    free = unlocked(chain, locked)
    block = np.ix_(*2 * (free[chain.stiffness[free] > 0],))
    K = about(chain, q).matrix("stiffness")[block]
    load = stiffness_matrix(chain, q, np.zeros(chain.n), wrench)[block] - K
    coupled = len(chain.couplings) > 0 or chain.has_rotation_springs
    inverse = scipy.linalg.eigvals(-_per_stiffness(load, K, coupled=coupled))  # 1/s
    rounding = len(K) * np.finfo(float).eps * np.abs(inverse).max(initial=0.0)
    softening = inverse.real > rounding
    real = np.abs(inverse.imag) <= np.sqrt(np.finfo(float).eps) * np.abs(inverse)  # of a double eigenvalue, too
    return np.asarray(np.sort(1 / inverse.real[softening & real]))


def _per_stiffness(load: Array, K: Array, *, coupled: bool) -> Array:
    """L⁻¹ load L⁻ᵀ of K = L Lᵀ, which has the eigenvalues of K⁻¹ load; K is diagonal unless springs are `coupled`.

    K⁻¹ load itself where K is not positive definite, as rotation vectors' springs may be, bent far.
    """
    if not coupled:
        k = K.diagonal()
        return np.asarray(load / np.sqrt(np.outer(k, k)))
    try:
        L = scipy.linalg.cholesky(K, lower=True)
    except scipy.linalg.LinAlgError:
        return np.asarray(scipy.linalg.solve(K, load))
    half = scipy.linalg.solve_triangular(L, load, lower=True)
    return np.asarray(scipy.linalg.solve_triangular(L, half.T, lower=True).T)


def _as_known(chain: Chain, q: Array, free: NDArray[np.intp], qd: Array, wrench: Array) -> Array:
    """q with the deflection of every spring to the decimals that its load is known to, that is to ΔL / Σ_j |K_ij|.

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
    k = chain.times("stiffness", np.ones(chain.n), absolute=True)
    return [(i, math.ceil(math.log10(k[i] / open_[i]))) for i in sprung.tolist()]


class _LostError(Exception):
    def __init__(self, path: list[Array]) -> None:
        furthest = max(path, key=lambda point: point[0])
        self.part, self.q, self.steps = float(furthest[0]), furthest[1:], len(path)


class _Load(NamedTuple):
    """What acts on a chain beside its springs."""

    rates: Array
    wrench: Array
    follower: bool
    drive: Array


class _Equations:
    """F(x) for x = (s, q), shape (1 + n,), 0 at coordinates that are locked, and its slopes."""

    def __init__(self, chain: Chain, acting: _Load, free: NDArray[np.intp], start: Array) -> None:
        self.chain, self.acting, self.sprung = chain, acting, chain.stiffness > 0
        self.locked = np.ones(chain.n, dtype=bool)
        self.locked[free] = False
        rates, wrench, follower, _ = acting
        self.motion = SmallMotion(chain, start, rates, wrench, follower, self.locked)
        self.start = np.concatenate([[0.0], start])
        self.sizes = rounding.largest_load_stiffness(chain, acting.rates, acting.wrench)
        self.scales = np.concatenate([[1.0], rounding.scales(chain)])  # of x, as the arc is measured
        self.held = np.where(self.sprung, spring_torque(chain, start), self.load(start))

    def load(self, q: Array) -> Array:
        rates, wrench, follower, drive = self.acting
        return load_torque(self.chain, q, rates, wrench, follower) - drive

    def value(self, x: Array) -> Array:
        return self._value(x, self.load(x[1:]))

    def _value(self, x: Array, load: Array) -> Array:
        s, q = x[0], x[1:]
        loaded = np.where(self.sprung, s, 1.0) * load
        left = spring_torque(self.chain, q) + loaded - (1 - s) * self.held
        return np.where(self.locked, 0.0, left)

    def with_slopes(self, x: Array) -> tuple[Array, _Slopes]:
        """F(x), and its slopes, which are good until those elsewhere are asked for."""
        s, q = x[0], x[1:]
        load, w = self.load(q), np.where(self.sprung, s, 1.0)
        by_s = np.where(self.sprung, load, 0.0) + self.held
        self.motion.place(q)
        self.motion.eliminate(K_ALONE, w, self.chain.stiffness + np.abs(w) * self.sizes)
        return self._value(x, load), _Slopes(self.motion, np.where(self.locked, 0.0, by_s))


class _Slopes:
    """∂F/∂(s, q), with ∂F/∂q eliminated but for the coordinates d whose pivots are too small.

    With q̂ and p̂ the solutions for a right side and for ∂F/∂s with δq_d = 0, and N those for none with δq_d = 1,

        δq = q̂ − p̂ δs + N δq_d

    so that δs and δq_d follow from the rows d, whose left sides the elimination tells, and from the row below.
    """

    def __init__(self, motion: SmallMotion, by_s: Array) -> None:
        self.motion, self.by_s = motion, by_s

    def solve(self, row: Array, left: Array, last: float, *, held: bool = False) -> Array:
        """Shortest solution (δs, δq) of F' δx = left (n,) and row · δx = last, shape (1 + n,); nan if there is none.

        A joint that nothing holds and nothing pushes stays where it is; where one is pushed there is no solution,
        unless it is `held` by a weak spring.
        """
        if not (np.isfinite(self.by_s).all() and np.isfinite(left).all()):
            return np.full(len(row), np.nan)  # which the corrector gives up on
        spared = self.motion.spared
        x, of_spared = self.motion.solve(np.array([self.by_s, left]))
        columns = np.concatenate([-x[:1], x[2:]])
        along = columns @ row[1:]
        along[0] += row[0]
        right = last - row[1:] @ x[1]
        if len(spared):
            small = np.empty((1 + len(spared), 1 + len(spared)))
            small[:-1, 0] = self.by_s[spared] - of_spared[0]
            small[:-1, 1:] = of_spared[2:].T
            small[-1] = along
            sizes = np.append(self.motion.sizes[spared], max(np.abs(along).max(), np.finfo(float).tiny))
            sizes[sizes == 0] = 1.0
            if held:
                small[:-1, 1:] += np.diag(np.sqrt(self.motion.rounding) * sizes[:-1])
            found = _shortest(small, np.append(left[spared] - of_spared[1], right), sizes, self.motion.rounding)
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                found = right / along
        return np.concatenate([found[:1], x[1] + found @ columns])


def _shortest(A: Array, b: Array, sizes: Array, rounding: float) -> Array:
    """Shortest solution of A x = b, rows made of numbers of these sizes; nan if there is none.

    What rounding leaves of a row counts as 0.
    """
    scaled, right = A / sizes[:, None], b / sizes
    if not (np.isfinite(scaled).all() and np.isfinite(right).all()):
        return np.full(len(b), np.nan)
    columns = np.maximum(np.abs(scaled).max(axis=0), 1.0)
    found = np.linalg.lstsq(scaled / columns, right, rcond=rounding)[0] / columns
    consistent = np.abs(scaled @ found - right).max() <= rounding + np.sqrt(rounding) * np.abs(right).max()
    return np.asarray(found if consistent else np.full(len(b), np.nan))


def _follow(equations: _Equations, tolerance: float, stable: Callable[[Array], bool]) -> list[Array]:
    """Points x = (s, q) from s = 0 to s = 1.

    By shorter arcs where the path is lost, or ends unstable: it may have crossed to a buckled arm that stands straight.
    """
    path, lost = list[Array](), list[_LostError]()
    for part, off in TRIES:
        if path and off > 1:
            break
        try:
            path = _arcs(equations, tolerance, part, off)
        except _LostError as error:
            lost.append(error)
            continue
        if stable(path[-1][1:]):
            break
    if not path:
        raise max(lost, key=lambda error: error.part)
    return path


def _arcs(equations: _Equations, tolerance: float, part: float, off: float) -> list[Array]:
    """The same by arcs, this part of their usual length: predictor along the tangent, corrector orthogonal to it."""
    point, arc = equations.start, part * FIRST_ARC
    path, direction = [point], np.append(1.0, np.zeros(len(point) - 1))
    while point[0] < 1:
        direction = _direction(equations.with_slopes(point)[1], direction, equations.scales)
        while True:
            step = min(arc, (1 - point[0]) / direction[0]) if direction[0] > 0 else arc
            new, corrections = _corrected(equations, point, step, direction, tolerance, off)
            if new is not None:
                break
            arc = step / 4
            if arc < SMALLEST_ARC:
                raise _LostError(path)
        point = new
        path.append(point)
        if len(path) > STEPS or point[0] < -1:  # all of the load reversed
            raise _LostError(path)
        if corrections < WANTED:
            arc = min(2 * arc, part * LARGEST_ARC)
    return path


def _corrected(
    equations: _Equations, point: Array, step: float, direction: Array, tolerance: float, off: float
) -> tuple[Array | None, int]:
    """The point of the path that lies a step ahead, or at s = 1; None if there is none near."""
    scales, target = equations.scales, point + step * direction
    new, corrections = _correct(equations, target, direction / scales**2, tolerance)
    if new is not None and new[0] + 1e-12 >= 1:  # arrived: land on s = 1
        target = point + (new - point) * ((1 - point[0]) / (new[0] - point[0]))
        target[0] = 1.0
        new, _ = _correct(equations, target, np.append(1.0, np.zeros(len(point) - 1)), tolerance)
    if new is None or np.linalg.norm((new - target) / scales) > off * step:  # it may be on another path
        return None, corrections
    return new, corrections


def _direction(slopes: _Slopes, before: Array, scales: Array) -> Array:
    """Unit tangent of the path, on the side of the direction before: F' t = 0."""
    still, row = np.zeros(len(before) - 1), before / scales**2
    t = slopes.solve(row, still, 1.0)
    if not np.isfinite(t).all():  # at a limit of the load: it moves what it pushes
        t = slopes.solve(row, still, 1.0, held=True)
    return np.asarray(t / np.linalg.norm(t / scales))


def _correct(equations: _Equations, target: Array, row: Array, tolerance: float) -> tuple[Array | None, int]:
    """Newton back to the path in the plane row · (x − target) = 0; None if it does not converge."""
    x, k, scales = target.copy(), 0, equations.scales
    while k < CORRECTIONS and np.isfinite(x).all() and np.linalg.norm((x - target) / scales) <= 100 * LARGEST_ARC:
        value, slopes = equations.with_slopes(x)
        change = slopes.solve(row, value, float(row @ (x - target)))
        x, k = x - change, k + 1
        if np.abs(change / scales).max() <= tolerance:
            return x, k
    return None, CORRECTIONS
