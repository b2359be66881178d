"""A strain gauge: the strain at the hinges nearest to it, by the cubic through them, and how it changes with angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor
from flexlink.dynamics.strain import beam_strain

NEAREST = 4
"""Hinges that the strain at a gauge is interpolated from; between hinges h apart it is off by h⁴ ε⁗/24, or so."""
NUDGE = 1e-3
"""Angle [rad] of the differences of fourth order: off by 1e-13 and what rounding makes of it."""


def gauge_strain(sensor: Sensor, scene: Scene, q: Array) -> Array:
    """ε at the gauge [1], shape (samples,), at angles q (samples, n)."""
    found = beam_strain(scene, q, link=sensor.link, fibre=sensor.fibre or (0.0, 0.0))
    nearest, weights = interpolation(found.x, sensor.x or 0.0)
    strain: Array = found.strain[..., nearest] @ weights
    return strain


def interpolation(nodes: Array, x: float) -> tuple[NDArray[np.intp], Array]:
    """Numbers of the nodes nearest to x, at most `NEAREST`, and Lagrange's weights of their values.

    >>> nearest, weights = interpolation(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 1.0)
    >>> print(nearest, weights)
    [0 1 2 3] [0. 1. 0. 0.]
    """
    nearest = np.sort(np.argsort(np.abs(nodes - x), kind="stable")[:NEAREST])
    known = nodes[nearest]
    apart = known[:, None] - known
    ratios = (x - known) / np.where(apart == 0, 1.0, apart)
    np.fill_diagonal(ratios, 1.0)
    return nearest, np.asarray(ratios.prod(axis=1))


def gauge_slope(sensor: Sensor, scene: Scene, chain: Chain, q: Array) -> Array:
    """∂ε/∂q at angles q (n,), shape (n,).

    ε is linear in the angles of springs that hold them, and exact but for rounding; springs that hold rotation vectors
    make it curved.
    """
    steps = NUDGE * np.array([1.0, -1.0, 2.0, -2.0])
    states = q + steps[:, None, None] * np.eye(chain.n)
    near, nearer, far, farther = gauge_strain(sensor, scene, states.reshape(-1, chain.n)).reshape(4, chain.n)
    return np.asarray((8 * (near - nearer) - (far - farther)) / (12 * NUDGE))
