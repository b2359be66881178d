"""A floating base as steps see it: its three angles stay small, as the attitude that they turn it from follows it.

Steps go on from the angles zero wherever the base has turned by more than `FAR`, with the attitude that it has there as
the new reference. This changes coordinates, not the motion: an angle about Y of 90° is never near, and an attitude is
a unit quaternion, multiplied by the turn that was made.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.free_base import (
    angles_of,
    product_of,
    quaternions_of,
    rates_matrices,
)
from flexlink.chain.rotation import matrices_from_quaternions, matrix_from_quaternion, quaternion_from_matrix
from flexlink.common.types import Array
from flexlink.kernels.forward.articulated_rows import BODY_ROW

FAR = 0.5
"""Angle of a base [rad] from which steps go on in other coordinates."""
BODY, ANGLES = 1, slice(3, 6)
"""Number in `bodies` of the base, and its angles among the coordinates."""


class FloatingBase:
    """A chain whose reference attitude can be changed, and what it was in which samples of a run.

    Attributes
    ----------
    original
        The chain with the attitude that it starts from.
    chain
        The same one, with the present attitude.
    attitude
        The present one, a unit quaternion w, x, y, z.
    """

    def __init__(self, chain: Chain) -> None:
        bodies = chain.bodies.copy()
        self.original, self._rotation = chain, bodies["rotation"][BODY]
        seen = bodies.view()  # read-only, as kernels expect of a chain
        self.chain = chain.with_numbers(bodies=seen)
        self.start = np.array(quaternion_from_matrix(self._rotation))
        self.begin()

    def begin(self) -> None:
        """Be where a run starts."""
        self.attitude, self.references = self.start, [(0, self.start)]
        self._rotation[...] = self.original.bodies["rotation"][BODY]

    def turn(self, row: int, q: Array, qd: Array, *scratch: Any) -> None:
        """Take the attitude at a state as the reference from a sample on; changes q and q̇, and tells the scratch."""
        angles = q[ANGLES]
        if angles.any():
            self.attitude = product_of(self.attitude, quaternions_of(angles))
            qd[ANGLES] = rates_matrices(angles) @ qd[ANGLES]
            q[ANGLES] = 0.0
        self.references.append((row, self.attitude))
        self.take(self.attitude, *scratch)

    def take(self, attitude: Array, *scratch: Any) -> None:
        """Put an attitude where kernels read it: into the chain, and into scratch that holds numbers of it."""
        if attitude is not self.start:
            self._rotation[...] = matrix_from_quaternion(attitude.tolist())
        else:
            self._rotation[...] = self.original.bodies["rotation"][BODY]
        for rows in map(rows_of, scratch):
            if rows is not None:
                rows[BODY, BODY_ROW.mount : BODY_ROW.mount + 9] = self._rotation.T.ravel()

    def saved(self) -> tuple[Array, int]:
        """What `turn` changes, for `restore`."""
        return self.attitude, len(self.references)

    def restore(self, saved: tuple[Array, int], *scratch: Any) -> None:
        """Go back to where `saved` was."""
        self.attitude, known = saved
        del self.references[known:]
        self.take(self.attitude, *scratch)

    def parts(self, first: int, stop: int, *scratch: Any) -> Iterator[slice]:
        """Samples first … stop − 1 by the attitude that they are told from, which is there meanwhile."""
        for part, attitude in self._parts(first, stop):
            if attitude is self.attitude:  # which is there
                yield part
                continue
            try:
                self.take(attitude, *scratch)
                yield part
            finally:
                self.take(self.attitude, *scratch)

    def _parts(self, first: int, stop: int) -> Iterator[tuple[slice, Array]]:
        ends = [row for row, _ in self.references[1:]] + [stop]
        for (row, attitude), end in zip(self.references, ends, strict=True):
            if max(first, row) < min(stop, end):
                yield slice(max(first, row), min(stop, end)), attitude

    def attitudes(self, q: Array) -> Array:
        """Unit quaternions w, x, y, z of a run's samples (rows, n), shape (rows, 4)."""
        found = np.empty((len(q), 4))
        for part, reference in self._parts(0, len(q)):
            found[part] = product_of(reference, quaternions_of(q[part, ANGLES]))
        return found

    def from_the_start(self, q: Array, qd: Array) -> tuple[Array, Array, Array, Array]:
        """q and q̇ of a run's samples (rows, n) as coordinates of `original`, with attitudes and angular velocities."""
        attitudes, spins = self.attitudes(q), np.einsum("kij,kj->ki", rates_matrices(q[:, ANGLES]), qd[:, ANGLES])
        q, qd = q.copy(), qd.copy()
        q[:, ANGLES] = self.angles(attitudes)
        qd[:, ANGLES] = np.linalg.solve(rates_matrices(q[:, ANGLES]), spins[..., None])[..., 0]
        return q, qd, attitudes, spins

    def angles(self, attitudes: Array) -> Array:
        """Angles that turn the base from the attitude at the start to others, (rows, 4), shape (rows, 3) [rad]."""
        back = self.start * np.array([1.0, -1.0, -1.0, -1.0])
        return angles_of(matrices_from_quaternions(product_of(back, attitudes)))

    def told_from_start(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """The present state (n,) as coordinates of `original`."""
        ω = rates_matrices(q[ANGLES]) @ qd[ANGLES]
        q, qd = q.copy(), qd.copy()
        q[ANGLES] = self.angles(product_of(self.attitude, quaternions_of(q[ANGLES]))[None])[0]
        qd[ANGLES] = np.linalg.solve(rates_matrices(q[ANGLES]), ω)
        return q, qd


def rows_of(scratch: Any) -> Any:
    """The rows of numbers of bodies in scratch of forward dynamics or of steps; None: it reads those of the chain."""
    rows = getattr(scratch, "posture", scratch)
    return getattr(rows, "rows", getattr(rows, "bodies", None))
