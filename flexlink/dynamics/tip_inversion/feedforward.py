"""Bounded inverse dynamics of a flexible arm: a boundary-value problem in time, solved by Newton's method.

The equations at equally spaced times are the tip's position and the balance of torques at every spring:

    J_a⁺ (tip(q) − path) = 0        T_p(q, q̇, q̈) = 0        q at rest before the first and after the last time

Boundary values at both ends make the solution bounded: unstable zeros are integrated backwards (Devasia, Chen & Paden
1996; in the frequency domain Bayo 1987). Derivatives are central differences of order 6; each correction solves the
equations linearized about the motion, with differences of order 2 (defect correction).
"""

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from flexlink.chain.chain import Chain
from flexlink.common.errors import ConvergenceError, FlexlinkError, SceneError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.terms import mass_matrix
from flexlink.dynamics.tip_inversion.moves import TipMove, postures_at

DIFFERENCES = np.array([[-3, 27, -135, 0, 135, -27, 3], [2, -27, 270, -490, 270, -27, 2]]) / 180
"""Central differences of order 6 for q̇ and q̈, in units of the spacing, shape (2, 7)."""


class TipPath(NamedTuple):
    """Positions of the tip (m, 3) [m] every `spacing` [s] from rest to rest, and the arm at rest there (m, n)."""

    spacing: float
    postures: Array
    tips: Array
    wrench: Array


class InverseMotion(NamedTuple):
    """Motion q, q̇, q̈ (m, n), drive torques (m, d) [N m], and the last correction of the range, inf if it grew."""

    q: Array
    qd: Array
    qdd: Array
    torques: Array
    correction: float


def inverse_motion(chain: Chain, path: TipPath) -> InverseMotion:
    """Find the bounded motion whose tip follows a path, from the postures at rest."""
    aims, springs = aims_of(chain, path.postures), np.setdiff1d(np.arange(chain.n), chain.active)
    q = path.postures.copy()
    span, change, factors = float(np.ptp(q, axis=0).max()), np.inf, None
    best = InverseMotion(q, q, q, q, np.inf)
    for _ in range(60):
        padded = np.concatenate([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])  # at rest before and after
        windows = np.lib.stride_tricks.sliding_window_view(padded, DIFFERENCES.shape[1], axis=0)
        qd, qdd = windows @ DIFFERENCES[0] / path.spacing, windows @ DIFFERENCES[1] / path.spacing**2
        try:
            torque = required_torque(chain, q, qd, qdd, path.wrench)
            if change > 1e-4:  # else Newton's matrix is known well enough
                factors = _factored(chain, path, q, qd, torque, aims)
        except FlexlinkError:  # the motion is beyond float64
            return best._replace(correction=np.inf)
        if factors is None:
            break
        defect = np.empty_like(q)
        defect[:, chain.active] = np.einsum("kij,kj->ki", aims, path.tips - tip_position(chain, q))
        defect[:, springs] = -torque[:, springs]
        (banded, pivots, scale), width = factors, 2 * chain.n - 1
        correction, _ = dgbtrs(banded, width, width, (defect / scale).ravel(), pivots)
        before, change = change, float(np.abs(correction).max()) / span
        if not change < 10.0:  # farther than ten times the whole motion, or not a number
            return best._replace(correction=np.inf)
        if change < best.correction:
            best = InverseMotion(q, qd, qdd, torque[:, chain.active], change)
        if change <= 1e-10 or (change < 1e-6 and change > 2.0 * before):
            break
        q = q + correction.reshape(q.shape)
    return best


