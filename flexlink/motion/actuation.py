"""A scene's drive and prescribed motions as the arrays that the kernels read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError
from flexlink.describe.scene import Scene
from flexlink.describe.situation import Motion

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class DriveArrays(NamedTuple):
    """T_EX = Σ_j c_j x^j + kp (target − q) − kd q̇ at the driven joints, x = time since the last knot."""

    joints: Indices  # (d,)
    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, d) [N m / s^j]
    kp: Array  # (d,) [N m/rad]
    kd: Array  # (d,) [N m s/rad]
    target: Array  # (d,) [rad]


class MotionArrays(NamedTuple):
    """θ = Σ_j c_j x^j of every prescribed joint; its pieces are first[m] … first[m + 1] − 1."""

    joints: Indices  # (r,)
    first: Indices  # (r + 1,)
    knots: Array  # (pieces,) [s]
    coefficients: Array  # (pieces, 6) [rad / s^j]


class Inputs(NamedTuple):
    """All that acts on a run from outside."""

    drive: DriveArrays
    motion: MotionArrays
    wrench: Array  # (6,) [N, N m]


def input_arrays(scene: Scene, chain: Chain) -> Inputs:
    """All that acts on a run of this scene from outside; errors as in `drive_arrays` and `motion_arrays`."""
    return Inputs(drive_arrays(scene, chain), motion_arrays(scene, chain), scene.tip_wrench)


def drive_arrays(scene: Scene, chain: Chain) -> DriveArrays:
    """The scene's drive; no driven joint at all where it has nothing to say.

    Raises
    ------
    SceneError
        The torques change by more than float64 can hold.
    """
    drive = scene.drive
    joints = chain.active.copy() if drive.kind != "none" else np.empty(0, dtype=np.intp)
    links = [chain.coordinate(int(k)).link - 1 for k in joints]
    zero = (0.0,) * len(scene.arm.links)
    times = np.array(drive.times or (0.0,))
    torques = np.array(drive.torques or (drive.torque or zero,))[:, links]
    if drive.hold:
        return held(chain, times, torques)
    degree = 3 if drive.smooth else 1
    coefficients = np.zeros((len(times), degree + 1, len(joints)))
    coefficients[:, 0] = torques
    with np.errstate(over="ignore", invalid="ignore"):
        coefficients[:-1, 1] = np.diff(torques, axis=0) / np.diff(times)[:, None]
        if drive.smooth and np.isfinite(coefficients).all():
            from scipy.interpolate import CubicSpline  # noqa: PLC0415  0.1 s that few scenes need

            coefficients[:-1] = CubicSpline(times, torques).c[::-1].transpose(1, 0, 2)
    if not np.isfinite(coefficients).all():
        raise SceneError("drive.torques: change faster from one time to the next than float64 can hold")

    def of_joints(per_link: tuple[float, ...] | None) -> Array:
        return np.array(per_link or zero)[links]

    return DriveArrays(
        joints, times, coefficients, of_joints(drive.kp), of_joints(drive.kd), np.radians(of_joints(drive.target_deg))
    )


def held(chain: Chain, times: Array, torques: Array) -> DriveArrays:
    """A drive of torques (m, d) at the driven joints, each row held until the next time.

    The times are rounded down by more than what a sample's time may be off by: a sample at a time sees what follows.
    """
    zero = np.zeros(len(chain.active))
    knots = times * (1 - 8 * np.finfo(float).eps)
    return DriveArrays(chain.active.copy(), knots, np.ascontiguousarray(torques[:, None]), zero, zero, zero)


def motion_arrays(scene: Scene, chain: Chain) -> MotionArrays:
    """The scene's prescribed motions; no joint at all if there is none.

    Raises
    ------
    SceneError
        An angle changes faster than float64 can hold.
    """
    joints = [chain.index(scene.arm.number(motion.link), 0, 0) for motion in scene.motion]
    with np.errstate(all="ignore"):
        pieces = [_pieces(motion) for motion in scene.motion]
    for k, piece in enumerate(pieces):
        if not np.isfinite(piece).all():
            raise SceneError(f"motion[{k}].angle_deg: changes faster from one time to the next than float64 can hold")
    knots = [np.array(motion.times) for motion in scene.motion]
    return MotionArrays(
        np.array(joints, dtype=np.int64),
        np.cumsum([0, *map(len, knots)], dtype=np.int64),
        np.concatenate([np.empty(0), *knots]),
        np.concatenate([np.empty((0, 6)), *pieces]),
    )


def _pieces(motion: Motion) -> Array:
    """Quintic Hermite pieces, then one that goes on at the final rate."""
    columns = [np.radians(column) for column in (motion.angle_deg, motion.rate_deg, motion.acceleration_deg)]
    pieces = np.zeros((len(motion.times), 6))
    if len(motion.times) > 1:
        from scipy.interpolate import BPoly, PPoly  # noqa: PLC0415  0.1 s that few scenes need

        quintic = PPoly.from_bernstein_basis(BPoly.from_derivatives(motion.times, np.column_stack(columns)))
        pieces[:-1] = quintic.c[::-1].T
    pieces[-1, 0], pieces[-1, 1] = columns[0][-1], columns[1][-1]
    return pieces
