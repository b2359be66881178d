"""Information of data about the parameters: Jacobians over the noise, of the present data and of experiments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.likelihood import Likelihood, likelihood
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


def in_two_steps(signals: Signals, x: Array, blocks: Sequence[Sequence[Block]]) -> tuple[Likelihood, Likelihood]:
    """Likelihood at a point, with finite differences of two step sizes.

    Raises
    ------
    FlexlinkError
        The simulation fails.
    """
    signals.ahead([*signals.around(x, CENTRAL_4), *signals.around(x, CENTRAL_4, STEP / 2)])
    slopes, finer = signals.slopes(x, CENTRAL_4), signals.slopes(x, CENTRAL_4, STEP / 2)
    return likelihood(signals, x, blocks, slopes), likelihood(signals, x, blocks, finer)


def information_of(at: Likelihood, finer: Likelihood) -> Information:
    """Information of data and priors; `finer` has derivatives with another step size.

    Raises
    ------
    ArgumentError
        A derivative is not finite.
    """
    J, other = at.scaled, finer.scaled
    if not (np.isfinite(J).all() and np.isfinite(other).all()):
        raise ArgumentError("the derivatives of the predictions are not finite", id="not-finite")
    return Information(_compressed(J), at.names, float(np.linalg.norm(J - other, 2)))


def _compressed(J: Array) -> Array:
    return np.asarray(np.linalg.qr(J, mode="r")) if len(J) > J.shape[1] else J
