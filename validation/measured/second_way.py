"""The parts of the validation uncertainty, derived a second way.

| part | first way | second way |
|---|---|---|
| u_input | each input at both ends of its tolerance, root sum of squares | random inputs, all at once: deviation of S |
| u_input, fitted | √(J C Jᵀ) by finite differences | random inputs of the covariance C, scaled down |
| u_num | grids of N, 2N and 4N hinges | grids of 2N, 3N and 4N hinges |
| u_D | stated reading error, or t-factor times standard error | scatter of the readings, or random draws |

Inputs are drawn from rectangular distributions, one value in each of equally probable classes (Latin hypercube).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from flexlink.common.types import Array
from validation.measured.readings import Derived, Reading
from validation.measured.uncertainty import SAFETY, SAFETY_UNORDERED, Convergence

SEED = 20
ORDERS = 0.2, 12.0  # observed orders that are looked for
DRAWS_OF_READINGS = 20_000


def random_points(draws: int, inputs: int) -> Array:
    """(draws, inputs) array of values between −1 and 1, each input with one value in each of `draws` equal classes."""
    rng = np.random.default_rng(SEED)
    classes = np.column_stack([rng.permutation(draws) for _ in range(inputs)])
    found: Array = 2 * (classes + rng.random((draws, inputs))) / draws - 1
    return found


def scatter_of(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Standard deviation of each quantity over the draws."""
    return {name: float(np.std([each[name] for each in values], ddof=1)) for name in values[0]}


def close_grids(two: float, three: float, four: float, formal: float) -> Convergence:
    """Grid convergence index of S₄ from S₂, S₃, S₄, with 2N, 3N and 4N hinges.

    The observed order p solves (S₃ − S₂) / (S₄ − S₃) = (2⁻ᵖ − 3⁻ᵖ) / (3⁻ᵖ − 4⁻ᵖ). Safety factors, and the index
    without an order, are those of `grid_convergence`.
    """
    first, second = three - two, four - three
    if first * second > 0:

        def wrong(p: float) -> float:
            return float((2**-p - 3**-p) / (3**-p - 4**-p)) - first / second

        if wrong(ORDERS[0]) < 0 < wrong(ORDERS[1]):
            order = float(brentq(wrong, *ORDERS))
            return Convergence(order, SAFETY * abs(second) / ((4 / 3) ** min(order, formal) - 1))
    return Convergence(math.nan, SAFETY_UNORDERED * max(abs(first), abs(second)))


def spread_of_derived(derived: Iterable[Derived], readings: Mapping[str, Reading]) -> dict[str, float]:
    """Standard deviation of derived quantities for normally distributed readings with their uncertainties."""
    rng = np.random.default_rng(SEED)
    drawn = {name: rng.normal(each.value, each.u, DRAWS_OF_READINGS) for name, each in readings.items()}
    found = {}
    for each in derived:
        a, b = drawn[each.first], drawn[each.second]
        found[each.name] = float(np.std(a / b if each.kind == "ratio" else a - b))
    return found


def roughness(
    values: Sequence[float] | Array, uncertainties: Sequence[float], x: Sequence[float] | Array, *, degree: int
) -> Array:
    """Residuals (value − polynomial of this degree in x) / u of a fit weighted by the uncertainties u."""
    u = np.asarray(uncertainties)
    design = np.vander(np.asarray(x, dtype=float), degree + 1) / u[:, None]
    scaled = np.asarray(values) / u
    found: Array = scaled - design @ np.linalg.lstsq(design, scaled, rcond=None)[0]
    return found


def deviation(residuals: Iterable[Array], *, degree: int) -> float:
    """Standard deviation of residuals of several fits of one degree: 1 on average if the uncertainties are right."""
    found = list(residuals)
    freedom = sum(len(each) - degree - 1 for each in found)
    return math.sqrt(sum(float(each @ each) for each in found) / freedom)


def disagreement(first: float, second: float, u_val: float, floor: float = 0.2) -> float:
    """|second − first| relative to the first, or to `floor` times u_val if that is larger: less does not matter."""
    return abs(second - first) / max(first, floor * u_val)