def _factored(
    chain: Chain, path: TipPath, q: Array, qd: Array, torque: Array, aims: Array
) -> tuple[Array, NDArray[np.int32], Array]:
    """LU factors and pivots of the equations linearized about a motion, and the divisors of their rows (m, n)."""
    h, (m, n) = path.spacing, q.shape
    M, D, K = slopes_of(chain, q, qd, torque, path.wrench)
    blocks = np.stack([M / h**2 - D / (2 * h), K - 2 * M / h**2, M / h**2 + D / (2 * h)])
    blocks[:, :, chain.active] = 0.0
    blocks[1][:, chain.active] = aims @ jacobian(chain, q).linear
    scale = np.abs(blocks[1]).max(axis=2)
    blocks /= scale[:, :, None]
    width = 2 * n - 1  # diagonals on either side of the main diagonal
    banded = np.zeros((3 * width + 1, m * n))
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for shift, block in zip((-1, 0, 1), blocks, strict=True):
        k = np.arange(max(0, -shift), min(m, m - shift))[:, None, None]
        i, j = k * n + row, (k + shift) * n + column
        banded[2 * width + i - j, j] = block[k[:, 0, 0]]
    factors, pivots, _ = dgbtrf(banded, width, width, overwrite_ab=True)
    return factors, pivots, scale


# Transmission zeros from the torques of the driven joints to the tip: motion of the arm with its tip held.
#
# With the joints' coordinates a and the springs' coordinates p, a tip that stays in place has δa = −R δp with R = J_a⁺
# J_p, and the springs move by E p̈ + F ṗ + G p = 0, with E = M_pp − M_pa R and so on. A torque computed from the tip's
# path contains exp(λt) of these zeros: it must begin before the move for Re λ > 0, and end after it for Re λ < 0.


def required_torque(chain: Chain, q: Array, qd: Array, qdd: Array, wrench: Array) -> Array:
    """Torque T_EX of every coordinate that a motion needs, M (q̈ − q̈ without T_EX), shape (n,) or (b, n) [N m]."""
    wrenches = np.broadcast_to(wrench, (*q.shape[:-1], 6)).copy()
    free = forward_dynamics(chain, q, qd, np.zeros_like(q), tip_wrench=wrenches)
    return np.asarray((mass_matrix(chain, q) @ (qdd - free)[..., None])[..., 0])


def slopes_of(chain: Chain, q: Array, qd: Array, torque: Array, wrench: Array) -> tuple[Array, Array, Array]:
    """∂τ/∂q̈, ∂τ/∂q̇ and ∂τ/∂q of `required_torque`, shape (n, n) or (b, n, n), at the motion that torques cause."""
    wrenches = np.broadcast_to(wrench, (*q.shape[:-1], 6)).copy()
    by = forward_dynamics_derivatives(chain, q, qd, torque, tip_wrench=wrenches)
    M = mass_matrix(chain, q)
    return M, -M @ by.dqd, -M @ by.dq


def aims_of(chain: Chain, postures: Array) -> Array:
    """J_a⁺ (b, d, 3): changes of the driven joints per displacement of the tip, at these postures (b, n)."""
    return np.asarray(np.linalg.pinv(jacobian(chain, postures).linear[:, :, chain.active]))


def transmission_zeros(chain: Chain, q: Array, wrench: Array) -> tuple[Complex, Complex]:
    """Zeros of an arm at rest in a posture (n,), the slowest first, and those of the arm without damping [1/s]."""
    driven, zero = chain.active, np.zeros(chain.n)
    springs = np.setdiff1d(np.arange(chain.n), driven)
    torque = required_torque(chain, q, zero, zero, wrench)
    R = (aims_of(chain, q[None])[0] @ jacobian(chain, q).linear)[:, springs]
    E, F, G = (
        part[np.ix_(springs, springs)] - part[np.ix_(springs, driven)] @ R
        for part in slopes_of(chain, q, zero, torque, wrench)
    )
    m = len(springs)
    one, none = np.eye(m), np.zeros((m, m))
    left, right = np.block([[none, one], [-G, -F]]), np.block([[one, none], [none, E]])
    both = [scipy.linalg.eigvals(left, right), np.sqrt(scipy.linalg.eigvals(-G, E).astype(complex))]
    damped, undamped = (np.array(sorted(each[np.isfinite(each)], key=abs), dtype=complex) for each in both)
    return damped, undamped


# Torques and joint motion with which a scene's tip follows a move, or the reason why there are none.


