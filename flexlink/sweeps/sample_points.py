"""Points of the unit cube for the members of a sample, computed from their number and the seed without a stored list.

For "random", the generator is advanced to the point. For "sobol", point n is the exclusive or of direction numbers, one
for each digit 1 of n's binary Gray code. Direction numbers are computed from SciPy's points 0, 1, 3, 7, 15, ….
For "halton", each point is computed from its number. For "latin", all points are computed together, because points of a
Latin hypercube depend on each other.
"""

from __future__ import annotations

import functools
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array

BLOCK = 1024
"""Number of points to compute together; a power of two preserves the balance of Sobol's sequence."""

DIGITS = 30
"""Number of binary digits of Sobol's points."""

_halton_moves = Lock()


def point(method: str, dimensions: int, count: int, seed: int, k: int) -> list[float]:
    """Return point `k` of `count`: one number 0 ≤ u < 1 per dimension."""
    coordinates: list[float] = _block(method, dimensions, count, seed, k // BLOCK)[k % BLOCK]
    return coordinates


@functools.lru_cache(maxsize=16)
def _block(method: str, dimensions: int, count: int, seed: int, number: int) -> list[list[float]]:
    """Return `BLOCK` consecutive points."""
    first = number * BLOCK
    if method == "random":
        bits = np.random.default_rng(seed).bit_generator
        bits.advance(first * dimensions)  # type: ignore[attr-defined]
        points = np.random.Generator(bits).random((BLOCK, dimensions))
    elif method == "sobol":
        points = _sobol(dimensions, count, seed, first)
    elif method == "halton":
        with _halton_moves:  # the engine is shared by several threads
            engine = _halton(dimensions, seed)
            engine.num_generated = first  # its `fast_forward` would compute all previous points
            points = engine.random(BLOCK)
    else:
        points = _latin(dimensions, count, seed)[first : first + BLOCK]
    found: list[list[float]] = points.tolist()
    return found


@functools.lru_cache(maxsize=2)
def _latin(dimensions: int, count: int, seed: int) -> Array:
    """All points, equal to the points from SciPy's engine, whose import would take half a second."""
    (rng,) = np.random.default_rng(seed).spawn(1)
    inside = rng.uniform(size=(count, dimensions))
    cells = np.tile(np.arange(1, count + 1), (dimensions, 1))
    for row in cells:
        rng.shuffle(row)
    points: Array = (cells.T - inside) / count
    return points


@functools.lru_cache(maxsize=2)
def _halton(dimensions: int, seed: int) -> Any:
    return _qmc().Halton(dimensions, rng=np.random.default_rng(seed))


def _sobol(dimensions: int, count: int, seed: int, first: int) -> Array:
    start, directions = _directions(dimensions, max(count - 1, first + BLOCK - 1).bit_length(), seed)
    numbers = np.arange(first, first + BLOCK)
    gray = numbers ^ (numbers >> 1)
    digits = np.repeat(start[None], BLOCK, axis=0)
    for i, direction in enumerate(directions):
        digits ^= np.where((gray >> i & 1)[:, None], direction, 0)
    return np.ldexp(digits.astype(np.float64), -DIGITS)


@functools.lru_cache(maxsize=4)
def _directions(dimensions: int, length: int, seed: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First point as an integer, and direction numbers for Gray codes of `length` digits, shape (length, d)."""
    engine = _qmc().Sobol(dimensions, bits=DIGITS, rng=np.random.default_rng(seed))

    def next_point() -> NDArray[np.int64]:
        return np.asarray(np.ldexp(engine.random(1)[0], DIGITS), dtype=np.int64)

    start = next_point()
    directions = np.zeros((length, dimensions), dtype=np.int64)
    for i in range(length):
        if ahead := 2 ** (i + 1) - 1 - engine.num_generated:
            engine.fast_forward(ahead)
        directions[i] = next_point() ^ start
    return start, directions


def _qmc() -> Any:
    from scipy.stats import qmc  # noqa: PLC0415  the import takes 0.5 s; only for Sobol and Halton

    return qmc
