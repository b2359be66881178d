"""Bounds on the rounding errors of all terms, that is, on the difference between two correct programs.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

A number computed from terms of magnitude S is accurate to a few eps times S. S must not be the number itself, since
large terms cancel when an arm is balanced or stretched out. S is therefore a sum of magnitudes, which cannot cancel in
any configuration, axis or direction of gravity. With r_ik = |c_i − p_k|, the distance from hinge point k to centre of
mass i, and sums over the bodies i outboard of hinge k:

    M*   = max_k Σ_i (m_i r_ik (r_ik + |p_k|) + |I_i|) + max |armature|
    T_G* = max_k Σ_i m_i |g| (r_ik + |p_k|)                   ≥ |g| √Σ_a T_G(ê_a)², for gravity along a = x, y, z
    T_W* = max_k |f| (|p_tip − p_k| + |p_k|) + |m|            tip wrench (f, m)

(|p_k| enters because a point is only accurate to eps times its distance from the origin of frame 0: an arm mounted a
kilometre away loses digits.)

    |ΔM_jk|     ≤ ε M*
    |ΔT_GC|     ≤ ε (M* ω² + T_G* + T_W*)                     ω² = max_i |ω_i|²
    |M Δq̈|      ≤ ε (M* (Σ_k |q̈_k| + ω²) + T_G* + T_W* + max |T_EX, T_FL, T_FR|)
    |Δq̈|        ≤ ‖M⁻¹‖₂ times the bound of M Δq̈
    |ΔT_FL|_k   ≤ 10 eps (|K| |θ − θ₀|)_k
    |ΔT_FL|_k   ≤ 10 eps (|K| |θ − θ₀| + s² (1 + Θ*)² Σ |K| Θ)_k          rotation-vector springs
    |ΔT_FR|_k   ≤ 10 eps (|D| |q̇| + c |tanh(q̇ / w)|)_k

In these bounds ε = 10 √n eps: every hinge rotates axes and adds a lever with about ten roundings, which accumulate
along a chain like a random walk. A backward stable solver of M q̈ = b perturbs M and b by no more than their bounds,
from which the bound of M Δq̈ follows (Higham 2002, theorem 7.2). T_FL and T_FR are products at one joint, or sums of p
products in a cell: each product has two roundings, and tanh is accurate to four roundings.
For springs that act on rotation vectors φ, the error of φ is about 10 eps Θ s, where Θ is the sum of the three |θ − θ₀|
and s = ½|φ| / sin ½|φ|. The torques have the same relative error. They mix the three axes, hence Σ, and the derivative
of φ adds another factor s. In a cell the terms are cubic in φ, and Θ* is the largest Θ.
With ‖M‖ for M*, the bound of q̈ would be 10 √n eps κ₂(M) (|q̈| + |T| / ‖M‖ + ω²). But M* can be much larger than ‖M‖:
for a mast that turns about its own axis, M results from cancellation of larger terms.

Differences between Pinocchio, MuJoCo and flexlink were measured in random, balanced and stretched states, with
n = 1 … 239 and tip masses up to ten tons. They reach 0.32 times the bound of M, 0.19 times the bound of T_GC and 0.10
times the bound of M Δq̈, without a trend in n; T_FL and T_FR agree bit for bit.
"""

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import spans_of, sums_inward, sums_outward
from flexlink.common.memo import keep_last
from flexlink.common.types import Array
from flexlink.dynamics.forces import all_torques, has_potential, with_potential
from flexlink.dynamics.placement import hinge_bodies
from flexlink.kernels.bodies.mass import mass_composite
from flexlink.kernels.forces.rotation_springs import stretches
from flexlink.kernels.geometry.kinematics import arm_length, forward_kinematics

EPS = float(np.finfo(np.float64).eps)
ROUNDINGS = 10  # number of roundings at one hinge


def of_mass_matrix(chain: Chain, q: ArrayLike) -> float:
    """Rounding error of each element of M(q), ε M* [kg m²]."""
    return _along(chain) * _sizes(chain, vector("q", q, chain.n))[0]


def of_bias_torque(chain: Chain, q: ArrayLike, qd: ArrayLike, *, tip_wrench: ArrayLike | None = None) -> float:
    """Rounding error of each joint's T_GC, or T_G if q̇ = 0, ε (M* ω² + T_G* + T_W*) [N m]."""
    return _along(chain) * _inertial(chain, q, qd, np.zeros(chain.n), tip_wrench)


def of_elastic_torque(chain: Chain, q: ArrayLike) -> Array:
    """Rounding error of T_FL per joint, 10 eps |K| |θ − θ₀|, plus a term for rotation-vector springs, (n,) [N m]."""
    return ROUNDINGS * EPS * _elastic_size(chain, q)


def of_friction_torque(chain: Chain, qd: ArrayLike) -> Array:
    """Rounding error of T_FR per joint, 10 eps (|D| |q̇| + c |tanh(q̇ / w)|), shape (n,) [N m]."""
    return ROUNDINGS * EPS * _friction_size(chain, qd)


