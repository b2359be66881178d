"""Likelihood of the parameters from priors and from residuals, which are normalized by their noise and whitened.

    r = (g y(x) + b + d (t − t̄) − measured) / σ        ∂r/∂x ≈ (1 − Φ Φ⁺) g ∂y/∂x / σ,  Φ = [y, 1, t − t̄] / σ

Gains g, biases b and drifts d are linear and take their optimal values for every x (variable projection, Golub and
Pereyra 1973, with Kaufman's approximation of the Jacobian). A filter whitens autocorrelated residuals and their
Jacobian.
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
    gain, bias, drift
        Optimal values; 1, 0 and 0 if they are known.
    slopes
        ∂residual/∂x with optimal gain, bias and drift, shape (n, coordinates); empty if not requested.
    whole
        ∂residual/∂(x, gain, bias, drift) with these as parameters, shape (n, coordinates + 0 to 3).
    """

    residual: Array
    gain: float
    bias: float
    slopes: Array
    whole: Array
    drift: float = 0.0


LINEAR = ("gain", "bias", "drift")
"""Unknowns of an instrument that enter linearly, in the order of the Jacobian's columns."""


def row_of(block: Block, y: Array, slopes: Array | None = None) -> Row:
    """Residual and Jacobian of a block for a prediction y; `slopes` is ∂y/∂x, shape (n, coordinates)."""
    whiten, used = block.colour.whitened if block.colour is not None else np.asarray, block.used[:, None]

    def by(columns: Array) -> Array:
        return np.asarray(whiten(used * columns))

    names = [what for what in LINEAR if getattr(block, what)]
    unknown = [{"gain": y, "bias": np.ones(len(y)), "drift": centred(block)}[what] for what in names]
    Φ = by(np.array(unknown).T.reshape(len(y), len(unknown)) / block.σ[:, None])
    target = by(((block.y - (0.0 if block.gain else y)) / block.σ)[:, None])[:, 0]
    best = _solved(Φ, target)
    residual = Φ @ best - target
    found = dict(zip(names, best.tolist(), strict=True))
    gain, bias, drift = found.get("gain", 1.0), found.get("bias", 0.0), found.get("drift", 0.0)
    if slopes is None:
        return Row(residual, gain, bias, np.empty((len(y), 0)), Φ, drift)
    fixed = by(gain * slopes / block.σ[:, None])
    return Row(residual, gain, bias, fixed - Φ @ _solved(Φ, fixed), np.hstack([fixed, Φ]), drift)


def centred(block: Block) -> Array:
    """Times of a block, relative to their mean, shape (n,) [s]; zeros for single measurements."""
    return np.zeros(len(block.y)) if block.t is None else np.asarray(block.t - block.t.mean())


def read(block: Block, row: Row, y: Array) -> Array:
    """What the instrument of a block shows for a prediction y, with the gain, bias and drift of a row."""
    shown = row.gain * y + row.bias
    return shown + row.drift * centred(block) if row.drift else shown


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
    """Names of unknown gains, biases and drifts, in the order of the Jacobian's columns."""
    return [
        f"{what} of {block.name} of {source.name!r}"
        for source in sources
        for block in source.blocks
        for what in LINEAR
        if getattr(block, what)
    ]


def range_of(block: Block) -> float:
    """Range of the measured values; 1 if they are all equal."""
    return float(np.ptp(block.y)) or 1.0


def large_changes(blocks: Sequence[Sequence[Block]]) -> list[float]:
    """Typical large changes of gains, biases and drifts."""
    return [
        (1.0 if what == "gain" else float(np.ptp(block.y)) or 1.0)
        / (float(np.ptp(centred(block))) if what == "drift" else 1.0)
        for part in blocks
        for block in part
        for what in LINEAR
        if getattr(block, what)
    ]
