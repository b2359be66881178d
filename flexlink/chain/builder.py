"""Build rigid bodies, and the hinges between them, step by step along an arm."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.coordinates import Coordinate
from flexlink.chain.rigid import DESCRIBED, HERE, NOTHING, Pose, SpatialInertia
from flexlink.common.products import product
from flexlink.common.types import Array
from flexlink.describe.rigid_body import RigidBody
from flexlink.kernels.layout import BODY


class Piece(NamedTuple):
    """A straight piece of a link between two of its hinges, along x, for pictures of an arm."""

    link: int  # from 1
    part: tuple[float, float]  # start and end, relative to the link's length
    body: int  # from 1 in the order of `chain.bodies`; 0 is the fixed base
    place: Pose  # pose of its start in the body
    end: Array  # end from the start, along x [m]

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(self.end[0])


@dataclasses.dataclass
class Body:
    """A segment under construction: pose on its parent, range of its hinges, and the inertia added so far."""

    place: Pose
    first: int
    stop: int
    parent: int = 0  # counted from 1, 0 is the base
    rigid: SpatialInertia = NOTHING
    springs: int = 0  # as in `BODY`
    link: Array = dataclasses.field(default_factory=lambda: HERE.R)  # these three as in `DESCRIBED`
    section: Array = dataclasses.field(default_factory=lambda: HERE.R)
    lent: float = 0.0

    def record(self) -> tuple[object, ...]:
        """Return one row of dtype `BODY`; inertia and branches are recorded later."""
        R, p = self.place
        tree = self.parent, 0, 0, 0, 0
        return self.first, self.stop, *tree, 1, self.springs, R, p, 0.0, (0.0, 0.0, 0.0), NOTHING.inertia


def recorded(bodies: list[Body]) -> NDArray[np.void]:
    """Return the bodies as an array of dtype `BODY`."""
    records = np.array([body.record() for body in bodies], dtype=BODY)
    record_inertia(records, [body.rigid for body in bodies])
    records["turned"] = (records["rotation"] != HERE.R).any(axis=(1, 2))
    record_branches(records)
    return records


def described(bodies: list[Body]) -> NDArray[np.void]:
    """Return axes of link and section and the lent inertia of the bodies, as an array of dtype `DESCRIBED`."""
    return np.array([(body.link, body.section, body.lent) for body in bodies], DESCRIBED)


def record_branches(records: NDArray[np.void]) -> None:
    """Record in rows of dtype `BODY`, using `parent`, where branches begin, and which bodies store state for branches.

    >>> bodies = np.zeros(4, BODY)
    >>> bodies["parent"] = 0, 1, 1, 0  # the third body is attached to the first, the fourth to the base
    >>> record_branches(bodies)
    >>> bodies["begins"].tolist(), bodies["slot"].tolist(), bodies["fork"].tolist()
    ([0, 0, 1, 1], [0, 0, 1, 0], [1, 0, 0, 0])
    """
    slots: dict[int, int] = {0: 0}
    records["begins"] = records["parent"] != np.arange(len(records))
    records["slot"] = records["fork"] = 0
    for i in np.flatnonzero(records["begins"]).tolist():
        parent = int(records["parent"][i])
        records["slot"][i] = slots.setdefault(parent, len(slots))
        if parent:
            records["fork"][parent - 1] = slots[parent]


def record_inertia(records: NDArray[np.void], rigid: list[SpatialInertia]) -> None:
    """Write masses, centres and inertias into rows of dtype `BODY`."""
    masses, centers, inertias = zip(*rigid, strict=True)
    records["mass"], records["center"], records["inertia"] = masses, centers, symmetric(np.array(inertias))


def symmetric(inertias: Array) -> Array:
    """Mirror the upper triangle of inertias (…, 3, 3), because R I Rᵀ is symmetric only up to rounding."""
    for row, column in ((0, 1), (0, 2), (1, 2)):
        inertias[..., column, row] = inertias[..., row, column]
    return inertias


def _is_one(R: Array) -> bool:
    """Whether a rotation is the identity, bit by bit."""
    return R is HERE.R or R.tobytes() == HERE.R.tobytes()


class Builder:
    """Builds the chain along the arm; `running` is the pose of the running frame in the current body."""

    def __init__(self) -> None:
        self.hinges: list[tuple[float, ...]] = []
        self.coordinates: list[Coordinate] = []
        self.bodies = [Body(HERE, 0, 0)]
        self.on = 0  # index of the current body
        self.pieces: list[Piece] = []
        self.couplings: list[tuple[int, int, float, float]] = []
        self.running = HERE

    @property
    def place(self) -> tuple[int, Pose]:
        """Current position: the current body, and the running frame in it."""
        return self.on, self.running

    def go_to(self, place: tuple[int, Pose]) -> None:
        """Continue from an earlier `place`."""
        self.on, self.running = place

    @property
    def body(self) -> Body:
        """The current body."""
        return self.bodies[self.on]

    def move(self, translation: Array, rotation: Array | None = None) -> None:
        """Shift the running frame along its own axes [m], then turn it."""
        R, p = self.running
        if self.running is HERE:  # at every segment of a straight beam: no product needed
            self.running = Pose(R if rotation is None else rotation, translation)
            return
        self.running = Pose(R, p + (translation if _is_one(R) else product(R, translation)))
        if rotation is not None:
            self.turn(rotation)

    def advance(self, link: int, part: tuple[float, float], end: Array) -> None:
        """Record a piece of a link, and move to its end."""
        self.pieces.append(Piece(link, part, self.on, self.running, end))
        self.move(end)

    def turn(self, rotation: Array | None) -> None:
        """Turn the running frame: v_before = rotation @ v; None: not at all."""
        R, p = self.running
        if rotation is not None and not (_is_one(rotation) and _is_one(R)):
            self.running = Pose(product(R, rotation), p)

    def turn_section(self, rotation: Array | None) -> None:
        """Turn the running frame at the hinges of the current body, with the axes of its link and section."""
        if rotation is not None:
            self.turn(rotation)
            self.body.link, self.body.section = product(rotation, self.body.link), product(rotation, self.body.section)

    def start_body(self, link: Array = HERE.R, section: Array = HERE.R) -> None:
        """Start a new body at the running frame, without hinges; `link` and `section` as in `DESCRIBED`."""
        n = len(self.hinges)
        self.bodies.append(Body(self.running, n, n, self.on, link=link, section=section))
        self.go_to((len(self.bodies) - 1, HERE))

    def add_hinge(
        self, coordinate: Coordinate, axis: int, stiffness: float = 0.0, damping: float = 0.0, coulomb: float = 0.0,
        width: float = 1.0, *, armature: float = 0.0, lower: float = -np.inf, upper: float = np.inf, held: bool = False,
        rest: float = 0.0,
    ) -> None:  # fmt: skip
        """Add a hinge to the current body; axis and units as in dtype `HINGE`."""
        self.hinges.append((axis, stiffness, rest, damping, coulomb, width, armature, lower, upper, held))
        self.coordinates.append(coordinate)
        self.body.stop += 1

    def add_payload(self, payload: RigidBody) -> None:
        """Join a payload, given in the running frame, to the current body; without mass and inertia, do nothing."""
        self.body.rigid = self.carrying(payload)

    def carrying(self, payload: RigidBody) -> SpatialInertia:
        """Return the current body joined to a payload."""
        if not payload.mass and not any(payload.inertia):
            return self.body.rigid
        return self._joined(SpatialInertia(payload.mass, np.array(payload.center), payload.matrix))

    def add(self, body: SpatialInertia) -> None:
        """Join a rigid body, given in the running frame, to the current body."""
        self.body.rigid = self._joined(body)

    def _joined(self, body: SpatialInertia) -> SpatialInertia:
        rigid, moved = self.body.rigid, body if self.running is HERE else body.moved(self.running)
        return moved if rigid is NOTHING else rigid.plus(moved)
