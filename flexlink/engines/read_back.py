"""What an engine has read: an arm in frame 0 at zero angles, whatever the file, its frames and the engine.

Axes and lines of joints, masses, centres and inertias at a posture do not depend on where somebody puts body frames, so
that two descriptions of one arm have one record, but for the joints' order and where on its axis a joint has its point.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.placement import frames
from flexlink.kernels.layout import BODY

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OF_JOINTS = ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature")
"""Fields of a record, and of a chain's hinges, with one number a joint."""
UNIT = 1e-9
"""How far from 1 the length of an axis may be that an engine has made a direction."""
OF_LINES = ("axes", "points")
OF_BODIES = ("masses", "centers", "inertias")
ACTUATORS = ("control", "servo_stiffness", "servo_damping", "push", "effort")


class Parts(NamedTuple):
    """The bodies that joint `owner` carries, rigid with each other: their inertias in frame 0, shape (b, 3, 3)."""

    owner: Indices
    inertias: Array


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ReadBack:
    """Joints and bodies as an engine has them; body k is all that is rigid behind joint k, up to the next joints.

    Attributes
    ----------
    names
        Of the joints, in the engine's order.
    before
        The joint that each hangs on, −1 for the base, shape (n,).
    axes, points
        Unit vectors, and points on the axes [m], shape (n, 3).
    frames
        Rotation into frame 0 of the frame that the file gives each axis in, shape (n, 3, 3).
    masses, centers, inertias
        [kg], shape (n,); [m], (n, 3), the joint's point where there is no mass; about the centres [kg m²], (n, 3, 3).
    parts
        What of the inertias is one body's each.
    stiffness, rest, damping, coulomb, coulomb_width, armature
        As in `HINGE`, shape (n,): what acts, so 0 where the engine is told to leave springs or dampers out.
    control, servo_stiffness, servo_damping, push, effort
        What actuators do: of a motor the torque that a command of 1 gives [N m], of a servo the angle that it then
        seeks [rad], 0 where there is none, shape (n,); −∂T/∂q [N m/rad], −∂T/∂q̇ [N m s/rad] and T [N m] of
        themselves, (n,); least and largest torque [N m], (n, 2), infinite where there is no limit.
    gravity
        [m/s²], shape (3,).
    tip
        Origin of the frame called "tip" [m], shape (3,), None if there is none.
    unsaid
        Fields that this file does not say, such as the springs of an URDF; no difference is made of them.
    settings
        What else the engine was told, by the names of `mistakes.SETTINGS`, in words.
    integrator, step
        What the file asks for: by MuJoCo's names, and the time step [s]; None if it asks for none.
    asked
        Of a scene, the least and the largest torque that its drive may ask for [N m], shape (n, 2); None of a file.
    """

    names: tuple[str, ...]
    before: Indices
    axes: Array
    points: Array
    frames: Array
    masses: Array
    centers: Array
    inertias: Array
    parts: Parts
    stiffness: Array
    rest: Array
    damping: Array
    coulomb: Array
    coulomb_width: Array
    armature: Array
    control: Array
    servo_stiffness: Array
    servo_damping: Array
    push: Array
    effort: Array
    gravity: Array
    tip: Array | None = None
    unsaid: frozenset[str] = frozenset()
    settings: Mapping[str, str] = dataclasses.field(default_factory=dict)
    integrator: str = ""
    step: float | None = None
    asked: Array | None = None

    def __repr__(self) -> str:
        return f"<ReadBack: {self.n} joints, {self.masses.sum():.6g} kg>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    def require_sound(self) -> None:
        """Refuse a file that the engine took numbers from that are none.

        Raises
        ------
        ArgumentError
            The message names the number and its joint.
        """
        for field in (*OF_LINES, *OF_BODIES, *OF_JOINTS, *ACTUATORS[:-1]):
            rows = getattr(self, field).reshape(self.n, -1)
            bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
            if len(bad):
                raise ArgumentError(f"{field} of joint {self.names[bad[0]]!r}: read as {rows[bad[0]]}; must be finite")
        if np.isnan(self.effort).any():
            k = int(np.flatnonzero(np.isnan(self.effort).any(axis=1))[0])
            raise ArgumentError(f"torque limit of joint {self.names[k]!r}: read as {self.effort[k]}; must be numbers")
        if self.gravity.shape != (3,) or not np.isfinite(self.gravity).all():
            raise ArgumentError(f"gravity: read as {self.gravity}; must be three finite numbers")
        lengths = np.linalg.norm(self.axes, axis=1)
        if np.abs(lengths - 1).max() > UNIT:
            k = int(np.abs(lengths - 1).argmax())
            raise ArgumentError(
                f"axis of joint {self.names[k]!r}: read with length {lengths[k]:.6g}; must be a direction"
            )


