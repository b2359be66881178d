"""Richardson extrapolation of the tip's path to the limit of infinitely many hinges.

x* ≈ x_b + (x_b − x_a) / ((N_b/N_a)^p − 1)          paths x_a, x_b with N_a < N_b hinges; p: order of convergence
p = log(|x_b − x_a| / |x_c − x_b|) / log(N_b/N_a)   order observed with three levels, N_c/N_b = N_b/N_a

With a known order and three levels, the error of x* is estimated by the change of x* when the last level is added.
Otherwise it is estimated by the distance |x* − x_b| of x* from the finest level.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.vibration.modal import Modes
from flexlink.results.tip_motion import largest_distance

Level = tuple[float, Array]  # a level: number of hinges in each link, and the path of the tip (samples, 3) [m]


class Limit(NamedTuple):
    """Limit of the tip's path as a model gets more hinges."""

    tip: Array  # (samples, 3) the path [m]
    errors: Array  # (samples,) estimate of the largest error of `tip` up to each sample [m]
    order: float = math.nan  # of convergence of the extrapolation; nan if the limit is the finest level itself
    weights: tuple[float, float] = (0.0, 1.0)  # of the last two levels in `tip`

    @property
    def error(self) -> float:
        """Estimate of the largest error at any sample [m]."""
        return float(self.errors[-1])


def extrapolated(levels: Sequence[Level], order: float = 2.0) -> Limit:
    """Limit extrapolated from the last two levels with this order; its errors are inf, since not yet estimated."""
    (Na, a), (Nb, b) = levels[-2:]
    q = (Nb / Na) ** order - 1
    return Limit(b + (b - a) / q, np.full(len(b), np.inf), order, (-1 / q, 1 + 1 / q))


def change_of_limit(levels: Sequence[Level], order: float = 2.0) -> Array:
    """Change of the limit when the last level is added (samples, 3) [m]; needs three levels."""
    return extrapolated(levels, order).tip - extrapolated(levels[:-1], order).tip


def observed_order(levels: Sequence[Level]) -> float:
    """Order of convergence observed with the last three levels; inf if the last change is zero."""
    (Na, a), (Nb, b), (_, c) = levels[-3:]
    before, last = largest_distance(b, a), largest_distance(c, b)
    if not before or not last:
        return -math.inf if last else math.inf
    return math.log(before / last) / math.log(Nb / Na)


HINGES_A_HALF_WAVE = 2.0


def resolved(found: Modes, chain: Chain) -> tuple[bool, ...]:
    """Whether the frequency of each mode is a property of the arm, rather than of its division into hinges.

    A link's hinge angles about an axis change sign where the beam's curvature does. A half-wave lies between two such
    sign changes and needs `HINGES_A_HALF_WAVE` hinges, so at most one mode per pair of hinges, per gear and per spring
    of a root is resolved. Pendulum and rigid modes count as resolved, artificial ones do not. Frequencies of resolved
    modes are mostly accurate to a few per cent.
    """
    most = (chain.stiffness > 0).sum() - sum(map(len, _lines(chain))) * (1 - 1 / HINGES_A_HALF_WAVE)
    elastic = np.cumsum([kind == "elastic" for kind in found.kinds])
    return tuple(
        kind in {"pendulum", "rigid"} or (kind == "elastic" and bool(rank <= most) and _resolves(shape, chain))
        for kind, rank, shape in zip(found.kinds, elastic, found.shapes, strict=True)
    )


def _resolves(mode: NDArray[np.inexact], chain: Chain) -> bool:
    shape = np.asarray(mode.real if mode.real.any() else mode.imag, dtype=np.float64)
    moments = chain.times("stiffness", shape)  # spring moments, which have the sign of the curvature
    energy = moments * shape
    for hinges in _lines(chain):
        waves = _half_waves(moments[hinges])
        # hinges with less than 5 % of a mode's elastic energy do not matter for its frequency
        if energy[hinges].sum() > 0.05 * energy.sum() and len(hinges) < HINGES_A_HALF_WAVE * waves:
            return False
    return True


def _lines(chain: Chain) -> list[list[int]]:
    """Coordinates of the hinges of each link about each axis, from the root outward, excluding gears."""
    found: dict[tuple[int, int], list[int]] = {}
    for k, coordinate in enumerate(chain.coordinates):
        if coordinate.axis and coordinate.segment and chain.stiffness[k] > 0:
            found.setdefault((coordinate.link, coordinate.axis), []).append(k)
    return list(found.values())


def _half_waves(moments: Array) -> int:
    signs = np.sign(moments[np.abs(moments) > 1e-6 * np.abs(moments).max()])
    return 1 + int(np.sum(signs[1:] != signs[:-1]))
