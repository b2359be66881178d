"""White noise and random walks that depend only on a key and the time: the same in every run and order.

A walk W(t) starts at 0; its increments are independent, and normally distributed with the variance of their time [s].
Its values at whole seconds are sums of increments. Between them, the middle of an interval of length w is

    W(t + w/2) = (W(t) + W(t + w))/2 + √w/2 ξ        ξ normally distributed (construction of Lévy)

down to intervals shorter than any sampling period of sensors, in which W is linear.
"""

from __future__ import annotations

import functools
import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array

BLOCK = 256
"""Number of noise values generated at once."""
HALVINGS = 30
"""Halvings of a second; a walk is linear in the intervals of 1 ns that result."""


def noise(key: str, instants: Array) -> Array:
    """Normally distributed values for the instants with these numbers; they do not depend on their order or the run."""
    blocks, offsets = np.divmod(instants.astype(np.int64), BLOCK)
    found = np.empty(len(instants))
    for block in np.unique(blocks).tolist():
        found[blocks == block] = _block(key, block)[offsets[blocks == block]]
    return found


@functools.lru_cache(maxsize=256)
def _block(key: str, number: int) -> Array:
    """Noise values from Philox's counter and the inverse distribution, the same in all versions of NumPy."""
    hashed = int.from_bytes(hashlib.sha256(key.encode()).digest()[:16])
    raw: NDArray[np.uint64] = np.random.Philox(key=hashed, counter=[0, number, 0, 0]).random_raw(BLOCK)
    numbers = _normal(raw)
    numbers.flags.writeable = False
    return numbers


def walk(key: str, times: Array) -> Array:
    """Values of the walk of a key at times ≥ 0 [s]; they do not depend on the other times."""
    scaled = np.ldexp(times, HALVINGS)
    cells, levels = np.floor(scaled).astype(np.int64), np.arange(HALVINGS + 1)[:, None]
    around = cells >> (HALVINGS - levels)  # the interval of each level, whole seconds first
    ξ = _scattered(f"{key} walk", around[:-1] * HALVINGS + levels[:-1])
    whole = _whole_seconds(key, 1 << int(around[0].max(initial=0) + 1).bit_length())
    left, right = whole[around[0]], whole[around[0] + 1]
    for level in range(HALVINGS):
        middle = (left + right) / 2 + math.sqrt(2.0**-level) / 2 * ξ[level]
        later = around[level + 1] % 2 == 1
        left, right = np.where(later, middle, left), np.where(later, right, middle)
    return np.asarray(left + (right - left) * (scaled - cells))


@functools.lru_cache(maxsize=16)
def _whole_seconds(key: str, count: int) -> Array:
    """Values of a walk at 0, 1, …, count seconds."""
    return np.concatenate([[0.0], np.cumsum(_scattered(f"{key} seconds", np.arange(count)))])


def _scattered(key: str, numbers: NDArray[np.int64]) -> Array:
    """Normally distributed values for any integers ≥ 0: SplitMix64 (Steele, Lea and Flood 2014), started by a key.

    Unlike noise in blocks, each value costs the same, since a walk uses few of the values of its shortest intervals.
    """
    begin = np.uint64(int.from_bytes(hashlib.sha256(key.encode()).digest()[:8]))
    x = begin + (numbers.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return _normal(x ^ (x >> np.uint64(31)))


def _normal(raw: NDArray[np.uint64]) -> Array:
    """Convert random 64-bit numbers to normally distributed ones, the same in all versions of NumPy."""
    from scipy.special import ndtri  # noqa: PLC0415  slow import that few scenes need

    return np.asarray(ndtri(((raw >> np.uint64(11)) + 0.5) * math.ldexp(1.0, -53)))
