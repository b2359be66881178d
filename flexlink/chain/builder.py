"""Rigid bodies as they grow while one walks along an arm, and the hinges between them."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Coordinate
from flexlink.describe.rigid_body import Payload

Array = NDArray[np.float64]


@dataclasses.dataclass
class Body:
    """A rigid body while it grows: placement on its parent, mass, first moment and inertia about its centre."""

    rotation: Array
    translation: Array
    first: int
    stop: int
    mass: float = 0.0
    center: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    inertia: Array = dataclasses.field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, mass: float, center: Array, inertia: Array) -> None:
        """Join another rigid body; both inertias are moved to the common centre (parallel axes)."""
        if mass > 0:
            d = center - self.center
            reduced = self.mass * mass / (self.mass + mass)
            self.inertia = self.inertia + reduced * (d @ d * np.eye(3) - np.outer(d, d))
            self.center = self.center + d * (mass / (self.mass + mass))
            self.mass += mass
        self.inertia = self.inertia + inertia

    def record(self) -> tuple[object, ...]:
        """One row of dtype `BODY`."""
        turned = int(not np.array_equal(self.rotation, np.eye(3)))
        inertia = np.triu(self.inertia) + np.triu(self.inertia, 1).T  # R I Rᵀ is symmetric up to rounding only
        return self.first, self.stop, turned, self.rotation, self.translation, self.mass, self.center, inertia


class Builder:
    """Walks along the arm: `rotation`, `translation` place the running frame in the frame of the current body."""

    def __init__(self) -> None:
        self.hinges: list[tuple[float, ...]] = []
        self.coordinates: list[Coordinate] = []
        self.bodies = [Body(np.eye(3), np.zeros(3), 0, 0)]
        self.rotation, self.translation = np.eye(3), np.zeros(3)

    def move(self, translation: Array, rotation: Array | None = None) -> None:
        """Shift the running frame along its own axes [m], then turn it."""
        self.translation = self.translation + self.rotation @ translation
        if rotation is not None:
            self.turn(rotation)

    def turn(self, rotation: Array) -> None:
        """Turn the running frame: v_before = rotation @ v."""
        self.rotation = self.rotation @ rotation

    def start_body(self) -> None:
        """A new body begins in the running frame, with no hinges yet."""
        n = len(self.hinges)
        self.bodies.append(Body(self.rotation, self.translation, n, n))
        self.rotation, self.translation = np.eye(3), np.zeros(3)

    def add_hinge(
        self,
        coordinate: Coordinate,
        axis: int,
        stiffness: float = 0.0,
        damping: float = 0.0,
        coulomb: float = 0.0,
        width: float = 1.0,
        *,
        armature: float = 0.0,
        lower: float = -np.inf,
        upper: float = np.inf,
        prescribed: bool = False,
    ) -> None:
        """One more hinge of the current body, about X, Y or Z of its frame; units as in dtype `HINGE`."""
        rest = 0.0
        self.hinges.append((axis, stiffness, rest, damping, coulomb, width, armature, lower, upper, prescribed))
        self.coordinates.append(coordinate)
        self.bodies[-1].stop += 1

    def add_payload(self, payload: Payload) -> None:
        """Join a body that is described in the running frame to the current one."""
        self.add_inertia(payload.mass, np.array(payload.center), payload.matrix)

    def add_inertia(self, mass: float, center: Array, inertia: Array) -> None:
        """The same by mass [kg], centre [m] and inertia about it [kg m²]."""
        R = self.rotation
        self.bodies[-1].add(mass, self.translation + R @ center, R @ inertia @ R.T)
