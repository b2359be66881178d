"""Information of data about the parameters: Jacobians over the noise, of the present data and of experiments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.identification.coordinates import Coordinate, prior_rows
from flexlink.identification.data import Source
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.likelihood import large_changes, row_of, stacked
from flexlink.identification.signals import STEP, Signals
from flexlink.motion.slopes_of_runs import CENTRAL_4


class Information(NamedTuple):
    """A Jacobian over the noise, compressed to one row per column, with the names of its columns.

    Attributes
    ----------
    R
        Triangular factor of the Jacobian, with the same singular values, shape (rows, names).
    names
        Parameters, then gains and biases.
    error
        Norm of the error of the Jacobian.
    """

    R: Array
    names: tuple[str, ...]
    error: float

    def with_(self, others: Iterable[Information]) -> Information:
        """All information together; columns with the same name are the same unknown."""
        parts = [self, *others]
        names = tuple(dict.fromkeys(name for part in parts for name in part.names))
        rows = []
        for part in parts:
            J = np.zeros((len(part.R), len(names)))
            J[:, [names.index(name) for name in part.names]] = part.R
            rows.append(J)
        return Information(_compressed(np.vstack(rows)), names, float(np.hypot.reduce([p.error for p in parts])))

    @property
    def check(self) -> Check:
        """Identifiability check of this information."""
        return checked(self.R, self.error, self.names)


class Sensitivities:
    """Jacobians of all blocks of sources at one point, with two step sizes of the finite differences."""

    def __init__(self, sources: Sequence[Source], coordinates: Sequence[Coordinate], x: Array) -> None:
        signals = Signals(sources, coordinates)
        signals.ahead([*signals.around(x, CENTRAL_4), *signals.around(x, CENTRAL_4, STEP / 2)])
        self.sources, self.coordinates, self.x = sources, coordinates, x
        self.model = signals.model(x)
        self.both = signals.slopes(x, CENTRAL_4), signals.slopes(x, CENTRAL_4, STEP / 2)

    def of(
        self, blocks: Sequence[Iterable[int]], linear: Sequence[str], with_priors: Sequence[Coordinate]
    ) -> Information:
        """Information of some blocks of every source, and of the priors of some coordinates.

        Raises
        ------
        ArgumentError
            A derivative is not finite.
        """
        kept = [[source.blocks[k] for k in of] for source, of in zip(self.sources, blocks, strict=True)]
        residuals, known = prior_rows(self.coordinates, self.x)
        having = [one for one in self.coordinates if one.prior is not None]
        known = known[[k for k in range(len(residuals)) if having[k] in with_priors]]
        scale = np.array([1.0] * len(self.x) + large_changes(kept))
        J, finer = (
            scale * stacked([
                [row_of(source.blocks[k], self.model[n][k], slopes[n][k]) for k in of]
                for n, (source, of) in enumerate(zip(self.sources, blocks, strict=True))
            ], len(self.x), known)
            for slopes in self.both
        )  # fmt: skip
        if not (np.isfinite(J).all() and np.isfinite(finer).all()):
            raise ArgumentError("its derivatives are not finite", id="not-finite")
        names = (*(one.name for one in self.coordinates), *linear)
        return Information(_compressed(J), names, float(np.linalg.norm(J - finer, 2)))


def _compressed(J: Array) -> Array:
    return np.asarray(np.linalg.qr(J, mode="r")) if len(J) > J.shape[1] else J
