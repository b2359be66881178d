"""What rounding explains: how far apart two right programs may be, term by term, and no further.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

A number that is computed from parts of size S is known to a few eps S. S must not be the number itself: large parts
cancel where an arm is balanced or stretched out. So S is made of sizes that no posture, axis or direction of gravity
can cancel, with r_ik = |c_i − p_k| from hinge point to centre of mass, over the bodies i beyond hinge k:

    M*   = max_k Σ_i (m_i r_ik (r_ik + |p_k|) + |I_i|) + max |armature|
    T_G* = max_k Σ_i m_i |g| (r_ik + |p_k|)                   ≥ |g| √Σ_a T_G(ê_a)², gravity along a = x, y, z
    T_W* = max_k |f| (|p_tip − p_k| + |p_k|) + |m|            tip wrench (f, m)

(|p_k| because a point is known to eps of its distance from frame 0: an arm mounted a kilometre away has fewer digits.)

    |ΔM_jk|     ≤ ε M*
    |ΔT_GC|     ≤ ε (M* ω² + T_G* + T_W*)                     ω² = max_i |ω_i|²
    |M Δq̈|      ≤ ε (M* (Σ_k |q̈_k| + ω²) + T_G* + T_W* + max |T_EX, T_FL, T_FR|)
    |Δq̈|        ≤ ‖M⁻¹‖₂ times that
    |ΔT_FL|_k   ≤ 10 eps (|K| |θ − θ₀|)_k
    |ΔT_FL|_k   ≤ 10 eps (|K| |θ − θ₀| + s² (1 + Θ*)² Σ |K| Θ)_k          springs of rotation vectors
    |ΔT_FR|_k   ≤ 10 eps (|D| |q̇| + c |tanh(q̇ / w)|)_k

ε = 10 √n eps: every hinge turns axes and adds a lever, about ten roundings; along a chain they add like a random walk.
A backward stable solver of M q̈ = b changes M and b by no more than the same, hence M Δq̈ (Higham 2002, theorem 7.2).
T_FL and T_FR are products at one joint, or sums of p of them in a cell: two roundings each, and a tanh good to four.
Springs of a rotation vector φ know it to about ten eps of Θ, the sum of the three |θ − θ₀|, times s = ½|φ| / sin ½|φ|,
and so their torques, which the three axes mix: Σ is over them, and s once more what the slope of φ does. Of a cell,
whose terms go up to the cube of φ, Θ* is the largest Θ.
With ‖M‖ for M* the bound of q̈ reads 10 √n eps κ₂(M) (|q̈| + |T| / ‖M‖ + ω²); but of a mast that turns about its own
axis M, too, is what cancelling leaves of M*.

Measured, Pinocchio and MuJoCo against ours at random, balanced and stretched states, n = 1 … 239, tip masses up to ten
tons: at most 0.32 of it in M, 0.19 in T_GC, 0.10 in M Δq̈, without a trend in n; T_FL and T_FR agree to the bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.spans import spans_of, sums_inward, sums_outward
from flexlink.common.memo import keep_last
from flexlink.common.types import Array
from flexlink.dynamics.placement import hinge_bodies
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.forces.rotation_springs import stretches
from flexlink.kernels.geometry.kinematics import arm_length, forward_kinematics

EPS = float(np.finfo(np.float64).eps)
ROUNDINGS = 10
"""At one hinge."""


def of_mass_matrix(chain: Chain, q: ArrayLike) -> float:
    """Of every element of M(q), ε M* [kg m²]."""
    inertia, *_ = _sizes(chain, q)
    return _along(chain) * inertia


def of_bias_torque(chain: Chain, q: ArrayLike, qd: ArrayLike, *, tip_wrench: ArrayLike | None = None) -> float:
    """Of every joint's T_GC, or T_G where q̇ = 0, ε (M* ω² + T_G* + T_W*) [N m]."""
    return _along(chain) * _inertial(chain, q, qd, np.zeros(chain.n), tip_wrench)


def of_elastic_torque(chain: Chain, q: ArrayLike) -> Array:
    """Of T_FL, joint by joint, 10 eps |K| |θ − θ₀|, shape (n,) [N m]; of rotation vectors what stands above."""
    return ROUNDINGS * EPS * _elastic_size(chain, q)


def of_friction_torque(chain: Chain, qd: ArrayLike) -> Array:
    """Of T_FR, joint by joint, 10 eps (|D| |q̇| + c |tanh(q̇ / w)|), shape (n,) [N m]."""
    return ROUNDINGS * EPS * _friction_size(chain, qd)


