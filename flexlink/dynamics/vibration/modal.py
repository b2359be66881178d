"""Modes of small motion of a chain about a configuration.

    M δq̈ + (D + G) δq̇ + K δq = 0,        δq = φ exp(λt)

K is the tangent stiffness of T_GC + T_FL (elastic, gravity, load and centrifugal stiffness), G the gyroscopic matrix, D
the derivative of T_FR at rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Kind
from flexlink.chain.forces import refuse_states
from flexlink.chain.layout import Joints
from flexlink.chain.shapes import scaled
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.dynamics.forces import about, damping_matrix, damping_slope, linearised, turns_with_tip, world_wrench
from flexlink.dynamics.free_motion import DENSE, expanded, restricted
from flexlink.dynamics.loads import internal_loads
from flexlink.dynamics.placement import frames, hinge_bodies
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.rounding import largest_load_stiffness
from flexlink.dynamics.singularity import factored_mass, idle_error
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.tangent import LoadedState, displacements, gyroscopic_matrix, stiffness_matrix, tangent, unlocked
from flexlink.dynamics.tied_motion import tied_loads
from flexlink.dynamics.tied_tangent import TiedState, tied_state
from flexlink.dynamics.vibration import eigenproblem
from flexlink.dynamics.vibration.eigenproblem import lowest

# Classification of modes as elastic, pendulum, rigid or artificial by their energy.
#
#     E = φ* (k + |λ| d) φ          stored in springs, and dissipated by their dampers
#     P = |φ* (K − k) φ|            stored in gravity, tip wrench and rotation
#     F = |λ| Σ d |φ|²              dissipated in joints without springs
#     A = |λ|² Σ J |φ|²             kinetic energy of the inertias J that cells lend to the last segments of links
#
# A mode is artificial if A > (E + P + F)/2, otherwise elastic if E > P + F, otherwise a pendulum mode if loads restore
# it or make it unstable. All others are rigid: they have λ = 0, or friction brakes them. An overdamped mode of a beam
# is elastic, however fast it decays.


def mode_kinds(
    λ: Complex, φ: NDArray[np.inexact], P: Array, noise: Array, springs: Array, damping: Array, coupled: Array,
    lent: Array,
) -> tuple[tuple[str, ...], Array]:  # fmt: skip
    """Return the kind of every mode, and the elastic share of its energy, E / (E + P + F), shape (modes,).

    Mode shapes φ (modes, n), springs [N m/rad], derivatives of friction at rest [N m s/rad] and J of `lent` [kg m²],
    (n,), are those of the free coordinates; `noise` is the rounding error of P, and `coupled` what springs and dampers
    between two coordinates add to E, (modes,).
    """
    square, sprung = np.abs(φ) ** 2, springs > 0
    losses = np.abs(λ)[:, None] * damping * square
    E = square @ springs + losses @ sprung + coupled
    F = losses @ ~sprung
    moving, total = λ != 0, E + P + F  # if nothing moves, E is a rounding error
    share = np.where(moving, E / np.where(total > 0, total, 1.0), 0.0)
    names = np.where(share > 0.5, "elastic", np.where(moving & (P > F) & (noise < P), "pendulum", "rigid"))
    names = np.where(np.abs(λ) ** 2 * (square @ lent) > 0.5 * total, "artificial", names)
    return tuple(names.tolist()), share


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Modes(SavedResult):
    """Modes of small motion about a configuration, slowest first.

    Attributes
    ----------
    eigenvalues
        λ [1/s], shape (modes,): one of each conjugate pair, and each real λ; of real pairs ±λ without damping, λ > 0.
    shapes
        Mode shapes φ, shape (modes, n), with largest entry 1 and zeros for locked coordinates; complex if damping or
        rotation makes the joints move out of phase.
    paths
        Displacements of the body origins and the tip by φ, in frame 0, shape (modes, bodies, 3) [m].
    points
        Positions of the body origins and the tip in the configuration, in frame 0, shape (bodies, 3) [m].
    rounding
        Rounding error of each λ [1/s], shape (modes,); 0 if the sign of its real part is certain.
    kinds
        "elastic" if springs store most of a mode's energy, "pendulum" if gravity and loads do, "rigid" if it has no
        stiffness, "artificial" if most of its kinetic energy is in the last segment of a link with cells, as
        `Cells.tip` defines it: a mode of the discretisation, not of the arm.
    elastic_shares
        Share of the springs in the energy of each mode, shape (modes,), as in `mode_kinds`.
    """

    eigenvalues: Complex
    shapes: NDArray[np.inexact]
    paths: NDArray[np.inexact]
    points: Array
    rounding: Array
    kinds: tuple[str, ...]
    elastic_shares: Array

    def __repr__(self) -> str:
        listed = short_list([f"{f:.4g}" for f in self.hertz])
        return f"<Modes: {len(self.eigenvalues)} {'' if self.stable else 'un'}stable, {listed} Hz>"

    def _repr_html_(self) -> str:
        columns = (self.hertz, self.damping_ratios, self.eigenvalues.real, self.eigenvalues.imag)
        rows = list(zip(range(1, len(self.eigenvalues) + 1), *(c.tolist() for c in columns), strict=True))
        return html_table(repr(self), ("mode", "frequency [Hz]", "damping ratio", "Re λ [1/s]", "Im λ [1/s]"), rows)

    def plot(self, chain: Chain, *, count: int = 8, ax: Any = None) -> Any:
        """Draw the first `count` modes as displaced arms, one panel each; `chain` is the chain of these modes.

        Returns a matplotlib Figure, which a notebook displays; it is that of `ax`, axes to draw in, one for each mode,
        or a new one.

        Raises
        ------
        ArgumentError
            There are more or fewer axes than modes.
        MissingDependencyError
            matplotlib is not installed.

        Examples
        --------
        >>> picture = fl.modes(chain, q, locked=["upper", "fore"]).plot(chain, count=2)
        >>> picture.savefig("modes.png")
        """
        return drawing_module("results.plotting").plot_modes(self, chain, count, ax=ax)

    @property
    def frequencies(self) -> Array:
        """Natural angular frequencies |λ| [rad/s], shape (modes,); nan for aperiodic growth (real λ > 0)."""
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
        """ζ = −Re λ / |λ|, shape (modes,): 0 if undamped or λ = 0, 1 for aperiodic decay, negative for growth."""
        size = np.abs(self.eigenvalues)
        return 0.0 - self.eigenvalues.real / np.where(size > 0, size, 1.0)

    @property
    def stable(self) -> bool:
        """True if no mode grows: no Re λ exceeds its rounding error. A neutral joint, λ = 0, counts as stable."""
        return bool((self.eigenvalues.real <= self.rounding).all())


def modes(
    chain: Chain, q: ArrayLike | None = None, qd: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", locked: Joints = (), count: int | None = None, ties: Scene | None = None,
) -> Modes:  # fmt: skip
    """Modes of small motion about a configuration, which should be an equilibrium (`solve_static`).

    M δq̈ + (D + G) δq̇ + K δq = 0,  δq = φ exp(λt):  K = ∂(T_GC + T_FL)/∂q, G = ∂T_GC/∂q̇, D = ∂T_FR/∂q̇ at rest.
    In links with cells under strong tension, M has less of the inertia `Cells.tip` (see `relieved`).

    Parameters
    ----------
    chain
        The chain. Its gravity is included: it stiffens a hanging arm and softens an upright one.
    q
        Configuration [rad], shape (n,); default: springs slack, joints at zero.
    qd
        Rates of steady rotation [rad/s], shape (n,), for centrifugal stiffness and gyroscopic coupling. List a joint
        that turns at a constant rate Ω in `locked` as well, which keeps it at this rate.
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame;
        in the latter they turn with the tip.
    locked
        Coordinates that do not move, such as servo-held joints: names or sequential indices of joints, names of links,
        or a boolean mask, shape (n,). Prescribed joints are always locked.
    count
        Number of modes, slowest first; None: all. With more than 100 free coordinates a few modes are computed in O(n),
        as accurately as all modes unless damping or rotation couples them; then the relative error of λ is 1e-9.
    ties
        Scene whose ties hold the chain, at `initial.time`; None: the open chain. Exact ties restrict the motion, and
        their forces balance the other torques at q; springs have their stiffness, or none in their free range.

    Returns
    -------
    Modes
        Eigenvalues [1/s], mode shapes, paths [m], slowest first.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, `locked` names an unknown coordinate, or ties leave no motion.
    SceneError
        The scene contains something that ties do not allow.
    SingularMassError
        A coordinate has no inertia attached in this configuration.

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
    refuse_states(chain, "modes do not support it", ", lock the joint, or use the eigenvalues of linearize", free=free)
    few = None if count is None else integer("count", count, 1)
    state = LoadedState(q, rates, wrench, follower, free)
    tied, found = tied_state(ties, chain, state), None
    chain, lent = relieved(chain, q, rates, wrench, frame, tied)
    if few is not None and len(free) > DENSE and 3 * few < len(free) and chain.shapes is None and tied is None:
        found = _lowest(chain, state, few)
    (λ, vectors, rounding), load, entry = _all(chain, state, tied) if found is None else found
    λ, vectors, rounding = λ[:few], vectors[:, :few], rounding[:few]
    shapes = scaled(expanded(vectors, chain, free).T).T
    points = frames(chain, q).points
    springs, φ = linearised(chain, q), shapes[:, free]
    pairs, held = springs.couplings, springs.stiffness[free]
    together = 2 * (shapes[:, pairs["inner"]].conj() * shapes[:, pairs["outer"]]).real
    coupled = together @ pairs["stiffness"] + np.abs(λ) * (together @ pairs["damping"])
    coupled = coupled if tied is None else coupled + tied.energies(shapes, np.abs(λ))
    square = np.abs(held) + largest_load_stiffness(chain, rates, wrench)[free]
    noise = entry * (np.abs(φ) ** 2 @ np.where(square > 0, square, 1.0))
    P = np.abs(np.einsum("mi,mi->m", φ.conj(), load(shapes)))
    kinds, shares = mode_kinds(λ, φ, P, noise, held, damping_slope(chain)[free], coupled, lent[free])
    return Modes(λ, shapes, displacements(chain, q, shapes), points, rounding, kinds, shares)


