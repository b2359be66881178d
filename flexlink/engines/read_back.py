"""Record of an arm as an engine has read it, in frame 0 at zero angles, which is independent of the file's body frames.

Two descriptions of the same arm have equal records, except for the order of the joints and the position of each joint's
point along its axis.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.builder import record_branches
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Kind
from flexlink.common.errors import ArgumentError
from flexlink.common.products import cross
from flexlink.common.types import Array, Indices
from flexlink.dynamics.placement import frames
from flexlink.formats.document import loaded_tip, tips
from flexlink.kernels.layout import BODY, COUPLING, SLIDES

AXIS_FIELDS = ("axes", "points")
BODY_FIELDS = ("masses", "centers", "inertias")
JOINT_FIELDS = ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature")  # also fields of `HINGE`
COUPLED_FIELDS = {"coupled_stiffness": "stiffness", "coupled_damping": "damping"}  # and their fields in `COUPLING`
ACTUATOR_FIELDS = ("gear", "servo_stiffness", "servo_damping", "constant_torque", "effort")


class Parts(NamedTuple):
    """Single bodies before welding: the joint that moves each body, and its inertia in axes of frame 0, (b, 3, 3)."""

    owner: Indices
    inertias: Array


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ReadBack:
    """Joints and bodies in an engine; body k is all that is rigidly attached to joint k; a floating base is 0 to 5."""

    names: tuple[str, ...]
    parents: Indices  # parent joint of each joint, −1 for the base
    axes: Array  # unit vectors of the axes, and
    points: Array  # points on them [m], shape (n, 3)
    frames: Array  # rotations into frame 0 from the frames in which the file specifies the axes, shape (n, 3, 3)
    masses: Array  # [kg]
    centers: Array  # centres of mass [m], shape (n, 3); that of a massless body is the joint's point
    inertias: Array  # central inertias [kg m²], shape (n, 3, 3)
    parts: Parts  # inertias of the individual bodies, before merging
    slides: NDArray[np.bool_]  # which joints are prismatic
    stiffness: Array  # this and the next five as in `HINGE`; 0 where a setting disables springs or dampers
    rest: Array
    damping: Array
    coulomb: Array
    coulomb_width: Array
    armature: Array
    coupled_stiffness: Array  # K_ij [N m/rad] and
    coupled_damping: Array  # D_ij [N m s/rad] between two joints, symmetric, 0 on the diagonal, shape (n, n)
    gear: Array  # torque of a motor [N m], or angle of a servo [rad], for a command of 1; 0: no actuator
    servo_stiffness: Array  # −∂T/∂q [N m/rad] of the actuators for zero command,
    servo_damping: Array  # −∂T/∂q̇ [N m s/rad], and
    constant_torque: Array  # T [N m]
    effort: Array  # smallest and largest torque [N m], shape (n, 2); infinite without a limit
    gravity: Array  # [m/s²], shape (3,)
    tip: Array | None = None  # origin of the frame named "tip" [m], shape (3,)
    tip_on: int | None = None  # joint to which the tip of a chain is attached; None: the last joint
    unspecified: frozenset[str] = frozenset()  # fields that the file does not specify; they are not compared
    settings: Mapping[str, str] = dataclasses.field(default_factory=dict)  # active settings, see `mistakes.toml`
    integrator: str = ""  # MuJoCo's name of the file's integrator
    step: float | None = None  # time step of the file [s]
    drive_range: Array | None = None  # smallest and largest torque that a scene's drive may command [N m], shape (n, 2)
    bodies: tuple[str, ...] = ()  # name of the body that each joint moves, in flexlink the link's

    def __repr__(self) -> str:
        return f"<ReadBack: {self.n} joints, {self.masses.sum():.6g} kg>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    def in_order(self, order: Indices, bodies: Indices | None = None, **fields: Any) -> "ReadBack":
        """The record with joint `order[k]` as joint k, and its body (or `bodies`); `fields` are replaced."""
        bodies = order if bodies is None else bodies
        place = np.append(np.argsort(order), -1)  # the base, −1, stays −1
        of_joints = (*AXIS_FIELDS, "frames", "slides", *JOINT_FIELDS, *ACTUATOR_FIELDS)
        moved: dict[str, Any] = {field: getattr(self, field)[order] for field in of_joints}
        moved |= {field: getattr(self, field)[bodies] for field in BODY_FIELDS}
        moved |= {field: getattr(self, field)[np.ix_(order, order)] for field in COUPLED_FIELDS}
        moved |= {field: tuple(getattr(self, field)[k] for k in order) for field in ("names", "bodies")}
        moved["parents"] = place[self.parents[order]]
        moved["parts"] = self.parts._replace(owner=np.argsort(bodies)[self.parts.owner])
        return dataclasses.replace(self, **moved | fields)

    def require_sound(self) -> None:
        """Check that all numbers are finite, and that axes are unit vectors."""
        for field in (*AXIS_FIELDS, *BODY_FIELDS, *JOINT_FIELDS, *COUPLED_FIELDS, *ACTUATOR_FIELDS[:-1]):
            rows = getattr(self, field).reshape(self.n, -1)
            for k in np.flatnonzero(~np.isfinite(rows).all(axis=1)):
                shown = rows[k][~np.isfinite(rows[k])][0] if field in COUPLED_FIELDS else rows[k]
                raise _refused(f"{field} of joint {self.names[k]!r}", shown, "finite")
        for k in np.flatnonzero(np.isnan(self.effort).any(axis=1)):
            raise _refused(f"torque limit of joint {self.names[k]!r}", self.effort[k], "numbers")
        if self.gravity.shape != (3,) or not np.isfinite(self.gravity).all():
            raise _refused("gravity", self.gravity, "three finite numbers")
        lengths = np.linalg.norm(self.axes, axis=1)
        worst = int(np.abs(lengths - 1).argmax())
        if abs(lengths[worst] - 1) > 1e-9:
            raise _refused(f"axis of joint {self.names[worst]!r}", f"a vector of length {lengths[worst]:.6g}", "1")


def _refused(what: str, value: object, allowed: str) -> ArgumentError:
    return ArgumentError(f"{what}: the engine read {value}; must be {allowed}", id="number-in-file")


def no_limits(n: int) -> Array:
    """Return `effort` of joints without torque limits."""
    return np.tile([-np.inf, np.inf], (n, 1))


def no_actuators(n: int) -> dict[str, Any]:
    """Return `ACTUATOR_FIELDS` of joints without actuators."""
    return {field: np.zeros(n) for field in ACTUATOR_FIELDS[:-1]} | {"effort": no_limits(n)}


def require_joints(joints: Sequence[tuple[str, str]]) -> None:
    """Refuse a file without joints or with other types than hinges and slides; `joints`: name, type or ""."""
    for name, kind in joints:
        if kind:
            why = f"joint {name!r} has type {kind}; supported are revolute and prismatic joints and a floating base"
            raise ArgumentError(f"{why}; make it fixed", id="joint-type-in-file")
    if not joints:
        raise ArgumentError("the file has no movable joint", id="no-movable-joint")


def merge_bodies(owner: Indices, masses: Array, centers: Array, inertias: Array, points: Array) -> dict[str, Any]:
    """Merge all bodies of each joint into one; return `BODY_FIELDS` and `parts`. Bodies of owner −1 are on the base.

    m = Σ mᵢ, c = Σ mᵢ cᵢ / m, I = Σ (Iᵢ + mᵢ (dᵢ² 1 − dᵢ dᵢᵀ)), dᵢ = cᵢ − c
    """
    n, moving = len(points), owner >= 0
    k, m, c, I = owner[moving], masses[moving], centers[moving], inertias[moving]
    total, moment, inertia = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    np.add.at(total, k, m)
    np.add.at(moment, k, m[:, None] * c)
    center = np.divide(moment, total[:, None], out=points.copy(), where=total[:, None] != 0)
    np.add.at(inertia, k, I + parallel_axis(m, c - center[k]))
    return {"masses": total, "centers": center, "inertias": inertia, "parts": Parts(k, I)}


def parallel_axis(m: Array, d: Array) -> Array:
    """Return the inertias m (d² 1 − d dᵀ) of point masses (b,) at distances (b, 3)."""
    square = np.einsum("bi,bi->b", d, d)[:, None, None] * np.eye(3)
    return np.asarray(m[:, None, None] * (square - d[:, :, None] * d[:, None, :]))


def of_chain(chain: Chain) -> ReadBack:
    """Return the record of a chain, exact up to the rounding of rotations into frame 0."""
    at_zero = frames(chain, np.zeros(chain.n))
    R, p = at_zero.rotations, at_zero.points
    bodies = chain.bodies
    counts = bodies["stop"] - bodies["first"]
    heavy, owner = counts > 0, bodies["stop"] - 1
    points = np.repeat(p, counts, axis=0)
    placed = merge_bodies(
        np.where(heavy, owner, -1),
        bodies["mass"], p + np.einsum("bij,bj->bi", R, bodies["center"]), R @ bodies["inertia"] @ R.mT, points,
    )  # fmt: skip
    parents = np.arange(chain.n) - 1
    parents[bodies["first"][heavy]] = np.append(-1, owner)[bodies["parent"][heavy]]
    own: dict[str, Any] = {field: np.array(chain.hinges[field]) for field in JOINT_FIELDS}
    own |= to_matrices(chain.couplings, chain.n)
    named = zip(chain.coordinates, chain.joint_names, strict=True)
    return ReadBack(
        chain.joint_names, parents, np.array(chain.axes), points, np.repeat(R, counts, axis=0), **placed,
        slides=np.array(chain.slides), **own, **no_actuators(chain.n), gravity=np.array(chain.gravity),
        tip=p[-1], tip_on=tips(chain)[-1].parent,
        bodies=tuple(chain.link_names[c.link - 1] if c.kind is Kind.JOINT else name for c, name in named),
    )  # fmt: skip


def to_chain(read: ReadBack, like: Chain) -> Chain:
    """Convert a record to a chain with the joints of `like`; each joint turns about, or slides along, its Z axis."""
    bodies = np.zeros(read.n + len(like.tips), BODY)
    frames_of, points = [np.eye(3)], [np.zeros(3)]  # frames and origins of the base and of every joint
    for k, body in enumerate(bodies[: read.n]):
        axes, on = _frame(read.axes[k]), int(read.parents[k]) + 1
        R, p = frames_of[on], points[on]
        body["first"], body["stop"], body["turned"], body["parent"] = k, k + 1, 1, on
        body["rotation"], body["translation"] = R.T @ axes, R.T @ (read.points[k] - p)
        R, p = axes, read.points[k]
        body["mass"], body["center"] = read.masses[k], R.T @ (read.centers[k] - p)
        turned = R.T @ read.inertias[k] @ R
        body["inertia"] = (turned + turned.T) / 2
        frames_of.append(R)
        points.append(p)
    places = frames(like, np.zeros(like.n)).points[list(like.tips.values())]
    if read.tip is not None:
        places[-1] = read.tip
    for end, tip, place in zip(bodies[read.n :], tips(like), places, strict=True):
        end["first"], end["stop"], end["parent"] = read.n, read.n, tip.parent + 1
        end["rotation"], end["translation"] = np.eye(3), frames_of[tip.parent + 1].T @ (place - points[tip.parent + 1])
        end["loaded"] = tip.link == loaded_tip(like).link
    record_branches(bodies)
    hinges = like.hinges.copy()
    hinges["axis"] = 2 + SLIDES * read.slides
    for field in JOINT_FIELDS:
        hinges[field] = getattr(read, field)
    couplings = of_matrices({field: getattr(read, field) for field in COUPLED_FIELDS})
    return dataclasses.replace(
        like, bodies=bodies, hinges=hinges, gravity=read.gravity.copy(), couplings=couplings,
        tips={name: read.n + number for number, name in enumerate(like.tips)}, described=like.described[:0],
    )  # fmt: skip


def _frame(axis: Array) -> Array:
    """Return a rotation matrix whose Z axis is `axis`."""
    x = cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, cross(axis, x), axis], axis=1)


# Springs and dampers between two joints: records have matrices, adapters arrays of dtype `COUPLING`.


def to_matrices(couplings: NDArray[np.void], n: int) -> dict[str, Array]:
    """Return `COUPLED_FIELDS` of n joints: symmetric K_ij and D_ij with zero diagonal, shape (n, n)."""
    fields = {field: np.zeros((n, n)) for field in COUPLED_FIELDS}
    for field, matrix in fields.items():
        i, j = couplings["inner"], couplings["outer"]
        matrix[i, j] = matrix[j, i] = couplings[COUPLED_FIELDS[field]]
    return fields


def of_matrices(fields: Mapping[str, Array]) -> NDArray[np.void]:
    """Convert the matrices `COUPLED_FIELDS` to a list of couplings."""
    K, D = (fields[field] for field in COUPLED_FIELDS)
    inner, outer = np.nonzero(np.triu((K != 0) | (D != 0), 1))
    couplings = np.zeros(len(inner), COUPLING)
    couplings["inner"], couplings["outer"] = inner, outer
    couplings["stiffness"], couplings["damping"] = K[inner, outer], D[inner, outer]
    return couplings


def of_elements(elements: Iterable[ET.Element], joints: Sequence[str]) -> NDArray[np.void]:
    """Return the couplings that flexlink's elements in a file specify; couplings of the same joint pair add up."""
    number, found = {name: k for k, name in enumerate(joints)}, dict[tuple[int, int], Array]()
    for element in elements:
        ends = [element.get(key, "") for key in ("inner", "outer")]
        i, j = sorted(number.get(name, -1) for name in ends)
        if i < 0 or i == j:
            why = f"coupling of {ends[0]!r} and {ends[1]!r}: expected two joints of the file"
            raise ArgumentError(why, id="coupling-in-file")
        try:
            constants = np.array([float(element.get(key, "")) for key in COUPLED_FIELDS.values()])
        except ValueError as error:
            raise ArgumentError(f"coupling of {ends[0]!r} and {ends[1]!r}: {error}", id="coupling-in-file") from None
        found[i, j] = found.get((i, j), 0.0) + constants
    return np.array([(*pair, *constants) for pair, constants in found.items()], dtype=COUPLING)
