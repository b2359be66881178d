"""Torques and joint motion with which a scene's tip follows a move, or the reason why there are none."""

import math
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ConvergenceError, SceneError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.tip_inversion.boundary_value import (
    InverseMotion,
    TipPath,
    inverse_motion,
    required_torque,
    transmission_zeros,
)
from flexlink.dynamics.tip_inversion.moves import TipMove, postures_at


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