Found = tuple[eigenproblem.Solution, Callable[[NDArray[np.inexact]], NDArray[np.inexact]], float]
"""Modes of the free coordinates, (K − k) φ as a function of mode shapes φ (modes, n), and the `rounding` of K."""


def _all(chain: Chain, state: LoadedState, tied: TiedState | None) -> Found:
    q, qd, _, _, free = state
    C = restricted(gyroscopic_matrix(chain, q, qd) + damping_matrix(chain), chain, free)
    M, L = factored_mass(chain, q, free)
    K = tangent(chain, *state)
    if tied is not None:
        M, L, C, K = tied.reduced(M, C, K, chain, free)

    def load(shapes: NDArray[np.inexact]) -> NDArray[np.inexact]:
        loads = stiffness_matrix(chain, *state[:4]) - about(chain, q).matrix("stiffness")
        loads = loads if tied is None else loads + tied.turning
        return shapes[:, free] @ loads[np.ix_(free, free)].T

    found = eigenproblem.solve(M, L, C, K)
    found = found if tied is None else found._replace(shapes=tied.Z @ found.shapes)
    return found, load, K.rounding


def _lowest(chain: Chain, state: LoadedState, count: int) -> Found | None:
    """Return the slowest modes; None if the iteration does not converge."""
    q, qd, wrench, _, free = state
    motion, sizes = SmallMotion(chain, *state), largest_load_stiffness(chain, qd, wrench)
    diagonal, moved = (part[free] for part in motion.inertias())
    idle = ~(moved > len(free) * np.finfo(float).eps * diagonal)
    if idle.any():
        raise idle_error(chain, int(free[np.flatnonzero(idle)[-1]]))
    found = lowest(chain, motion, sizes, count, bool(qd.any() or damping_slope(chain)[free].any()))
    if found is None:
        return None
    sprung = about(chain, q)

    def load(shapes: NDArray[np.inexact]) -> NDArray[np.inexact]:
        parts = np.vstack([shapes.real, shapes.imag])
        real, imaginary = np.split((motion.times(K_ALONE, parts) - sprung.times("stiffness", parts))[:, free], 2)
        return np.asarray(real + 1j * imaginary)

    return found._replace(shapes=found.shapes[free]), load, motion.rounding


