"""A floating base during integration: its three angles stay small because their reference attitude follows the base.

When the base has turned by more than `FAR`, its attitude becomes the new reference and the angles restart at zero. This
changes the coordinates, not the motion, and keeps the angle about Y far from 90°. Each new reference, a unit
quaternion, is the previous one multiplied by the rotation since then.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.rigid import (
    angles_of,
    matrices_from_quaternions,
    matrix_from_quaternion,
    product_of,
    quaternion_from_matrix,
    quaternions_of,
    rates_matrices,
)  # fmt: skip
from flexlink.common.types import Array
from flexlink.dynamics.bound import unbind
from flexlink.kernels.forward.articulated_rows import BODY_ROW
from flexlink.kernels.forward.mass_plus_shapes import ShapedPosture

FAR = 0.5
"""Angle of a base [rad] at which its reference attitude is changed."""
BODY = 1
"""Index of the base in `bodies`."""
ANGLES = slice(3, 6)
"""Indices of the base's angles among the coordinates."""


class FloatingBase:
    """A chain whose base has a changeable reference attitude, and the reference attitude at each sample of a run."""

    def __init__(self, chain: Chain) -> None:
        bodies = chain.bodies.copy()
        self.original, self._rotation = chain, bodies["rotation"][BODY]
        view = bodies.view()  # read-only, as kernels require
        self.chain = chain.with_numbers(bodies=view)
        self.start = np.array(quaternion_from_matrix(self._rotation))
        self.begin()

    def begin(self) -> None:
        """Reset to the start of a run."""
        self.attitude, self.references = self.start, [(0, self.start)]
        self._rotation[...] = self.original.bodies["rotation"][BODY]
        unbind(self.chain)

    def turn(self, row: int, q: Array, qd: Array, *scratch: Any) -> None:
        """Use the base's present attitude as the reference from sample `row` on; updates q, q̇ and the workspace."""
        angles = q[ANGLES]
        if angles.any():
            self.attitude = product_of(self.attitude, quaternions_of(angles))
            qd[ANGLES] = rates_matrices(angles) @ qd[ANGLES]
            q[ANGLES] = 0.0
        self.references.append((row, self.attitude))
        self.take(self.attitude, *scratch)

    def take(self, attitude: Array, *scratch: Any) -> None:
        """Write an attitude wherever kernels read it: in the chain, and in workspaces that copy the chain's data."""
        if attitude is not self.start:
            self._rotation[...] = matrix_from_quaternion(attitude.tolist())
        else:
            self._rotation[...] = self.original.bodies["rotation"][BODY]
        unbind(self.chain)
        for rows in map(rows_of, scratch):
            if rows is not None:
                rows[BODY, BODY_ROW.mount : BODY_ROW.mount + 9] = self._rotation.T.ravel()

    def saved(self) -> tuple[Array, int]:
        """Return the data that `turn` changes, for `restore`."""
        return self.attitude, len(self.references)

    def restore(self, saved: tuple[Array, int], *scratch: Any) -> None:
        """Restore the state returned by `saved`."""
        self.attitude, known = saved
        del self.references[known:]
        self.take(self.attitude, *scratch)

    def parts(self, first: int, stop: int, *scratch: Any) -> Iterator[slice]:
        """Yield slices of samples first … stop − 1 with equal reference attitude, after setting this attitude."""
        for part, attitude in self._parts(first, stop):
            if attitude is self.attitude:  # already set
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
        """q and q̇ of a run's samples (rows, n) in coordinates of `original`, with attitudes and angular velocities."""
        attitudes, spins = self.attitudes(q), np.einsum("kij,kj->ki", rates_matrices(q[:, ANGLES]), qd[:, ANGLES])
        q, qd = q.copy(), qd.copy()
        q[:, ANGLES] = self.angles(attitudes)
        qd[:, ANGLES] = np.linalg.solve(rates_matrices(q[:, ANGLES]), spins[..., None])[..., 0]
        return q, qd, attitudes, spins

    def angles(self, attitudes: Array) -> Array:
        """Angles that turn the base from its initial attitude to `attitudes` (rows, 4), shape (rows, 3) [rad]."""
        back = self.start * np.array([1.0, -1.0, -1.0, -1.0])
        return angles_of(matrices_from_quaternions(product_of(back, attitudes)))

    def relative_to_start(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """The present state (n,) in coordinates of `original`."""
        ω = rates_matrices(q[ANGLES]) @ qd[ANGLES]
        q, qd = q.copy(), qd.copy()
        q[ANGLES] = self.angles(product_of(self.attitude, quaternions_of(q[ANGLES]))[None])[0]
        qd[ANGLES] = np.linalg.solve(rates_matrices(q[ANGLES]), ω)
        return q, qd


def rows_of(scratch: Any) -> Any:
    """Body data of a workspace for forward dynamics or for steps; None if the workspace reads the chain's data."""
    rows = getattr(scratch, "posture", scratch)
    rows = rows.hinges if isinstance(rows, ShapedPosture) else rows
    return getattr(rows, "rows", getattr(rows, "bodies", None))
