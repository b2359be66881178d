"""The move that a tip is to make: along the reference of the scene's drive, or straight to a point."""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.describe.profiles import Quintic
from flexlink.describe.reference_trajectory import ReferenceTrajectory, from_rest_to_rest
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import static_posture, static_postures
from flexlink.dynamics.placement import jacobian, tip_position


class TipMove(NamedTuple):
    """A move of driven joints (k, d) at times (k,); tips (k, 3), by default those of the arm at rest."""

    start: float
    duration: float
    joints: Callable[[Array], Array]
    tips: Callable[[Array], Array] | None = None


def move_of(scene: Scene, chain: Chain, to: ArrayLike | None, duration: float | None, wrench: Array) -> TipMove:
    """The tip's move: straight to a point `to` in `duration`, or by the drive's reference; errors as in `invert`."""
    if to is not None:
        if duration is None:
            raise ArgumentError("duration: missing; a move to a point needs one [s]", id="missing-key")
        return _straight(scene, chain, vector("to", to, 3), positive("duration", duration), wrench)
    if duration is not None:
        why = f"duration = {duration!r}: needs to, a point; else set drive.reference.duration"
        raise ArgumentError(why, id="needs-another-argument")
    course = unshaped(scene).course
    if course is None:
        why = "drive.reference: missing; it is the move that the tip follows; or pass a point to"
        raise SceneError(why, id="missing-key")
    moving = course.coefficients[:, 1:].any(axis=(1, 2))
    if not moving.any():
        raise SceneError("drive.reference: no joint moves; choose another target", id="no-travel")
    first, last = np.flatnonzero(moving)[[0, -1]]
    start, end = float(course.knots[first]), float(course.knots[last + 1])
    _require_smooth(course, start, end)
    return TipMove(start, end - start, lambda t: course(t)[0])


def unshaped(scene: Scene) -> Scene:
    """The scene without an input shaper."""
    shaped = scene.drive.reference is not None and scene.drive.reference.shaper is not None
    return scene.varied({"drive.reference.shaper": None}) if shaped else scene


def _require_smooth(course: ReferenceTrajectory, start: float, end: float) -> None:
    """Refuse a reference whose position, rate or acceleration jumps: no torque gives the tip such a motion."""
    before, after = course(np.nextafter(course.knots, -np.inf)), course(course.knots)
    largest = [np.abs(part).max() for part in course(np.linspace(start, end, 200))]
    for what, left, right, most in zip(("position", "rate", "acceleration"), before, after, largest, strict=True):
        jump = np.abs(right - left).max(axis=1)
        if jump.max() > 1e-6 * most:
            why = f"its {what} jumps at t = {course.knots[int(jump.argmax())]:.6g} s, which the tip cannot follow"
            remedy = "use profile 'quintic' or 's_curve', or a smooth table with rates and accelerations"
            raise SceneError(f"drive.reference: {why}; {remedy}", id="reference-not-smooth")


def _straight(scene: Scene, chain: Chain, to: Array, duration: float, wrench: Array) -> TipMove:
    """A straight line from the tip's initial position, with a quintic profile in time."""
    angles = scene.joint_positions[[chain.coordinate(int(k)).link - 1 for k in chain.active]]
    posture = postures_at(chain, angles[None], wrench)[0]
    start = tip_position(chain, posture)
    way, close = to - start, 1e-9 * chain.size
    if np.abs(way).max() <= close:
        raise ArgumentError("to: the tip is there already; choose another point", id="no-travel")
    millimetres = f"; if given in mm, {(1e-3 * to).tolist()}" if np.linalg.norm(to) > 10.0 * chain.size else ""
    found, nodes = [angles], np.linspace(0.0, 1.0, 65)  # at which the joints are computed; between them, splines
    for before, fraction in itertools.pairwise(nodes.tolist()):
        for _ in range(50):
            off = start + fraction * way - tip_position(chain, posture)
            if np.abs(off).max() <= close:
                break
            change = np.linalg.pinv(jacobian(chain, posture).linear[:, chain.active], rcond=1e-6) @ off
            posture[chain.active] += change / max(1.0, float(np.abs(change).max()) / 0.5)  # at most 0.5 rad or m
            posture = static_posture(chain, posture, wrench, "world")
        else:
            line = f"{100 * before:.0f} % of the straight line from {start.round(4).tolist()} m"
            why = f"{plural(len(angles), 'driven joint')} cannot move the tip beyond {line}"
            reach = f" of {chain.reach:.3g} m" if np.linalg.norm(to) > chain.reach else ""
            text = f"to = {to.tolist()} m: {why}; choose a point in reach{reach}{millimetres}"
            raise ArgumentError(text, id="tip-out-of-reach")
        found.append(posture[chain.active])
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  slow to import: 0.1 s

    along, (knots, c) = CubicSpline(nodes, np.array(found)), Quintic(duration).pieces
    course = from_rest_to_rest(knots, c[:, :, None], np.ones(1))

    def fraction_at(t: Array) -> Array:
        return np.asarray(course(t)[0][:, 0])

    return TipMove(0.0, duration, lambda t: along(fraction_at(t)), lambda t: start + fraction_at(t)[:, None] * way)


def postures_at(chain: Chain, angles: Array, wrench: Array) -> Array:
    """Equilibria (k, n) with the driven joints at angles (k, d), under gravity and a constant wrench."""
    if not wrench.any():
        return static_postures(chain, angles)
    posture, found = chain.rest.copy(), np.empty((len(angles), chain.n))
    for k, row in enumerate(angles):
        posture[chain.active] = row
        posture = found[k] = static_posture(chain, posture, wrench, "world")
    return found