def natural_frequencies(
    chain: Chain, q: ArrayLike | None = None, qd: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", locked: Joints = (),
) -> Array:  # fmt: skip
    """Natural angular frequencies, slowest first; nan for aperiodic growth.

    These are `modes(...).frequencies`.

    Parameters
    ----------
    chain
        The chain.
    q, qd
        Configuration [rad] and rates of steady rotation [rad/s], shape (n,), as in `modes`.
    tip_wrench, frame, locked
        Load on the tip, whether it turns with the tip, and locked coordinates, as in `modes`.

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


# The inertia that cells lend to the last segment of a link, and how much of it modes under tension can bear.
#
# The last segment of a beam with cells has its mass at its hinge, and would have no inertia: M would be singular. The
# segment before lends it J (`Cells.tip`). In plain bending the frequency √(k/J)/2π of this segment on its spring k is
# far above those of the arm. A tension N that straightens segments of length l more than k does, N l > k, raises all
# other frequencies but not this one, as N vanishes at the free end: it would be among those of the arm, and shift them.
# With
#
#     J k / (N l)        if N l > k, with the largest N of the link
#
# it stays above them, as in plain bending. The exact value is 0, so that the modes of the arm become more accurate.


def relieved(
    chain: Chain, q: Array, qd: Array, wrench: Array, frame: Frame, tied: TiedState | None = None
) -> tuple[Chain, Array]:
    """The chain with less lent inertia under the tension of a steady motion, and this inertia (n,) [kg m²]."""
    on, axis = hinge_bodies(chain), chain.hinges["axis"]
    lent = np.where((axis == 1) | (axis == 2), chain.described["lent"][on], 0.0)
    hinges = np.flatnonzero(lent)
    if not len(hinges):
        return chain, lent
    still = np.zeros(chain.n)
    tension = internal_loads(chain, q, qd, still, tip_wrench=wrench, frame=frame).N
    if tied is not None:
        at = world_wrench(chain, q, wrench, frame)[None]
        tension = tied_loads(tied.ties, chain, (q[None], qd[None], still[None]), at, tied.λ[None]).N[0]
    bodies, links = chain.bodies.copy(), np.array([c.link if c.kind is Kind.HINGE else 0 for c in chain.coordinates])
    for k in hinges.tolist():
        i, a, pull = on[k], axis[k], tension[on[links == links[k]]].max()
        held = pull * np.linalg.norm(bodies["translation"][i])
        freed = lent[k] * (1 - min(1.0, chain.stiffness[k] / held)) if held > 0 else 0.0
        lent[k] -= freed
        bodies["inertia"][i, a, a] -= freed
        bodies["inertia"][bodies["parent"][i] - 1, a, a] += freed
    return chain.with_numbers(bodies=bodies), lent
