"""Likelihood of the parameters from priors and from residuals, which are normalized by their noise and whitened.

    r = (g y(x) + b − measured) / σ        ∂r/∂x ≈ (1 − Φ Φ⁺) g ∂y/∂x / σ,  Φ = [y, 1] / σ for unknown g, b

Gains g and biases b are linear and take their optimal values for every x (variable projection, Golub and Pereyra 1973,
with Kaufman's approximation of the Jacobian). A filter whitens autocorrelated residuals and their Jacobian.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate, prior_rows
from flexlink.identification.data import Source


class Row(NamedTuple):
    """Residual and Jacobian of a block at one point.

    Attributes
    ----------
    residual
        Residual over the noise, shape (n,).
    gain, bias
        Optimal values; 1 and 0 if they are known.
    slopes
        ∂residual/∂x with optimal gain and bias, shape (n, coordinates); empty if not requested.
    whole
        ∂residual/∂(x, gain, bias) with gain and bias as parameters, shape (n, coordinates + 0 to 2).
    """

    residual: Array
    gain: float
    bias: float
    slopes: Array
    whole: Array


def row_of(block: Block, y: Array, slopes: Array | None = None) -> Row:
    """Residual and Jacobian of a block for a prediction y; `slopes` is ∂y/∂x, shape (n, coordinates)."""
    by = block.colour.whitened if block.colour is not None else np.asarray
    unknown = [column for column, is_unknown in ((y, block.gain), (np.ones(len(y)), block.bias)) if is_unknown]
    Φ = by(np.array(unknown).T.reshape(len(y), len(unknown)) / block.σ[:, None])
    target = by(((block.y - (0.0 if block.gain else y)) / block.σ)[:, None])[:, 0]
    best = _solved(Φ, target)
    residual = Φ @ best - target
    gain = float(best[0]) if block.gain else 1.0
    bias = float(best[-1]) if block.bias else 0.0
    if slopes is None:
        return Row(residual, gain, bias, np.empty((len(y), 0)), Φ)
    fixed = by(gain * slopes / block.σ[:, None])
    return Row(residual, gain, bias, fixed - Φ @ _solved(Φ, fixed), np.hstack([fixed, Φ]))


def _solved(Φ: Array, target: Array) -> Array:
    if not Φ.shape[1]:
        return np.zeros((0, *target.shape[1:]))
    return np.asarray(np.linalg.lstsq(Φ, target, rcond=None)[0])


def white(block: Block) -> Block:
    """The block, with its noise replaced by white noise of the same standard deviation."""
    if block.colour is None:
        return block
    return dataclasses.replace(block, σ=block.σ / block.colour.share, colour=None)


def stacked(rows: Sequence[Sequence[Row]], count: int, known: Array) -> Array:
    """Jacobian of the priors, then of all residuals, with respect to all parameters; gains and biases come last."""
    flat = [row for part in rows for row in part]
    linear = sum(row.whole.shape[1] - count for row in flat)
    found, at = [np.hstack([known, np.zeros((len(known), linear))])], count
    for row in flat:
        J = np.zeros((len(row.residual), count + linear))
        width = row.whole.shape[1] - count
        J[:, :count], J[:, at : at + width] = row.whole[:, :count], row.whole[:, count:]
        at += width
        found.append(J)
    return np.vstack(found)


def priors_of(coordinates: Sequence[Coordinate], x: Array, rows: Sequence[Sequence[Row]]) -> Array:
    """Jacobian of the priors with respect to all parameters."""
    _, known = prior_rows(coordinates, x)
    linear = sum(row.whole.shape[1] - len(coordinates) for part in rows for row in part)
    return np.hstack([known, np.zeros((len(known), linear))])


def linear_names(sources: Sequence[Source]) -> list[str]:
    """Names of unknown gains and biases, in the order of the Jacobian's columns."""
    return [
        f"{what} of {block.name} of {source.name!r}"
        for source in sources
        for block in source.blocks
        for what in ("gain", "bias")
        if getattr(block, what)
    ]


def large_changes(blocks: Sequence[Sequence[Block]]) -> list[float]:
    """Typical large changes of gains and biases."""
    return [
        1.0 if what == "gain" else float(np.ptp(block.y)) or 1.0
        for part in blocks
        for block in part
        for what in ("gain", "bias")
        if getattr(block, what)
    ]
