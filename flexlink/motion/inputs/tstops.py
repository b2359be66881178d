"""Times at which adaptive steps must stop, so that no peak or jump of a tabulated input falls between two stages."""

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.numbers import is_whole
from flexlink.kernels.inputs.laws import PD, TABLE
from flexlink.kernels.inputs.record import Drive, Loads, PiecewisePolynomial
from flexlink.motion.inputs.actuation import LINEAR


def breakpoints(given: Drive | Loads, part: float) -> Array:
    """Times [s] between which an input is smooth, excluding sampling instants."""
    if isinstance(given, Loads):
        return merged_breakpoints(given, part)
    if given.rate:
        return np.empty(0)
    if given.law == TABLE:
        return merged_breakpoints(given.feedforward, part)
    return np.concatenate([given.reference.knots, given.feedforward.knots if given.law == PD else []])


def instants(drive: Drive | None, start: float, end: float) -> Array:
    """Times [s] at which a law is sampled, or its torques begin to act, from the first to the last of these times."""
    if drive is None or not drive.rate:
        return np.empty(0)
    first, last = (round(t * drive.rate) for t in (start, end))
    sampled = np.arange(first, last + 1)
    if not acts_between_instants(drive):
        return np.asarray(sampled / drive.rate)
    acting = sampled + drive.delay * drive.rate % 1.0
    return np.asarray(np.sort(np.concatenate([sampled, acting])) / drive.rate)


def acts_between_instants(drive: Drive) -> bool:
    """Whether the delay of a sampled law is not a whole number of sampling periods."""
    return not is_whole(drive.delay * drive.rate)


def merged_breakpoints(table: PiecewisePolynomial | Loads, part: float) -> Array:
    """Knots [s] between which the table is a cubic polynomial, up to `part` of the largest number in each column.

    The values at the stages of a step then represent, up to this error, the values between them. Pairs of pieces of a
    smooth table are always merged, since a step over two pieces cannot miss a peak between its stages. Pieces are then
    merged in groups of two, four, eight, … as long as the cubic polynomial with the values and slopes at both ends of a
    group passes through all of its knots and midpoints.
    """
    knots, given = table.knots, table.coefficients
    if len(knots) < 3:  # nothing to merge
        return knots
    c = np.concatenate([given, np.zeros_like(given[:, :1])], axis=1)  # zero slopes for tables of held torques
    x = np.diff(knots)[:, None]
    powers = np.arange(c.shape[1])[:, None, None]
    middles = (c[:-1].transpose(1, 0, 2) * (0.5 * x) ** powers).sum(axis=0)
    slopes = c[:-1, 1], (powers[1:] * c[:-1, 1:].transpose(1, 0, 2) * x ** powers[:-1]).sum(axis=0)  # at both ends
    t, values = interleaved(knots, knots[:-1] + 0.5 * x[:, 0]), interleaved(c[:, 0], middles)
    allowed, kept = part * np.abs(c[:, 0]).max(axis=0, initial=0.0), np.ones(len(knots), dtype=bool)
    size = 2  # pieces per block
    if given.shape[1] > LINEAR:
        kept[1:-1:2], size = False, 4
    while size < len(knots):
        a = size * np.arange((len(knots) - 1) // size)
        points = 2 * a[:, None] + np.arange(2 * size)
        ends = values[2 * a], values[2 * (a + size)], slopes[0][a], slopes[1][a + size - 1]
        off = np.abs(values[points] - hermite(t[points], t[2 * a], t[2 * (a + size)], ends)).max(axis=1)
        halves = kept[a[:, None] + np.arange(1, size)].sum(axis=1) == 1
        together = halves & (off <= allowed).all(axis=1)
        if not together.any():
            break
        kept[a[together] + size // 2] = False
        size *= 2
    return knots[kept]


def interleaved(ends: Array, middles: Array) -> Array:
    """Array of the first end, first middle, second end, …, last end."""
    both = np.empty((2 * len(ends) - 1, *ends.shape[1:]))
    both[::2], both[1::2] = ends, middles
    return both


def hermite(t: Array, a: Array, b: Array, ends: tuple[Array, ...]) -> Array:
    """Cubics at t (blocks, points), from their values and slopes `ends`, (blocks, d), at times a and b (blocks,)."""
    length = (b - a)[:, None, None]
    x = (t - a[:, None])[:, :, None] / length
    start, end, rise, fall = (value[:, None] for value in ends)
    step = x * x * (3.0 - 2.0 * x)
    return start + step * (end - start) + length * x * (1.0 - x) * ((1.0 - x) * rise - x * fall)
