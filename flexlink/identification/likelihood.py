"""The likelihood of numbers: residuals over their noise, whitened where they are autocorrelated, and priors.

    r = (g y(x) + b − measured) / σ        ∂r/∂x ≈ (1 − Φ Φ⁺) g ∂y/∂x / σ,  Φ = [y, 1] / σ of those that are unknown

Gains g and biases b are linear, and at their best for every x (variable projection, Golub and Pereyra 1973, with
Kaufman's slope). Where the noise is autocorrelated, all pass through a filter that makes it white.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.block import Block, colour_of
from flexlink.identification.coordinates import Coordinate, prior_rows
from flexlink.identification.data import Source
from flexlink.identification.signals import Signals


class Row(NamedTuple):
    """A block at one point.

    Attributes
    ----------
    residual
        Over its noise, shape (n,).
    gain, bias
        At their best; 1 and 0 where they are known.
    slopes
        ∂residual/∂x with gain and bias at their best, shape (n, coordinates); empty without slopes.
    whole
        The same with them held, and columns of ∂residual/∂ gain and bias behind.
    """

    residual: Array
    gain: float
    bias: float
    slopes: Array
    whole: Array


def row_of(block: Block, y: Array, slopes: Array | None = None) -> Row:
    """A block beside what the scene gives, and its slopes, shape (n, coordinates)."""
    by = block.colour.whitened if block.colour is not None else np.asarray
    unknown = [column for column, sought in ((y, block.gain), (np.ones(len(y)), block.bias)) if sought]
    Φ = by(np.array(unknown).T.reshape(len(y), len(unknown)) / block.σ[:, None])
    target = by(((block.y - (0.0 if block.gain else y)) / block.σ)[:, None])[:, 0]
    best = _solved(Φ, target)
    residual = Φ @ best - target
    gain = float(best[0]) if block.gain else 1.0
    bias = float(best[-1]) if block.bias else 0.0
    if slopes is None:
        return Row(residual, gain, bias, np.empty((len(y), 0)), Φ)
    held = by(gain * slopes / block.σ[:, None])
    return Row(residual, gain, bias, held - Φ @ _solved(Φ, held), np.hstack([held, Φ]))


def _solved(Φ: Array, target: Array) -> Array:
    if not Φ.shape[1]:
        return np.zeros((0, *target.shape[1:]))
    return np.asarray(np.linalg.lstsq(Φ, target, rcond=None)[0])


class Likelihood:
    """Residuals of all sources and priors as functions of the coordinates.

    Parameters
    ----------
    signals
        What the scene predicts.
    loss
        As `scipy.optimize.least_squares` has it.
    coloured
        Whether noise of runs may be autocorrelated.
    """

    def __init__(self, signals: Signals, loss: str, *, coloured: bool = False) -> None:
        self.signals, self.loss, self.coloured = signals, loss, coloured
        self.coordinates: Sequence[Coordinate] = signals.coordinates

    def rows(self, x: Array, blocks: Sequence[Sequence[Block]], *, slopes: bool = True) -> list[list[Row]]:
        """All blocks at a point; errors as in `Signals.model`."""
        y = self.signals.model(x)
        if not slopes:
            return [[row_of(*one) for one in zip(*part, strict=True)] for part in zip(blocks, y, strict=True)]
        J = self.signals.slopes(x)
        return [[row_of(*one) for one in zip(*part, strict=True)] for part in zip(blocks, y, J, strict=True)]

    def cost(self, x: Array, blocks: Sequence[Sequence[Block]]) -> float:
        """Half the sum of squares."""
        residual = self._residual(x, blocks)
        return 0.5 * float(residual @ residual)

    def unlikelihood(self, x: Array, blocks: Sequence[Sequence[Block]]) -> float:
        """−2 ln of likelihood and priors at a point, the noise of runs being the residuals there, up to a constant.

        Coefficients of that noise have their price: a higher order alone makes no point likelier than another.
        """
        known, _ = prior_rows(self.coordinates, x)
        plain, total = [[white(block) for block in part] for part in blocks], float(known @ known)
        for part, of_part in zip(plain, self.rows(x, plain, slopes=False), strict=True):
            for block, row in zip(part, of_part, strict=True):
                if block.t is None:
                    total += float(row.residual @ row.residual)
                else:
                    colour = colour_of(row.residual)
                    w = colour.whitened(row.residual[:, None])
                    total += len(w) * float(np.log(np.mean(w**2))) + colour.price
        return total

    def weighed(self, x: Array, blocks: Sequence[Sequence[Block]], *, coloured: bool = False) -> list[list[Block]]:
        """The blocks with the noise of the residuals at a point: its size where none is stated, and its colour."""
        plain = [[white(block) for block in part] for part in blocks]
        rows = self.rows(x, plain, slopes=False)
        return [
            [_with(block, row, coloured=coloured) for block, row in zip(*part, strict=True)]
            for part in zip(plain, rows, strict=True)
        ]

    def least(
        self, x: Array, blocks: Sequence[Sequence[Block]], *, rough: bool = False, held: int | None = None
    ) -> Array:
        """Where the sum of squares is least, from a point on; the coordinate `held` stays."""
        free = np.arange(len(x)) != held
        if not free.any():
            return x
        bounds = np.array([one.bounds for one in self.coordinates]).T[:, free]
        change = 1e-4 if rough else 1e-12  # of a search on the way to another, and of the last
        smallest = 1e-8  # part of x: sums of squares of runs are known to 1e-11, and smaller steps are luck
        end: dict[str, Any] = {"ftol": change, "xtol": max(smallest, change), "gtol": change}

        def whole(part: Array) -> Array:
            point = x.copy()
            point[free] = part
            return point

        found = least_squares(
            lambda part: self._residual(whole(part), blocks), np.clip(x[free], *bounds),
            lambda part: self._jacobian(whole(part), blocks)[:, free], bounds=bounds, loss=self.loss, x_scale=1.0,
            max_nfev=30 if rough else 100, **end,
        )  # fmt: skip
        return whole(np.asarray(found.x))

    def covariance(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Array:
        """Covariance if all noise were white, of the size that was taken, gains and biases at their best."""
        J = self._jacobian(x, blocks)
        return np.asarray(np.linalg.pinv(J.T @ J))

    def _residual(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Array:
        nowhere = 1e8  # residual where the scene does not run: the search turns back
        known, _ = prior_rows(self.coordinates, x)
        try:
            rows = self.rows(x, blocks, slopes=False)
        except FlexlinkError:
            return np.full(sum(len(b.y) for part in blocks for b in part) + len(known), nowhere)
        return np.concatenate([known, *(row.residual for part in rows for row in part)])

    def _jacobian(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Array:
        _, known = prior_rows(self.coordinates, x)
        return np.vstack([known, *(row.slopes for part in self.rows(x, blocks) for row in part)])


def white(block: Block) -> Block:
    """The block with white noise, as large as before."""
    if block.colour is None:
        return block
    return dataclasses.replace(block, σ=block.σ / block.colour.share, colour=None)


def _with(block: Block, row: Row, *, coloured: bool) -> Block:
    e = row.residual * block.σ
    if not e.any():
        return block
    σ = block.σ if block.stated else np.full(len(e), float(np.sqrt(np.mean(e**2))))
    if not coloured or block.t is None:
        return dataclasses.replace(block, σ=σ)
    colour = colour_of(e)
    return dataclasses.replace(block, σ=σ * colour.share, colour=colour)


def stacked(rows: Sequence[Sequence[Row]], count: int, known: Array) -> Array:
    """Slopes of the priors, then of all residuals, to all numbers, gains and biases last."""
    flat = [row for part in rows for row in part]
    linear = sum(row.whole.shape[1] - count for row in flat)
    found, at = [np.hstack([known, np.zeros((len(known), linear))])], count
    for row in flat:
        J = np.zeros((len(row.residual), count + linear))
        own = row.whole.shape[1] - count
        J[:, :count], J[:, at : at + own] = row.whole[:, :count], row.whole[:, count:]
        at += own
        found.append(J)
    return np.vstack(found)


def priors_of(coordinates: Sequence[Coordinate], x: Array, rows: Sequence[Sequence[Row]]) -> Array:
    """Slopes of the priors to all numbers."""
    _, known = prior_rows(coordinates, x)
    linear = sum(row.whole.shape[1] - len(coordinates) for part in rows for row in part)
    return np.hstack([known, np.zeros((len(known), linear))])


def linear_names(sources: Sequence[Source]) -> list[str]:
    """Unknown gains and biases, in the order of the slopes' columns."""
    return [
        f"{what} of {block.name} of {source.name!r}"
        for source in sources
        for block in source.blocks
        for what in ("gain", "bias")
        if getattr(block, what)
    ]


def large_changes(blocks: Sequence[Sequence[Block]]) -> list[float]:
    """Large changes of gains and biases."""
    return [
        1.0 if what == "gain" else float(np.ptp(block.y)) or 1.0
        for part in blocks
        for block in part
        for what in ("gain", "bias")
        if getattr(block, what)
    ]