def unlimited(n: int) -> Array:
    """The `effort` of joints without a limit."""
    return np.tile([-np.inf, np.inf], (n, 1))


def no_actuators(n: int) -> dict[str, Any]:
    """The fields `ACTUATORS` of joints that have none."""
    return {field: np.zeros(n) for field in ACTUATORS[:-1]} | {"effort": unlimited(n)}


def no_hinge(joint: str, kind: str) -> ArgumentError:
    """The error of a file with a joint that is none; such as a gripper's, or a base that moves freely."""
    return ArgumentError(f"joint {joint!r} is of type {kind}: only arms of hinges are compared; make it fixed")


def merged(owner: Indices, masses: Array, centers: Array, inertias: Array, points: Array) -> dict[str, Any]:
    """The fields `OF_BODIES`: bodies that are rigid with each other as one, by joint `owner`, −1 for the base; `parts`.

    m = Σ mᵢ, c = Σ mᵢ cᵢ / m, I = Σ (Iᵢ + mᵢ (dᵢ² 1 − dᵢ dᵢᵀ)), dᵢ = cᵢ − c
    """
    n, moving = len(points), owner >= 0
    k, m, c, I = owner[moving], masses[moving], centers[moving], inertias[moving]
    total, moment, inertia = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    np.add.at(total, k, m)
    np.add.at(moment, k, m[:, None] * c)
    center = np.divide(moment, total[:, None], out=points.copy(), where=total[:, None] != 0)
    d = c - center[k]
    np.add.at(inertia, k, I + parallel_axis(m, d))
    return {"masses": total, "centers": center, "inertias": inertia, "parts": Parts(k, I)}


def parallel_axis(m: Array, d: Array) -> Array:
    """m (d² 1 − d dᵀ), of (b,) masses and (b, 3) distances."""
    square = np.einsum("bi,bi->b", d, d)[:, None, None] * np.eye(3)
    return np.asarray(m[:, None, None] * (square - d[:, :, None] * d[:, None, :]))


def of_chain(chain: Chain) -> ReadBack:
    """The record of a chain, exact but for the rotations into frame 0."""
    at_zero = frames(chain, np.zeros(chain.n))
    R, p = at_zero.rotations, at_zero.points
    bodies = chain.bodies
    owner = bodies["stop"] - 1
    counts = bodies["stop"] - bodies["first"]
    points = np.repeat(p, counts, axis=0)
    placed = merged(
        owner, bodies["mass"], p + np.einsum("bij,bj->bi", R, bodies["center"]), R @ bodies["inertia"] @ R.mT, points
    )
    own: dict[str, Any] = {field: np.array(chain.hinges[field]) for field in OF_JOINTS}
    before = np.arange(chain.n) - 1
    return ReadBack(
        chain.joint_names, before, np.array(chain.axes), points, np.repeat(R, counts, axis=0), **placed, **own,
        **no_actuators(chain.n), gravity=np.array(chain.gravity), tip=p[-1],
    )  # fmt: skip


def to_chain(read: ReadBack, like: Chain) -> Chain:
    """The serial chain of a record whose joints are those of `like`: every joint Z of a frame of its own."""
    bodies, R, p = np.zeros(read.n + 1, BODY), np.eye(3), np.zeros(3)
    for k, body in enumerate(bodies[:-1]):
        axes = _frame(read.axes[k])
        body["first"], body["stop"], body["turned"] = k, k + 1, 1
        body["rotation"], body["translation"] = R.T @ axes, R.T @ (read.points[k] - p)
        R, p = axes, read.points[k]
        body["mass"], body["center"] = read.masses[k], R.T @ (read.centers[k] - p)
        turned = R.T @ read.inertias[k] @ R
        body["inertia"] = (turned + turned.T) / 2
    end, tip = bodies[-1], frames(like, np.zeros(like.n)).points[-1] if read.tip is None else read.tip
    end["first"] = end["stop"] = read.n
    end["rotation"], end["translation"] = np.eye(3), R.T @ (tip - p)
    hinges = like.hinges.copy()
    hinges["axis"] = 2
    for field in OF_JOINTS:
        hinges[field] = getattr(read, field)
    return dataclasses.replace(like, bodies=bodies, hinges=hinges, gravity=read.gravity.copy())


def _frame(axis: Array) -> Array:
    """A rotation whose Z is the axis."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)
