"""Modes of small motion of a chain about a posture.

    M δq̈ + (D + G) δq̇ + K δq = 0,        δq = φ exp(λt)

K is the tangent of T_GC + T_FL (elastic, gravity, load and centrifugal stiffness), G the gyroscopic matrix, D the
slope of T_FR at rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain, Joints
from flexlink.chain.forces import refuse_states
from flexlink.common.errors import ArgumentError, SingularMassError
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list
from flexlink.describe.actions import Frame
from flexlink.dynamics.placement import frames
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.rounding import EPS, largest_load_stiffness
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.springs import about, damping_matrix, damping_slope
from flexlink.dynamics.tangent import displacements, gyroscopic_matrix, tangent, unlocked
from flexlink.dynamics.terms import mass_matrix
from flexlink.dynamics.vibration import eigenproblem
from flexlink.dynamics.vibration.lowest import lowest
from flexlink.dynamics.vibration.mode_kinds import Loads, Springs, mode_kinds
from flexlink.dynamics.wrench import turns_with_tip


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Modes(SavedResult):
    """Modes of small motion about a posture, slowest first.

    Attributes
    ----------
    eigenvalues
        λ [1/s], shape (modes,): one of each conjugate pair, and every real one that is not paired by symmetry.
    shapes
        φ, shape (modes, n): largest entry 1, zero on locked coordinates; complex where damping or rotation makes
        the joints move out of phase.
    paths
        Displacement of the body origins and the tip that goes with φ, frame 0, shape (modes, bodies, 3) [m].
    points
        Body origins and tip at the posture itself, frame 0, shape (bodies, 3) [m].
    rounding
        How far rounding may have moved each λ [1/s], shape (modes,); 0 where the sign of its real part is certain.
    kinds
        "elastic" if springs hold most of a mode's energy, "pendulum" if gravity and loads do, "rigid" if nothing holds
        it.
    elastic_shares
        Share of the springs in its energy, shape (modes,), as in `vibration.mode_kinds`.
    """

    eigenvalues: Complex
    shapes: NDArray[np.inexact]
    paths: NDArray[np.inexact]
    points: Array
    rounding: Array
    kinds: tuple[str, ...]
    elastic_shares: Array

    def __repr__(self) -> str:
        told = short_list([f"{f:.4g}" for f in self.hertz])
        return f"<Modes: {len(self.eigenvalues)} {'' if self.stable else 'un'}stable, {told} Hz>"

    def _repr_html_(self) -> str:
        columns = (self.hertz, self.damping_ratios, self.eigenvalues.real, self.eigenvalues.imag)
        rows = list(zip(range(1, len(self.eigenvalues) + 1), *(c.tolist() for c in columns), strict=True))
        return html_table(repr(self), ("mode", "frequency [Hz]", "damping ratio", "Re λ [1/s]", "Im λ [1/s]"), rows)

    def plot(self, chain: Chain, *, count: int = 8) -> Any:
        """Draw the first `count` modes as displaced arms, a panel each; `chain` is the one that they are of.

        Returns a matplotlib Figure, which a notebook shows once.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.

        Examples
        --------
        >>> picture = fl.modes(chain, q, locked=["upper", "fore"]).plot(chain, count=2)
        >>> picture.savefig("modes.png")
        """
        return drawing_module("results.plotting").plot_modes(self, chain, count)

    @property
    def frequencies(self) -> Array:
        """Natural angular frequencies |λ| [rad/s], shape (modes,); nan for a motion that just falls, λ real > 0."""
        λ = self.eigenvalues
        return np.where((λ.imag == 0) & (λ.real > 0), np.nan, np.abs(λ))

    @property
    def hertz(self) -> Array:
        """`frequencies` / 2π [Hz]."""
        return self.frequencies / (2 * np.pi)

    @property
    def first_elastic_hertz(self) -> float:
        """Lowest frequency of an elastic mode [Hz]; nan if there is none."""
        elastic = self.hertz[[kind == "elastic" for kind in self.kinds]]
        return float(elastic[0]) if len(elastic) else np.nan

    @property
    def damping_ratios(self) -> Array:
        """ζ = −Re λ / |λ|, shape (modes,): 0 undamped, 1 creeping back, negative growing; 0 for λ = 0."""
        size = np.abs(self.eigenvalues)
        return 0.0 - self.eigenvalues.real / np.where(size > 0, size, 1.0)

    @property
    def stable(self) -> bool:
        """Nothing grows: no Re λ > 0 that rounding does not explain; a neutral joint, λ = 0, does not."""
        return bool((self.eigenvalues.real <= self.rounding).all())


def modes(
    chain: Chain,
    q: ArrayLike | None = None,
    qd: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    locked: Joints = (),
    count: int | None = None,
) -> Modes:
    """Modes of small motion about a posture, which should be an equilibrium (`solve_static`).

    M δq̈ + (D + G) δq̇ + K δq = 0,  δq = φ exp(λt):  K = ∂(T_GC + T_FL)/∂q, G = ∂T_GC/∂q̇, D the slope of T_FR at rest.

    Parameters
    ----------
    chain
        The chain. Its gravity counts: hanging stiffens, standing softens.
    q
        Posture [rad], shape (n,); default: springs slack, joints at zero.
    qd
        Rates of steady rotation [rad/s], shape (n,), such as Ω on a joint that is also `locked` (held at that
        rate): centrifugal stiffness and gyroscopic coupling.
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame,
        with which they turn.
    locked
        Coordinates that do not move, such as servo-held joints: names or sequential indices of joints, names of links,
        or a boolean mask, shape (n,). Prescribed joints never do.
    count
        How many modes, the slowest ones; None: all. Of more than 100 free coordinates few modes are found in O(n), with
        the digits that they have among all, where neither damping nor rotation couples them; else λ to 1e-9 of itself.

    Returns
    -------
    Modes
        Eigenvalues [1/s], shapes, paths [m], slowest first.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    SingularMassError
        A coordinate moves no inertia of its own at this posture.

    Examples
    --------
    >>> found = fl.modes(chain, q, locked=["upper", "fore"])  # joints held
    >>> print(found.hertz[:2].round(2), found.kinds[0])
    [ 5.7  26.87] elastic
    """
    n, follower = require_type("chain", chain, Chain).n, turns_with_tip(frame)
    q = chain.rest.copy() if q is None else vector("q", q, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    wrench = wrench_vector(tip_wrench)
    free = unlocked(chain, locked)
    refuse_states(chain, "modes do not count it", ", lock the joint, or take the eigenvalues of linearize", free=free)
    few = None if count is None else integer("count", count, 1)
    small = _Small(chain, q, rates, wrench, follower, free)
    found = None
    if few is not None and len(free) > DENSE and 3 * few < len(free):
        found = _lowest(small, few)
    λ, vectors, rounding, loads = _all(small) if found is None else found
    λ, vectors, rounding = λ[:few], vectors[:, :few], rounding[:few]
    shapes = np.zeros((len(λ), n), dtype=vectors.dtype)
    shapes[:, free] = scaled(vectors).T
    points = frames(chain, q).points
    friction = damping_slope(chain)[free]
    own = Springs(chain.stiffness[free], friction, _coupled_energy(chain, λ, shapes))
    kinds, shares = mode_kinds(λ, shapes[:, free], loads(shapes), own)
    return Modes(λ, shapes, displacements(chain, q, shapes), points, rounding, kinds, shares)


EQUAL = 1e-6
"""Relative difference up to which two entries of a shape are as large: in symmetric arms only rounding tells them."""


def scaled(vectors: NDArray[np.inexact]) -> NDArray[np.inexact]:
    """Columns over their largest entry, the first of equal ones, so that rounding decides no sign."""
    sizes = np.abs(vectors)
    first = (sizes >= (1 - EQUAL) * sizes.max(axis=0)).argmax(axis=0)
    return np.asarray(vectors / vectors[first, np.arange(vectors.shape[1])])


DENSE = 100
"""Free coordinates up to which all modes are found, however few are asked for: by matrices, in O(n³)."""


class _Found(NamedTuple):
    """Modes, shapes of the free coordinates in columns, and what loads hold of shapes (modes, n)."""

    eigenvalues: Complex
    vectors: NDArray[np.inexact]
    rounding: Array
    loads: Callable[[NDArray[np.inexact]], Loads]


class _Small(NamedTuple):
    """A chain about a state."""

    chain: Chain
    q: Array
    qd: Array
    wrench: Array
    follower: bool
    free: NDArray[np.intp]


def _all(small: _Small) -> _Found:
    chain, q, qd, wrench, follower, free = small
    C = (gyroscopic_matrix(chain, q, qd) + damping_matrix(chain))[np.ix_(free, free)]
    M, L = factored_mass(chain, q, free)
    K = tangent(chain, q, qd, wrench, free, follower)

    def loads(shapes: NDArray[np.inexact]) -> Loads:
        springs = about(chain, q).matrix("stiffness")[np.ix_(free, free)]
        return Loads(shapes[:, free] @ (K.K - springs).T, K.S**2, K.rounding)

    return _Found(*eigenproblem.solve(M, L, C, K), loads)


def _lowest(small: _Small, count: int) -> _Found | None:
    """The slowest ones; None if the iteration does not find them."""
    chain, q, qd, wrench, follower, free = small
    locked = np.ones(chain.n, dtype=bool)
    locked[free] = False
    motion, sizes = SmallMotion(chain, q, qd, wrench, follower, locked), largest_load_stiffness(chain, qd, wrench)
    whole, own = (part[free] for part in motion.inertias())
    idle = ~(own > len(free) * np.finfo(float).eps * whole)
    if idle.any():
        raise _idle(chain, int(free[np.flatnonzero(idle)[-1]]))
    found = lowest(chain, motion, sizes, count, bool(qd.any() or damping_slope(chain)[free].any()))
    if found is None:
        return None
    sprung = about(chain, q)

    def loads(shapes: NDArray[np.inexact]) -> Loads:
        parts = np.vstack([shapes.real, shapes.imag])
        real, imaginary = np.split((motion.times(K_ALONE, parts) - sprung.times("stiffness", parts))[:, free], 2)
        square = chain.stiffness[free] + sizes[free]
        return Loads(real + 1j * imaginary, np.where(square > 0, square, 1.0), motion.rounding)

    return _Found(found.eigenvalues, found.shapes[free], found.rounding, loads)


def _coupled_energy(chain: Chain, λ: Complex, shapes: NDArray[np.inexact]) -> Array:
    """Σ 2 (K_ij + |λ| D_ij) Re φ̄_i φ_j of all couplings, for shapes (modes, n)."""
    pairs = chain.couplings
    together = 2 * (shapes[:, pairs["inner"]].conj() * shapes[:, pairs["outer"]]).real
    return np.asarray(together @ pairs["stiffness"] + np.abs(λ) * (together @ pairs["damping"]))


def natural_frequencies(
    chain: Chain,
    q: ArrayLike | None = None,
    qd: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    locked: Joints = (),
) -> Array:
    """Natural angular frequencies, slowest first, nan for a motion that just falls.

    They are `modes(...).frequencies`.

    Parameters
    ----------
    chain
        The chain.
    q, qd
        Posture [rad] and rates of steady rotation [rad/s], shape (n,), as in `modes`.
    tip_wrench, frame, locked
        Load on the tip, whether it turns with the tip, and coordinates that do not move, as in `modes`.

    Returns
    -------
    Array
        |λ| [rad/s], shape (modes,).

    Raises
    ------
    ArgumentError, SingularMassError
        As in `modes`.

    Examples
    --------
    >>> print(fl.natural_frequencies(chain, q, locked=["upper", "fore"])[:2].round(1))  # rad/s
    [ 35.8 168.8]
    """
    return modes(chain, q, qd, tip_wrench=tip_wrench, frame=frame, locked=locked).frequencies


def regular_mass(chain: Chain, q: Array, free: NDArray[np.intp]) -> Array:
    """M of `factored_mass`."""
    return factored_mass(chain, q, free)[0]


def factored_mass(chain: Chain, q: Array, free: NDArray[np.intp]) -> tuple[Array, Array]:
    """M of the free coordinates, of which each must move inertia of its own, and L of M = L Lᵀ.

    Cholesky's pivot is the inertia of a coordinate while those before it are free to give way; it must exceed the
    rounding of M, n eps M_ii. (The diagonal of Cholesky's factor holds the square roots of the pivots.) Close to that
    bound another way to the same factor may fail, so that L goes with M.

    Raises
    ------
    SingularMassError
        It does not, or M is beyond float64.
    """
    whole = mass_matrix(chain, q, algorithm="upper")  # in body axes: twist of a slender arm, straight, keeps its digits
    M = whole if len(free) == chain.n else np.ascontiguousarray(whole[np.ix_(free, free)])
    L, stopped = scipy.linalg.lapack.dpotrf(M, lower=1)
    with np.errstate(invalid="ignore"):
        good = L.diagonal() > np.sqrt(len(M) * EPS * M.diagonal())  # False for nan, too
    if stopped or not good.all():
        k = free[stopped - 1 if stopped else int(np.argmin(good))]
        raise _idle(chain, int(k))
    return M, np.asarray(L)


def _idle(chain: Chain, k: int) -> SingularMassError:
    return SingularMassError(
        f"{chain.name}: joint {chain.joint_name(k)!r} moves no inertia of its own at this posture, or one "
        "that overflows float64; M must be positive definite"
    )


def first_order_matrix(M: Array, C: Array, K: Array) -> Array:
    """A of d/dt (q, q̇) = A (q, q̇), shape (2n, 2n), with the factor of M that `factored_mass` found regular."""
    L, _ = scipy.linalg.lapack.dpotrf(M, lower=1)
    lower = [-scipy.linalg.cho_solve((L, True), right, check_finite=False) for right in (K, C)]
    A = np.block([[np.zeros_like(M), np.eye(len(M))], lower])
    if not np.isfinite(A).all():
        raise ArgumentError("stiffness, damping, loads or rates are so large that accelerations overflow float64")
    return A
