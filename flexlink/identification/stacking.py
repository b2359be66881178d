"""Slopes of all residuals to all numbers, gains and biases behind those of the scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate, prior_rows
from flexlink.identification.data import Recorded, Source
from flexlink.identification.interval import Part
from flexlink.identification.residuals import Row


def stacked(rows: Sequence[Sequence[Row]], count: int, known: Array) -> Array:
    """Slopes of all residuals to all numbers, gains and biases behind; then what is known before."""
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


def parts_of(sources: Sequence[Source], rows: Sequence[Sequence[Row]]) -> list[Part]:
    """Every source with the slopes of its residuals to all numbers."""
    count = rows[0][0].slopes.shape[1]
    whole = stacked(rows, count, np.zeros((0, count)))
    parts, at = [], 0
    for source, part in zip(sources, rows, strict=True):
        slopes = []
        for row in part:
            slopes.append(whole[at : at + len(row.residual)])
            at += len(row.residual)
        parts.append(Part([row.residual for row in part], slopes, isinstance(source, Recorded)))
    return parts


def priors_of(coordinates: Sequence[Coordinate], x: Array, rows: Sequence[Sequence[Row]]) -> Array:
    """Slopes of what is known before to all numbers."""
    _, known = prior_rows(coordinates, x)
    linear = sum(row.whole.shape[1] - len(coordinates) for part in rows for row in part)
    return np.hstack([known, np.zeros((len(known), linear))])


def linear_names(sources: Sequence[Source]) -> list[str]:
    """Gains and biases that are sought, in the order of the slopes' columns."""
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