class Feedforward(NamedTuple):
    """The inverse at equally spaced times (m,), in the time of the original scene, which may begin before 0."""

    times: Array
    path: TipPath
    motion: InverseMotion
    grid: "Grid"
    move: TipMove
    zeros: list[tuple[Complex, Complex]]


def refuse(scene: Scene, chain: Chain) -> None:
    """Refuse scenes whose tip cannot be moved by torques computed in advance."""
    drive = scene.drive
    reasons = {
        "base.kind = 'free': joints of a floating arm do not place its tip; fix the base": scene.arm.base.free,
        f"drive.kind = {drive.kind!r}: needs kind = 'pd', whose kp and kd hold the joints on the computed motion":
            drive.kind != "pd",
        "motion: joints with prescribed motion; drive them, or lock them": bool(scene.motion),
        "wrench: changes over time, turns with the tip, or acts elsewhere; make it constant in frame 0":
            scene.wrench.varies or (scene.wrench.acts and scene.wrench.on not in {"", scene.arm.links[-1].name}),
        "link.damping, joint: friction that lags behind the motion; leave it out, or give damping with at_hz":
            len(chain.internal) > 0,
        "link.modes: the hinges must move one by one; omit modes":
            chain.shapes is not None,
        "link.flex: no link or gear bends; the torques of a rigid arm are those of kind 'computed_torque'":
            len(chain.active) == chain.n,
    }  # fmt: skip
    for reason, applies in reasons.items():
        if applies:
            raise SceneError(reason, id="inversion-not-possible")


def feedforward_of(scene: Scene, chain: Chain, move: TipMove, wrench: Array) -> Feedforward:
    """Compute the inverse of a move; errors as in `invert`."""
    coarse = postures_at(chain, move.joints(move.start + move.duration * np.linspace(0.0, 1.0, 41)), wrench)
    _require_control(chain, coarse)
    zeros = [transmission_zeros(chain, posture, wrench) for posture in coarse[[0, 20, 40]]]
    grid = grid_of(zeros, move.duration, chain.n)
    ends = grid.before, grid.after
    times = np.asarray(move.start + grid.spacing * np.arange(grid.points + 1), np.float64)
    within = postures_at(chain, move.joints(times), wrench)
    tips = tip_position(chain, within) if move.tips is None else move.tips(times)
    postures, tips = (np.pad(part, (ends, (0, 0)), mode="edge") for part in (within, tips))
    path = TipPath(grid.spacing, postures, tips, wrench)
    motion = inverse_motion(chain, path)
    if motion.correction > 1e-6:
        why = f"no bounded motion of the joints was found whose tip makes this move in {move.duration:g} s"
        text = f"tip: {why}; take a longer move or a smoother profile"
        raise ConvergenceError(text, coarse[0], 0.0, id="inversion-diverged")
    found = Feedforward(
        np.asarray(move.start + grid.spacing * (np.arange(grid.rows) - grid.before), np.float64), path, motion, grid,
        move, zeros,
    )  # fmt: skip
    _require_effort(scene, chain, found)
    return found


def _require_control(chain: Chain, postures: Array) -> None:
    """Refuse arms with more driven joints than independent directions in which these move the tip."""
    driven = len(chain.active)
    J = jacobian(chain, postures).linear[:, :, chain.active]
    sizes = np.linalg.svd(J, compute_uv=False)
    moved = int((sizes > 1e-3 * sizes.max()).sum(axis=1).min())
    if moved == driven and (np.linalg.det(J[:-1].transpose(0, 2, 1) @ J[1:]) <= 0).any():  # stretched in between
        moved -= 1
    if moved < driven:
        why = f"tip: {driven} driven joints move it in only {plural(moved, 'direction')} somewhere along the move"
        remedy = "lock joints that it does not need (link.NAME.joint.locked = true), or keep away from a stretched arm"
        raise SceneError(f"{why}; {remedy}", id="tip-not-controlled")


