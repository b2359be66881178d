"""A floating base during integration: its three angles stay small because their reference attitude follows the base.

When the base has turned by more than `FAR`, its attitude becomes the new reference and the angles restart at zero. This
changes the coordinates, not the motion, and keeps the angle about Y far from 90°. Each new reference, a unit
quaternion, is the previous one multiplied by the rotation since then.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.rigid import matrix_from_quaternion, quaternion_from_matrix, rates_matrices
from flexlink.common.types import Array
from flexlink.dynamics.bound import unbind
from flexlink.dynamics.conserved import Momentum, momentum_of_states
from flexlink.kernels.forward.articulated_rows import BODY_ROW
from flexlink.kernels.forward.mass_plus_shapes import ShapedPosture
from flexlink.kernels.geometry.kinematics import attitudes, rates_of_angles
from flexlink.kernels.tools.machine_code import direct

FAR = 0.5  # angle of a base [rad] at which its reference attitude is changed
BODY = 1  # index of the base in `bodies`
ANGLES = slice(3, 6)  # indices of the base's angles among the coordinates
References = list[tuple[int, Array]]  # reference attitudes of a run, each with the index of its first sample


class FloatingBase:
    """A chain whose base has a changeable reference attitude, and the reference attitude at each sample of a run."""

    def __init__(self, chain: Chain) -> None:
        bodies = chain.bodies.copy()
        self.original, self._rotation = chain, bodies["rotation"][BODY]
        view = bodies.view()  # read-only, as kernels require
        self.chain = chain.with_numbers(bodies=view)
        self.start = self._taken = np.array(quaternion_from_matrix(self._rotation))
        self._back = self.start * np.array([1.0, -1.0, -1.0, -1.0])
        self.begin()

    def begin(self) -> None:
        """Reset to the start of a run."""
        self.attitude, self.references = self.start, [(0, self.start)]
        self.take(self.start)

    def momentum(self, references: References, q: Array, qd: Array) -> Momentum:
        """Momentum at the samples of a run with these reference attitudes, whatever run has begun since."""
        base = FloatingBase(self.original)
        base.start = base.attitude = base._taken = self.start
        base.references = references
        parts = [momentum_of_states(base.chain, q[part], qd[part]) for part in base.parts(0, len(q))]
        return Momentum(*map(np.concatenate, zip(*parts, strict=True)))

    def turn(self, row: int, q: Array, qd: Array, *scratch: Any) -> None:
        """Use the base's present attitude as the reference from sample `row` on; updates q, q̇ and the workspace."""
        angles = q[ANGLES]
        if angles.any():
            self.attitude = self._attitudes([(0, self.attitude)], q[None], qd[None])[0][0]
            qd[ANGLES] = rates_matrices(angles) @ qd[ANGLES]
            q[ANGLES] = 0.0
        self.references.append((row, self.attitude))
        self.take(self.attitude, *scratch)

    def take(self, attitude: Array, *scratch: Any) -> None:
        """Write an attitude wherever kernels read it: in the chain, and in workspaces that copy the chain's data."""
        if attitude is not self._taken:
            given = self.original.bodies["rotation"][BODY]
            self._rotation[...] = given if attitude is self.start else matrix_from_quaternion(attitude.tolist())
            self._taken = attitude
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
        for (row, attitude), end in zip(self.references, [row for row, _ in self.references[1:]] + [stop], strict=True):
            part = slice(max(first, row), min(stop, end))
            if part.start < part.stop and attitude is self.attitude:  # already set
                yield part
            elif part.start < part.stop:
                try:
                    self.take(attitude, *scratch)
                    yield part
                finally:
                    self.take(self.attitude, *scratch)

    def from_the_start(self, q: Array, qd: Array, of: References | None = None) -> tuple[Array, Array, Array, Array]:
        """q and q̇ of a run's samples (rows, n) in coordinates of `original`, with attitudes and angular velocities."""
        q, qd = q.copy(), qd.copy()
        turned, spins, tangents = self._attitudes(of or self.references, q, qd)
        np.arctan2(tangents[0], tangents[1], out=q[:, ANGLES])
        _run(rates_of_angles, q, spins, qd)
        return q, qd, turned, spins

    def relative_to_start(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """The present state (n,) in coordinates of `original`."""
        q, qd, *_ = self.from_the_start(q[None], qd[None], [(0, self.attitude)])
        return q[0], qd[0]

    def _attitudes(self, references: References, q: Array, qd: Array) -> tuple[Array, ...]:
        rows, known = zip(*references, strict=True)
        found = np.empty((len(q), 4)), np.empty((len(q), 3)), np.empty((2, len(q), 3))
        _run(attitudes, np.array(rows), np.array(known), self._back, q, qd, *found)
        return found


def _run(kernel: Any, *arrays: Array) -> None:
    direct(kernel, *arrays, types=b"writable")(*arrays)


def rows_of(scratch: Any) -> Any:
    """Body data of a workspace for forward dynamics or for steps; None if the workspace reads the chain's data."""
    rows = getattr(scratch, "posture", scratch)
    rows = rows.hinges if isinstance(rows, ShapedPosture) else rows
    return getattr(rows, "rows", getattr(rows, "bodies", None))
