"""Likelihood of the parameters from priors and from residuals, which are normalized by their noise and whitened.

    r = (g y(x) + b + d (t − t̄) − measured) / σ        ∂r/∂x ≈ (1 − Φ Φ⁺) g ∂y/∂x / σ,  Φ = [y, 1, t − t̄] / σ

Gains g, biases b and drifts d are linear and take their optimal values for every x (variable projection, Golub and
Pereyra 1973, with Kaufman's approximation of the Jacobian). A filter whitens autocorrelated residuals and their
Jacobian.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate, prior_rows
from flexlink.identification.data import Source
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.problem import Loss
from flexlink.identification.signals import STEP, Signals, Slopes
from flexlink.motion.slopes_of_runs import CENTRAL_4


class Row(NamedTuple):
    """Residual and Jacobian of a block at one point."""

    block: Block  # the measurements
    y: Array  # prediction, shape (n,)
    residual: Array  # residual over the noise, shape (n,)
    # gain, bias, drift: optimal values; 1, 0 and 0 if they are known
    gain: float
    bias: float
    drift: float
    slopes: Array  # ∂residual/∂x with optimal gain, bias and drift, shape (n, coordinates); empty if not requested
    whole: Array  # ∂residual/∂(x, gain, bias, drift) with these as parameters, shape (n, coordinates + 0 to 3)

    @property
    def shown(self) -> Array:
        """What the instrument shows for the prediction, with the optimal gain, bias and drift, shape (n,)."""
        shown = self.gain * self.y + self.bias
        return shown + self.drift * _centred(self.block) if self.drift else shown


def row_of(block: Block, y: Array, slopes: Array | None = None) -> Row:
    """Residual and Jacobian of a block for a prediction y; `slopes` is ∂y/∂x, shape (n, coordinates)."""
    whiten, used = block.colour.whitened if block.colour is not None else np.asarray, block.used[:, None]

    def by(columns: Array) -> Array:
        return np.asarray(whiten(used * columns))

    unknown = [{"gain": y, "bias": np.ones(len(y)), "drift": _centred(block)}[what] for what in block.linear]
    Φ = by(np.array(unknown).T.reshape(len(y), len(unknown)) / block.σ[:, None])
    target = by(((block.y - (0.0 if block.gain else y)) / block.σ)[:, None])[:, 0]
    best = _solved(Φ, target)
    residual = Φ @ best - target
    found = dict(zip(block.linear, best.tolist(), strict=True))
    gain, bias, drift = found.get("gain", 1.0), found.get("bias", 0.0), found.get("drift", 0.0)
    if slopes is None:
        return Row(block, y, residual, gain, bias, drift, np.empty((len(y), 0)), Φ)
    fixed = by(gain * slopes / block.σ[:, None])
    return Row(block, y, residual, gain, bias, drift, fixed - Φ @ _solved(Φ, fixed), np.hstack([fixed, Φ]))


def _centred(block: Block) -> Array:
    """Times of a block, relative to their mean, shape (n,) [s]; zeros for single measurements."""
    return np.zeros(len(block.y)) if block.t is None else np.asarray(block.t - block.t.mean())


def _solved(Φ: Array, target: Array) -> Array:
    return np.asarray(np.linalg.lstsq(Φ, target, rcond=None)[0]) if Φ.shape[1] else np.zeros((0, *target.shape[1:]))


def white(block: Block) -> Block:
    """The block, with its noise replaced by white noise of the same standard deviation."""
    return block if block.colour is None else dataclasses.replace(block, σ=block.σ / block.colour.share, colour=None)


class Likelihood(NamedTuple):
    """Residuals of priors and data at one point, and their Jacobians; those of the priors come first.

    All parameters are the coordinates, then the unknown gains, biases and drifts of every block.
    """

    # coordinates, x: parameters of the scenes, and the point, shape (coordinates,)
    coordinates: Sequence[Coordinate]
    x: Array
    sources: Sequence[Source]  # the measurements
    rows: Sequence[Sequence[Row]]  # residuals and Jacobians of the blocks of every source

    @property
    def every(self) -> list[Row]:
        """The rows of all sources."""
        return [row for part in self.rows for row in part]

    @property
    def of_priors(self) -> Array:
        """Residuals of the priors, shape (priors,)."""
        return prior_rows(self.coordinates, self.x)[0]

    @property
    def residual(self) -> Array:
        """All residuals, shape (priors + samples,)."""
        return np.concatenate([self.of_priors, *(row.residual for row in self.every)])

    @property
    def slopes(self) -> Array:
        """∂residual/∂x with optimal gains, biases and drifts, shape (priors + samples, coordinates)."""
        return np.vstack([prior_rows(self.coordinates, self.x)[1], *(row.slopes for row in self.every)])

    @property
    def covariance(self) -> Array:
        """Covariance of x for white noise of the assumed size, with optimal gains, biases and drifts."""
        J = self.slopes
        return np.asarray(np.linalg.pinv(J.T @ J))

    @property
    def priors(self) -> Array:
        """∂residual/∂(all parameters) of the priors, shape (priors, parameters)."""
        _, known = prior_rows(self.coordinates, self.x)
        return np.hstack([known, np.zeros((len(known), len(self.linear)))])

    @property
    def jacobians(self) -> list[list[Array]]:
        """∂residual/∂(all parameters) of the blocks of every source, shape (n, parameters) each."""
        count = len(self.x)
        found, at, width = list[list[Array]](), count, count + len(self.linear)
        for part in self.rows:
            found.append([])
            for row in part:
                J, end = np.zeros((len(row.residual), width)), at + len(row.block.linear)
                J[:, :count], J[:, at:end] = row.whole[:, :count], row.whole[:, count:]
                found[-1].append(J)
                at = end
        return found

    @property
    def scaled(self) -> Array:
        """Jacobian of all residuals with respect to typical large changes of all parameters."""
        large = [1.0] * len(self.x) + [_large(row.block, what) for row in self.every for what in row.block.linear]
        return np.asarray(np.vstack([self.priors, *(J for part in self.jacobians for J in part)]) * np.array(large))

    @property
    def linear(self) -> Array:
        """Optimal values of the unknown gains, biases and drifts."""
        return np.array([getattr(row, what) for row in self.every for what in row.block.linear])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return (*(one.name for one in self.coordinates), *(
            f"{what} of {row.block.name} of {source.name!r}"
            for source, part in zip(self.sources, self.rows, strict=True) for row in part for what in row.block.linear
        ))  # fmt: skip


def likelihood(
    signals: Signals, x: Array, blocks: Sequence[Sequence[Block]], slopes: Slopes | None = None
) -> Likelihood:
    """Likelihood at a point, of blocks with a noise; with Jacobians if `slopes` of the predictions are given."""
    y = signals.model(x)
    J: Sequence[Sequence[Array | None]] = slopes or [[None] * len(part) for part in y]
    rows = [[row_of(*one) for one in zip(*part, strict=True)] for part in zip(blocks, y, J, strict=True)]
    return Likelihood(signals.coordinates, x, signals.sources, rows)


def _large(block: Block, what: str) -> float:
    """Typical large change of a gain, a bias or a drift."""
    size = 1.0 if what == "gain" else float(np.ptp(block.y)) or 1.0
    return size / float(np.ptp(_centred(block))) if what == "drift" else size


# Loss functions ρ of residuals e, and their influence functions ψ = ρ'/2 (Huber, Robust statistics, 1981).


class LossFunction(NamedTuple):
    """A loss function of residuals, which are divided by the standard deviation of the noise."""

    rho: Callable[[Array], Array]  # loss ρ(e); e² for least squares
    # influence ψ(e), divided by its mean slope: residuals with which least squares has the same covariance
    psi: Callable[[Array], Array]


SQUARES = LossFunction(np.square, np.asarray)
LOSSES: dict[Loss, LossFunction] = {
    "linear": SQUARES,
    "trimmed": SQUARES,
    "huber": LossFunction(
        lambda e: np.where(np.abs(e) <= 1, e**2, 2 * np.abs(e) - 1),
        lambda e: np.clip(e, -1.0, 1.0) / max(float(np.mean(np.abs(e) <= 1)), 0.1),
    ),
    "soft_l1": LossFunction(
        lambda e: 2 * (np.sqrt(1 + e**2) - 1), lambda e: e / np.sqrt(1 + e**2) / np.mean((1 + e**2) ** -1.5)
    ),
}
"""Loss functions by name, as `scipy.optimize.least_squares` defines them for a scale of 1."""


class Information(NamedTuple):
    """A Jacobian over the noise, compressed to one row per column, with the names of its columns."""

    R: Array  # triangular factor of the Jacobian, with the same singular values, shape (rows, names)
    names: tuple[str, ...]  # parameters, then gains and biases
    error: float  # norm of the error of the Jacobian

    def with_(self, others: "Iterable[Information]") -> "Information":
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
    """Likelihood at a point, with finite differences of two step sizes."""
    signals.ahead([*signals.around(x, CENTRAL_4), *signals.around(x, CENTRAL_4, STEP / 2)])
    slopes, finer = signals.slopes(x, CENTRAL_4), signals.slopes(x, CENTRAL_4, STEP / 2)
    return likelihood(signals, x, blocks, slopes), likelihood(signals, x, blocks, finer)


def information_of(at: Likelihood, finer: Likelihood) -> Information:
    """Information of data and priors; `finer` has derivatives with another step size."""
    J, other = at.scaled, finer.scaled
    if not (np.isfinite(J).all() and np.isfinite(other).all()):
        raise ArgumentError("the derivatives of the predictions are not finite", id="not-finite")
    return Information(_compressed(J), at.names, float(np.linalg.norm(J - other, 2)))


def _compressed(J: Array) -> Array:
    return np.asarray(np.linalg.qr(J, mode="r")) if len(J) > J.shape[1] else J