def _require_effort(scene: Scene, chain: Chain, found: Feedforward) -> None:
    """Refuse moves whose torques exceed `drive.effort`; torques of motion fall with the square of the duration."""
    if scene.drive.effort is None:
        return
    links = [chain.coordinate(int(k)).link - 1 for k in chain.active]
    effort, rest = np.array(scene.drive.effort)[links], np.zeros_like(found.path.postures)
    held = required_torque(chain, found.path.postures, rest, rest, found.path.wrench)[:, chain.active]
    most, moving = np.abs(found.motion.torques).max(axis=0), np.abs(found.motion.torques - held).max(axis=0)
    if (most <= effort).all():
        return
    k = int(np.argmax(most / effort))
    spare = float(((effort - np.abs(held).max(axis=0)) / np.maximum(moving, 1e-300)).min())
    remedy = f"take a move of {1.005 * found.move.duration / np.sqrt(spare):.3g} s" if spare > 0 else "raise the limit"
    joint = f"joint {chain.link_names[links[k]]!r} needs {most[k]:.4g} {chain.torque_units[chain.active[k]]}"
    why = f"drive.effort = {effort[k]:g}: {joint} for this move in {found.move.duration:g} s; {remedy}"
    raise SceneError(why, id="move-beyond-effort")


def directions_of(chain: Chain, postures: Array) -> Array:
    """Orthonormal directions in which the driven joints move the tip, shape (m, 3, d)."""
    return np.asarray(np.linalg.svd(jacobian(chain, postures).linear[:, :, chain.active], full_matrices=False)[0])


class Grid(NamedTuple):
    """Spacing [s], and the numbers of spacings before, within and after a move."""

    spacing: float
    before: int
    points: int
    after: int

    @property
    def rows(self) -> int:
        """Number of times."""
        return self.before + self.points + self.after + 1


def grid_of(zeros: list[tuple[Complex, Complex]], duration: float, n: int) -> Grid:
    """Choose the times for a move of n coordinates from zeros at its start, middle and end, with and without damping.

    Zeros on the imaginary axis would let the springs vibrate with the tip at rest, so they must be much faster than the
    move: they are left unresolved, so that the springs follow quasi-statically.
    """
    fastest = 2.46  # |λ| h at the highest frequency that differences of order 6 represent
    fewest = 40  # times that resolve a move
    points = min(200, max(100, 16_000 // n))  # more would resolve zeros of single segments, and cost memory
    oscillating = [z for _, undamped in zeros for z in undamped if abs(z.real) <= 0.1 * abs(z)]
    if oscillating:
        slowest = min(map(abs, oscillating))
        points = min(points, int(duration * slowest / (1.2 * fastest)))
        if points < fewest:
            needed = 1.005 * fewest * 1.2 * fastest / slowest if slowest * duration > 1e-3 else math.inf
            longer = f"a move of {needed:.3g} s or more" if math.isfinite(needed) else "other joints"
            zero = f"{slowest / (2 * math.pi):.3g} Hz (a transmission zero on the imaginary axis)"
            why = f"with the tip at rest the arm can vibrate at {zero}, so no bounded torque moves the tip"
            text = f"tip: {why} in {duration:g} s; take {longer}, or less inertia at the tip"
            raise SceneError(text, id="zeros-on-axis")
    h = duration / points
    first, last = (damped[np.abs(damped) * h <= fastest] for damped, _ in (zeros[0], zeros[-1]))
    before, after = _decay(first[first.real > 0].real, h), _decay(-last[last.real < 0].real, h)
    if before + after > 20 * points:
        why = f"tip: torques would have to begin {before * h:.3g} s before and end {after * h:.3g} s after"
        raise SceneError(f"{why} a move of {duration:g} s; take a longer move", id="zeros-too-slow")
    return Grid(h, before, points, after)


def _decay(rates: Array, h: float) -> int:
    """Number of spacings after which all exp(−rate t) have decayed to 1e-7, at least 8."""
    slowest = float(rates.min(initial=math.inf))
    return max(8, math.ceil(math.log(1e7) / slowest / h)) if math.isfinite(slowest) and slowest > 0 else 8