def of_residual(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> float:
    """Of every joint's torque M Δq̈ when the equation of motion is solved for q̈ [N m].

    Parameters
    ----------
    chain
        The chain.
    q, qd, qdd, tau
        Angles [rad], rates [rad/s], accelerations [rad/s²] and drive torques [N m], shape (n,); of two solutions, the
        larger one at every joint.
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Returns
    -------
    float
        ε (M* (Σ_k |q̈_k| + ω²) + T_G* + T_W* + max |T_EX, T_FL, T_FR|), T_FL as |K| |θ − θ₀|, T_FR likewise.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite.
    """
    own = np.abs([vector("tau", tau, chain.n), _elastic_size(chain, q), _friction_size(chain, qd)]).max()
    return _along(chain) * float(_inertial(chain, q, qd, qdd, tip_wrench) + own)


def of_acceleration(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> float:
    """Of every joint's q̈ [rad/s²], ‖M⁻¹‖₂ times `of_residual`, which is the sharper statement where both will do."""
    inverse = 1 / np.linalg.norm(mass_matrix(chain, q), -2)  # −2: the smallest singular value
    return float(inverse * of_residual(chain, q, qd, qdd, tau, tip_wrench=tip_wrench))


def acceleration_error(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    tau: ArrayLike,
    *,
    solutions: tuple[ArrayLike, ArrayLike],
    tip_wrench: ArrayLike | None = None,
) -> Array:
    """How far two solutions q̈ are apart, |M Δq̈| / `of_residual`, shape (n,): rounding explains up to 1."""
    one, other = (np.asarray(qdd, dtype=np.float64) for qdd in solutions)
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        return np.full(chain.n, np.nan)
    larger = np.maximum(np.abs(one), np.abs(other))
    return in_units(
        mass_matrix(chain, q) @ (one - other), of_residual(chain, q, qd, larger, tau, tip_wrench=tip_wrench)
    )


def in_units(error: Array, explained: Array | float) -> Array:
    """|error| in units of what rounding explains: 0 where there is none, inf where nothing is explained."""
    size = np.abs(error)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(size == 0, 0.0, size / explained)


def _elastic_size(chain: Chain, q: ArrayLike) -> Array:
    """|K| |θ − θ₀|, of which the torques of coupled springs may be less, and what rotation vectors add."""
    q = vector("q", q, chain.n, many=True)
    size = chain.times("stiffness", q - chain.rest, absolute=True)
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
    """ε: what the roundings along a chain of n hinges come to."""
    return ROUNDINGS * EPS * float(np.sqrt(chain.n))


def _inertial(chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, tip_wrench: ArrayLike | None) -> float:
    """M* (Σ|q̈| + ω²) + T_G* + T_W*: size of the parts that recursive Newton-Euler adds up."""
    inertia, weight, lever, axes = _sizes(chain, q)
    force = np.linalg.norm(wrench_vector(tip_wrench).reshape(2, 3), axis=1)
    rates, slides = vector("qd", qd, chain.n), chain.slides
    squares = (_spins(chain, rates[:, None] * axes) ** 2).sum(axis=1)
    turning = np.abs(vector("qdd", qdd, chain.n)).sum() + squares.max()
    if slides.any():  # 2 ω × v
        turning += 2 * np.sqrt(squares.max()) * np.abs(rates[slides]).sum()
    return float(inertia * turning + weight + force[0] * lever + force[1])


def _spins(chain: Chain, turned: Array) -> Array:
    """ω behind every hinge that turns so much, (n, 3), or, of a tree, in every body."""
    if chain.is_serial_revolute:
        return np.cumsum(turned, axis=0)
    own = np.zeros((len(chain.bodies), 3))
    np.add.at(own, hinge_bodies(chain)[~chain.slides], turned[~chain.slides])
    return sums_outward(spans_of(chain.bodies), own)


def _sizes(chain: Chain, q: ArrayLike) -> tuple[float, float, float, Array]:
    """M* [kg m²], T_G* [N m], the lever of a force on the tip [m], and the hinge axes (n, 3), at a posture."""
    return _sizes_at(chain, vector("q", q, chain.n).tobytes())


@keep_last(64)  # every term that is compared at a state, of every engine, asks for the same
def _sizes_at(chain: Chain, q: bytes) -> tuple[float, float, float, Array]:
    bodies, mass = chain.bodies, chain.bodies["mass"]
    rotations, points, axes = forward_kinematics(chain.arrays, np.frombuffer(q).copy())
    centers = points + np.einsum("bij,bj->bi", rotations, bodies["center"])
    away = np.linalg.norm(points, axis=1)
    r = np.linalg.norm(centers - points[:, None], axis=2)  # hinge k, body i
    levers = r + away[:, None]
    own = np.linalg.norm(bodies["inertia"], axis=(1, 2))
    inertia, moment = (np.triu(part).sum(axis=1).max() for part in (mass * r * levers + own, mass * levers))
    if chain.slides.any():  # forces, too
        inertia, moment = max(inertia, moment, mass.sum()), max(moment, mass.sum())
    rotor = np.abs(chain.hinges["armature"]).max()
    tip = (np.linalg.norm(points[chain.loaded] - points, axis=1) + away).max()
    return float(inertia + rotor), float(moment * np.linalg.norm(chain.gravity)), float(tip), axes


# Of many postures at once: of arms stretched out, whose sizes no posture exceeds.


def largest_loads(chain: Chain, qd: Array, wrench: Array) -> Array:
    """What the load torque of each hinge is made of, shape (n,) [N m]: lever times weight with the arm stretched out.

    Unlike the torque itself it cannot cancel, and it holds for all postures at once. Of joints that slide weight [N].
    Found once for all who ask for it on their way to an equilibrium; read-only.
    """
    return _largest_loads(chain, qd.tobytes(), wrench.tobytes())


@keep_last(16)
def _largest_loads(chain: Chain, rates: bytes, acting: bytes) -> Array:
    qd, wrench = np.frombuffer(rates), np.frombuffer(acting)
    bodies, hinges = chain.bodies, chain.bodies["stop"] - chain.bodies["first"]
    Ω, V = np.abs(qd[~chain.slides]).sum(), np.abs(qd[chain.slides]).sum()
    spans = spans_of(chain.bodies)
    at = sums_outward(spans, chain.lengths)  # way from the base to each body's hinges
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
    """What changes of the coordinates compare with, shape (n,): 1 rad, of joints that slide the arm's length [m]."""
    if not chain.slides.any():
        return np.ones(chain.n)
    return np.where(chain.slides, arm_length(chain.bodies), 1.0)


def largest_load_stiffness(chain: Chain, qd: Array, wrench: Array) -> Array:
    """What the diagonal of ∂T_GC/∂q is made of, shape (n,) [N m/rad, N/m]: the largest loads for such changes."""
    return largest_loads(chain, qd, wrench) / scales(chain)


def of_loads(chain: Chain, qd: Array, wrench: Array) -> Array:
    """Of T_GC,i, whatever the posture, shape (n,) [N m].

    A torque of the loads passes one rotation and one sum in each of b bodies, 8 eps of what it is made of.
    """
    return 8 * len(chain.bodies) * EPS * largest_loads(chain, qd, wrench)


def of_load_stiffness(chain: Chain) -> float:
    """Of ∂T_GC,i/∂q_j, as a part of `largest_loads` of i, for changes by `scales` of j.

    A change of q_j changes force and moment, each rounded as they are: twice `of_loads`, |δK_ij| ≤ 16 b eps · load_i.
    """
    return 16 * len(chain.bodies) * EPS


def of_energy_balance(chain: Chain, energy: Array, work: Array, q: Array) -> Array:
    """Of E(t) − E(0) − W(t) in one step [J], shape (samples,), from T, V_g, V_e (3, samples), W and q (samples, n).

    A step rounds angles, rates and work to eps of themselves, which changes the energies by a few eps of themselves;
    gravity's by eps |q| m g times the arm's size, wherever its zero lies.
    """
    weight = chain.weight * chain.size
    size = np.abs(energy).sum(axis=0) + np.abs(work) + weight * np.maximum(1.0, np.abs(q).max(axis=1))
    return np.asarray(4 * EPS * size)


def of_position(chain: Chain) -> float:
    """Of where a step puts the tip [m], 10 eps of the arm's size."""
    return of_reach(chain.size)


def of_reach(reach: float, angle: float = 1.0) -> float:
    """Of a place at this distance from the origin [m], where a hinge stands at this angle [rad], rounded itself."""
    return ROUNDINGS * EPS * reach * max(angle, 1.0)
