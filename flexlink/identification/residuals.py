"""Residuals of all blocks over their noise; gains and biases, which are linear, at their best for every x.

    r = (g y(x) + b − measured) / σ        ∂r/∂x ≈ (1 − Φ Φ⁺) g ∂y/∂x / σ,  Φ = [y, 1] / σ of those that are unknown

All pass through a filter that makes the noise white where it hangs together in time
(variable projection, Golub and Pereyra 1973, with Kaufman's slope).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.identification.block import Block


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
