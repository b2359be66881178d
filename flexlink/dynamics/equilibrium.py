"""Static equilibrium under gravity, tip wrench and drive torque, its stability and buckling; sequences of postures."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import positive, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import Joints
from flexlink.chain.shapes import on_shapes
from flexlink.common.errors import ConvergenceError
from flexlink.common.memo import keep_last
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.forces import about, linearised, turns_with_tip
from flexlink.dynamics.free_motion import DENSE, basis, restricted
from flexlink.dynamics.load_path import Equations, LostError, equations_of, follow
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.tangent import LoadedState, load_torque, stiffness_matrix, unlocked
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.tied_motion import ByTie, tie_forces
from flexlink.dynamics.tied_tangent import tied_equilibrium, tied_state
from flexlink.dynamics.ties import Ties, tie_rows
from flexlink.kernels.derivatives.static_continuation import follow_equilibria


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(SavedResult):
    """A configuration in which all torques balance."""

    q: Array  # angles [rad], (n,)
    # T_EX there, (n,) [N m]: the holding torque T_GC + T_FL of locked and prescribed coordinates, the given torque of
    # all others; `linearize(chain, rest.q, tau=rest.tau)` then has ẋ = 0
    tau: Array
    residual: float  # largest residual torque on a coordinate that is not locked [N m]
    # whether no eigenvalue of the tangent stiffness has a negative real part beyond rounding error, neutral ones aside
    # (flutter under a follower wrench is not detected here, but by `modes`)
    stable: bool
    path: Array  # points (s, q) of all steps, (steps, 1 + n); s is the load factor
    slides: NDArray[np.bool_]  # mask of the sliding joints, (n,)
    tie_names: tuple[str, ...] = ()  # name of the tie of each value, and the value, of `tie_forces`
    tie_values: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def tie_forces(self) -> ByTie:
        """Forces of ties by name [N, N m], with the signs of `Trajectory.tie_forces`: a number, or shape (3,)."""
        names = np.array(self.tie_names)
        return ByTie((name, self.tie_values[names == name].squeeze()) for name in dict.fromkeys(self.tie_names))

    def __repr__(self) -> str:
        turned, slid = (np.abs(self.q[which]).max(initial=0.0) for which in (~self.slides, self.slides))
        out = [f"angles up to {np.degrees(turned):.4g}°"] if not self.slides.all() else []
        out += [f"positions up to {slid:.4g} m"] if self.slides.any() else []
        joints = plural(len(self.q), "joint")
        return (
            f"<Equilibrium: {'' if self.stable else 'un'}stable; {joints} at {' and '.join(out)}, "
            f"residual {self.residual:.2g} N m>"
        )


def solve_static(
    chain: Chain, q: ArrayLike | None = None, qd: ArrayLike | None = None, tau: ArrayLike | None = None, *,
    tip_wrench: ArrayLike | None = None, frame: Frame = "world", locked: Joints = (), tolerance: float = 1e-9,
    ties: Scene | None = None,
) -> Equilibrium:  # fmt: skip
    """Configuration in which gravity, springs, tip wrench and drive torque balance: T_GC(q, q̇) + T_FL(q) = T_EX.

    The load is increased along the equilibrium path by an arc-length Newton method (Riks 1979; Crisfield 1981).

    Parameters
    ----------
    chain, q
        The chain; initial configuration [rad], shape (n,); default: springs slack, joints at zero. Locked joints remain
        there.
    qd
        Constant rates [rad/s], shape (n,), for the relative equilibrium of a steadily rotating arm.
    tau
        Drive torque T_EX [N m], shape (n,).
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame;
        in the latter they turn with the tip.
    locked
        Coordinates that do not move: names or sequential indices of joints, names of links, or a boolean mask,
        shape (n,).
    tolerance
        Newton's method ends when its largest correction is below this value [rad], for sliding joints relative to the
        arm's length. The remaining error is of the order of this correction squared, or of rounding errors.
    ties
        Scene whose ties hold the chain, at `initial.time`; None: the open chain. With ties Newton's method under the
        full load closes them, to rounding errors, and goes on to the next stable equilibrium.

    Returns
    -------
    Equilibrium
        The configuration [rad], whether it is stable, and the path to it.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names an unknown coordinate.
    SceneError
        The scene contains something that ties do not allow.
    ConvergenceError
        The path from q does not reach the full load. The error contains the configuration at the largest load reached.

    Examples
    --------
    >>> rest = fl.solve_static(chain, q, locked=["upper", "fore"])
    >>> print(rest.stable, rest.tau[chain.active].round(2))  # N m; holding torques
    True [77.6  30.31]
    """
    n = require_type("chain", chain, Chain).n
    follower, tolerance = turns_with_tip(frame), positive("tolerance", tolerance)
    start = chain.rest.copy() if q is None else vector("q", q, n).copy()
    wrench = wrench_vector(tip_wrench)
    drive = np.zeros(n) if tau is None else vector("tau", tau, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    free = unlocked(chain, locked)
    on_shapes(chain, "q", start - chain.rest)
    state = LoadedState(start, rates, wrench, follower, free)
    if ties is not None and (rows := tie_rows(ties, chain)) is not None:
        return _tied(ties, rows, chain, state, frame, drive)
    equations = equations_of(chain, state, drive)
    posture, path = at_rest(equations, tolerance)
    end = np.append(1.0, posture) if chain.shapes is None else path[-1]
    holding = load_torque(chain, posture, rates, wrench, follower) + elastic_torque(chain, posture)
    holding[free] = drive[free]
    return Equilibrium(
        posture, holding, float(np.abs(equations.value(end)).max()), not equations.falls(end),
        np.array([np.append(x[0], equations.posture(x)) for x in path]), chain.slides,
    )  # fmt: skip


def _tied(scene: Scene, rows: Ties, chain: Chain, state: LoadedState, frame: Frame, drive: Array) -> Equilibrium:
    """The `solve_static` of a chain with ties."""
    q, qd, wrench, follower, free = state
    locked = np.setdiff1d(np.arange(chain.n), free)
    q = tied_equilibrium(rows, chain, q, locked, wrench, frame, scene.initial.time, drive)
    tied = tied_state(scene, chain, state._replace(q=q), drive, moves=False)
    assert tied is not None
    holding = load_torque(chain, q, qd, wrench, follower) + elastic_torque(chain, q) + tied.J.T @ tied.λ
    left = basis(chain, free).T @ (holding - drive)
    holding[free] = drive[free]
    forces = tie_forces(scene, rows, tied.λ[None])
    names = tuple(name for name, force in forces.items() for _ in range(force[0].size))
    values = np.concatenate([force.ravel() for force in forces.values()])
    path = np.append(1.0, q)[None]
    return Equilibrium(q, holding, float(np.abs(left).max()), True, path, chain.slides, names, values)


def at_rest(equations: Equations, tolerance: float = 1e-9) -> tuple[Array, list[Array]]:
    """Return the configuration at the equilibrium and the path to it; errors and tolerance as in `solve_static`."""
    chain, (_, rates, wrench, _, free) = equations.chain, equations.acting
    try:
        path = follow(equations, tolerance)
    except LostError as lost:
        hint = "; to hold free joints set locked=chain.active" if len(np.intersect1d(chain.active, free)) else ""
        left = np.abs(equations.value(np.append(1.0, lost.point[1:]))).max()
        reached = f"{lost.steps} steps from q reached {lost.part:.6g} of the load"
        remain = f"under the full load {left:.3g} N m remain unbalanced{hint}"
        why, last = f"solve_static: no equilibrium found; {reached}; {remain}", equations.posture(lost.point)
        raise ConvergenceError(why, q=last, load=lost.part, id="no-equilibrium") from None
    posture = equations.posture(path[-1]).copy()
    if chain.shapes is None:  # rounded angles are no sum of shapes
        for i, decimals in known_decimals(chain, posture, free, rates, wrench):
            posture[i] = chain.rest[i] + round(float(posture[i] - chain.rest[i]), decimals)
    return posture, path


def known_decimals(chain: Chain, q: Array, free: NDArray[np.intp], qd: Array, wrench: Array) -> list[tuple[int, int]]:
    """Indices of the springs, each with the decimals that the rounding error ΔL of its load leaves in its deflection.

    Decimals below ΔL / Σ_j |K_ij| are meaningless and differ between CPUs. Without them, no torque changes by more than
    its rounding error, and an angle that is 0 by symmetry becomes 0.
    """
    open_ = rounding.of_loads(chain, qd, wrench)
    sprung = free[(chain.stiffness[free] > 0) & (open_[free] > 0)]
    k = linearised(chain, q).times("stiffness", np.ones(chain.n), absolute=True)
    return [(i, math.ceil(math.log10(min(k[i] / open_[i], 1e300)))) for i in sprung.tolist()]


def static_posture(chain: Chain, q: Array, wrench: Array, frame: Frame) -> Array:
    """Equilibrium (n,) of a chain with its driven joints held at their angles in q; errors as in `solve_static`."""
    return _static_posture(chain, q, wrench, frame).copy()


@keep_last(64)  # runs of one scene share it when they start
def _static_posture(chain: Chain, q: Array, wrench: Array, frame: Frame) -> Array:
    free = unlocked(chain, chain.active.tolist())
    state = LoadedState(q.copy(), np.zeros(chain.n), wrench, turns_with_tip(frame), free)
    posture, _ = at_rest(equations_of(chain, state, np.zeros(chain.n)))
    return posture


def static_postures(chain: Chain, angles: Array) -> Array:
    """Equilibria (rows, n) under gravity with driven joints held at angles (rows, driven) [rad], each from the last."""
    held, q, postures = chain.active, chain.rest.copy(), np.zeros((len(angles), chain.n))
    free, found = unlocked(chain, held.tolist()), 0
    while found < len(angles):
        q[held] = angles[found]
        q = postures[found] = static_posture(chain, q, np.zeros(6), "world")
        found += 1
        if chain.n <= DENSE and chain.shapes is None:
            found += follow_equilibria(chain.arrays, held, free, angles[found:], q.copy(), postures[found:])
            q = postures[found - 1].copy()
    if chain.shapes is None:
        for i, decimals in known_decimals(chain, q, free, np.zeros(chain.n), np.zeros(6)):
            bent = postures[:, i] - chain.rest[i]
            postures[:, i] = chain.rest[i] + [round(each, decimals) for each in bent.tolist()]
    return postures


def buckling_loads(
    chain: Chain, q: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None, locked: Joints = (),
    ties: Scene | None = None,
) -> Array:  # fmt: skip
    """Load factors at which the arm can buckle: multiples of gravity and tip wrench together (dimensionless).

    At a buckling load, K_elastic + s K_load(q) is singular; q is fixed, and joints without springs are locked, unless
    ties move them. Springs of ties are in K_elastic, forces of ties in K_load.
    Only real positive s are returned; there are none if the loads do not reduce the stiffness.

    Parameters
    ----------
    chain, q
        The chain; configuration [rad], shape (n,); default: springs slack, joints at zero.
    tip_wrench
        Force and moment on the tip [N, N m], shape (6,), axes of frame 0.
    locked
        Coordinates that do not move, as in `solve_static`.
    ties
        Scene whose ties hold the chain, as in `modes`; None: the open chain.

    Returns
    -------
    Array
        Factors s, in ascending order.

    Raises
    ------
    ArgumentError, SceneError
        An argument has the wrong shape or is not finite, `locked` names an unknown coordinate, or ties do not allow it.

    Examples
    --------
    >>> standing = np.where(np.arange(chain.n) == 0, np.pi / 2, 0.0)  # rad; upright
    >>> factors = fl.strength.buckling_loads(chain, standing, locked=["upper", "fore"])
    >>> print(factors[0].round(1))  # multiple of its weight and load
    140.9
    """
    n = require_type("chain", chain, Chain).n
    q = chain.rest.copy() if q is None else vector("q", q, n)
    wrench, free = wrench_vector(tip_wrench), unlocked(chain, locked)
    elastic, still = about(chain, q), np.zeros(n)
    K, load = elastic.matrix("stiffness"), stiffness_matrix(chain, q, still, wrench)
    tied = tied_state(ties, chain, LoadedState(q, still, wrench, False, free), moves=False)
    if tied is None:
        sprung = free[(chain.stiffness[free] > 0) | (elastic.stiffness[free] > 0)]
        K, load = (restricted(part, chain, sprung) for part in (K, load))
    else:
        parts = K + tied.stiffness - tied.turning, load + tied.stiffness
        K, load = (tied.Z.T @ restricted(part, chain, free) @ tied.Z for part in parts)
        sprung = np.flatnonzero(K.diagonal() > 1e-12 * K.diagonal().max(initial=0.0))
        K, load = (part[np.ix_(sprung, sprung)] for part in (K, load))
    load = load - K
    diagonal = not elastic.springs_join_hinges and chain.shapes is None and tied is None
    inverse = scipy.linalg.eigvals(-_per_stiffness(load, K, diagonal=diagonal))  # 1/s
    rounding = len(K) * np.finfo(float).eps * np.abs(inverse).max(initial=0.0)
    softening = inverse.real > rounding
    real = np.abs(inverse.imag) <= np.sqrt(np.finfo(float).eps) * np.abs(inverse)  # double eigenvalues are less exact
    return np.asarray(np.sort(1 / inverse.real[softening & real]))


def _per_stiffness(load: Array, K: Array, *, diagonal: bool) -> Array:
    """Return L⁻¹ A L⁻ᵀ for A = `load` and K = L Lᵀ; it has the eigenvalues of K⁻¹ A. `diagonal`: if K is diagonal.

    If K is not positive definite, which can occur for rotation-vector springs at large angles, return K⁻¹ A.
    """
    if diagonal:
        k = K.diagonal()
        return np.asarray(load / np.sqrt(np.outer(k, k)))
    try:
        L = scipy.linalg.cholesky(K, lower=True)
    except scipy.linalg.LinAlgError:
        return np.asarray(scipy.linalg.solve(K, load))
    half = scipy.linalg.solve_triangular(L, load, lower=True)
    return np.asarray(scipy.linalg.solve_triangular(L, half.T, lower=True).T)