def of_residual(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> float:
    """Rounding error of each joint's torque M Δq̈ when the equation of motion is solved for q̈ [N m].

    It is ε (M* (Σ_k |q̈_k| + ω²) + T_G* + T_W* + max |T_EX, T_FL, T_FR|), T_FL and T_FR without cancellation. To
    compare two solutions, pass the larger q̈ of the two at every joint.
    """
    own = np.abs([vector("tau", tau, chain.n), _elastic_size(chain, q), _friction_size(chain, qd)]).max()
    return _along(chain) * float(_inertial(chain, q, qd, qdd, tip_wrench) + own)


def of_acceleration(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> float:
    """Rounding error of each joint's q̈ [rad/s²]: ‖M⁻¹‖₂ times `of_residual`; a test of M Δq̈ is sharper."""
    inverse = 1 / np.linalg.norm(_mass_matrix(chain, q), -2)  # −2: the smallest singular value
    return float(inverse * of_residual(chain, q, qd, qdd, tau, tip_wrench=tip_wrench))


def acceleration_error(
    chain: Chain, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, solutions: tuple[ArrayLike, ArrayLike],
    tip_wrench: ArrayLike | None = None,
) -> Array:  # fmt: skip
    """Difference of two solutions q̈ as |M Δq̈| / `of_residual`, shape (n,); rounding errors explain values ≤ 1."""
    one, other = (np.asarray(qdd, dtype=np.float64) for qdd in solutions)
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        return np.full(chain.n, np.nan)
    larger = np.maximum(np.abs(one), np.abs(other))
    error = _mass_matrix(chain, q) @ (one - other)
    explained: Array | float = of_residual(chain, q, qd, larger, tau, tip_wrench=tip_wrench)
    if chain.shapes is None:
        return in_units(error, explained)
    Φ, first, stop, *_ = chain.shapes
    units = in_units(Φ.T @ error, explained * np.abs(Φ).sum(axis=0))
    return np.array([units[begin:end].max() for begin, end in zip(first, stop, strict=True)])


def in_units(error: Array, explained: Array | float) -> Array:
    """|error| divided by its bound `explained`: 0 if there is no error, inf if the bound is 0 but the error is not."""
    size = np.abs(error)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(size == 0, 0.0, size / explained)


def _mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    M = np.zeros((chain.n, chain.n))
    mass_composite(chain.arrays, vector("q", q, chain.n, many=True), M)
    return M


def _elastic_size(chain: Chain, q: ArrayLike) -> Array:
    """|K| |θ − θ₀|, without cancellation between coupled springs, plus the terms of rotation vectors."""
    q = vector("q", q, chain.n, many=True)
    size = chain.times("stiffness", q - chain.rest, absolute=True)
    if has_potential(chain):
        size += np.abs(all_torques(with_potential(chain), q, np.zeros(chain.n)))
    if chain.has_rotation_springs:
        hinges, stretch = stretches(chain.bodies, chain.hinges, chain.couplings, q)
        Θ = np.abs(q - chain.rest)
        Θ[hinges] = Θ[hinges].sum(axis=1, keepdims=True)
        whole = chain.times("stiffness", Θ, absolute=True)[hinges].sum(axis=1)
        size[hinges] += ((stretch * (1 + Θ[hinges].max())) ** 2 * whole)[:, None]
    return size


def _friction_size(chain: Chain, qd: ArrayLike) -> Array:
    """|D| |q̇| + c |tanh(q̇ / w)|."""
    rates, hinges = vector("qd", qd, chain.n, many=True), chain.hinges
    dry = hinges["coulomb"] * np.abs(np.tanh(rates / hinges["coulomb_width"]))
    return np.asarray(chain.times("damping", rates, absolute=True) + dry)


def _along(chain: Chain) -> float:
    """ε = 10 √n eps, the relative rounding error accumulated along a chain of n hinges."""
    return ROUNDINGS * EPS * float(np.sqrt(chain.n))


def _inertial(chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tip_wrench: ArrayLike | None) -> float:
    """M* (Σ|q̈| + ω²) + T_G* + T_W*: magnitude of the terms in the recursive Newton-Euler algorithm."""
    inertia, weight, lever, axes = _sizes(chain, vector("q", q, chain.n))
    force = np.linalg.norm(wrench_vector(tip_wrench).reshape(2, 3), axis=1)
    rates, slides = vector("qd", qd, chain.n), chain.slides
    turned, own = rates[:, None] * axes, np.zeros((len(chain.bodies), 3))
    np.add.at(own, hinge_bodies(chain)[~slides], turned[~slides])
    # ω outboard of every hinge; for a tree, ω of every body
    spins = np.cumsum(turned, axis=0) if chain.is_serial_revolute else sums_outward(spans_of(chain.bodies), own)
    squares = (spins**2).sum(axis=1)
    turning = np.abs(vector("qdd", qdd, chain.n)).sum() + squares.max()
    if slides.any():  # Coriolis acceleration 2 ω × v of sliding joints
        turning += 2 * np.sqrt(squares.max()) * np.abs(rates[slides]).sum()
    return float(inertia * turning + weight + force[0] * lever + force[1])


@keep_last(64)  # all terms and all engines compared at a state use the same magnitudes
def _sizes(chain: Chain, q: Array) -> tuple[float, float, float, Array]:
    """M* [kg m²], T_G* [N m], the lever of a tip force [m], and the hinge axes (n, 3), in a configuration."""
    bodies, mass = chain.bodies, chain.bodies["mass"]
    rotations, points, axes = forward_kinematics(chain.arrays, q)
    centers = points + np.einsum("bij,bj->bi", rotations, bodies["center"])
    away = np.linalg.norm(points, axis=1)
    r = np.linalg.norm(centers - points[:, None], axis=2)  # r_ik, with hinge points in rows k and bodies in columns i
    levers = r + away[:, None]
    own = np.linalg.norm(bodies["inertia"], axis=(1, 2))
    inertia, moment = (np.triu(part).sum(axis=1).max() for part in (mass * r * levers + own, mass * levers))
    if chain.slides.any():  # sliding joints add rows for forces
        inertia, moment = max(inertia, moment, mass.sum()), max(moment, mass.sum())
    rotor = np.abs(chain.hinges["armature"]).max()
    tip = (np.linalg.norm(points[chain.loaded] - points, axis=1) + away).max()
    return float(inertia + rotor), float(moment * np.linalg.norm(chain.gravity)), float(tip), axes


# The following bounds are valid in all configurations: they assume that the arm is stretched out.


@keep_last(16)
def largest_loads(chain: Chain, qd: Array, wrench: Array) -> Array:
    """Magnitude of each hinge's load torque, shape (n,) [N m]: lever times weight with the arm stretched out.

    This magnitude bounds the torque in all configurations, since its terms cannot cancel. For sliding joints it is
    a force [N]. The result is read-only, and cached for all callers during a search for an equilibrium.
    """
    bodies, hinges = chain.bodies, chain.bodies["stop"] - chain.bodies["first"]
    Ω, V = np.abs(qd[~chain.slides]).sum(), np.abs(qd[chain.slides]).sum()
    spans = spans_of(chain.bodies)
    at = sums_outward(spans, chain.lengths)  # path length from the base to each body's hinges
    far = at + np.linalg.norm(bodies["center"], axis=1)
    force = bodies["mass"] * (np.linalg.norm(chain.gravity) + Ω**2 * far + 2 * Ω * V)
    moment = force * far + Ω**2 * np.linalg.norm(bodies["inertia"], axis=(1, 2))
    beyond_force, beyond_moment = (sums_inward(spans, part) for part in (force, moment))
    tip_force, tip_moment = (np.linalg.norm(part) for part in (wrench[:3], wrench[3:]))
    load = beyond_moment - at * beyond_force + np.maximum(at[chain.loaded] - at, 0.0) * tip_force + tip_moment
    load = np.asarray(np.repeat(np.maximum(load, 0.0), hinges))
    if chain.slides.any():
        load = np.where(chain.slides, np.repeat(beyond_force + tip_force, hinges), load)
    load.flags.writeable = False
    return load


def scales(chain: Chain) -> Array:
    """Unit of the change of each coordinate, shape (n,): 1 rad; for sliding joints the arm's length [m]."""
    return np.ones(chain.n) if not chain.slides.any() else np.where(chain.slides, arm_length(chain.bodies), 1.0)


def largest_load_stiffness(chain: Chain, qd: Array, wrench: Array) -> Array:
    """Magnitude of the terms in the diagonal of ∂T_GC/∂q, shape (n,) [N m/rad, N/m]: largest loads over `scales`."""
    return largest_loads(chain, qd, wrench) / scales(chain)


def of_loads(chain: Chain, qd: Array, wrench: Array) -> Array:
    """Rounding error of each T_GC in any configuration, (n,) [N m]: 8 eps of each load in each body."""
    return 8 * len(chain.bodies) * EPS * largest_loads(chain, qd, wrench)


def of_load_stiffness(chain: Chain) -> float:
    """Rounding error of ∂T_GC,i/∂q_j, relative to the `largest_loads` of joint i, for q_j in units of `scales`.

    A change of q_j changes force and moment, each with the same rounding error. So |δK_ij| ≤ 16 b eps · load_i, twice
    `of_loads`.
    """
    return 16 * len(chain.bodies) * EPS


def of_energy_balance(chain: Chain, energy: Array, work: Array, q: Array) -> Array:
    """Rounding error of E(t) − E(0) − W(t) per step [J], shape (samples,), from T, V_g, V_e (3, samples), W and q.

    A step rounds angles, rates and work to a relative eps, which changes the energies by a few eps. The error of the
    gravitational energy is eps |q| m g times the arm's size, whatever the point where that energy is zero.
    """
    weight = chain.weight * chain.size
    size = np.abs(energy).sum(axis=0) + np.abs(work) + weight * np.maximum(1.0, np.abs(q).max(axis=1))
    return np.asarray(4 * EPS * size)


def of_reach(reach: float, angle: float = 1.0) -> float:
    """Rounding error [m] of a position at distance `reach` from the origin, with hinge angles up to `angle` [rad]."""
    return ROUNDINGS * EPS * reach * max(angle, 1.0)
