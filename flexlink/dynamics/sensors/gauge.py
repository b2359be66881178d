"""A strain gauge: strain from a cubic through the nearest hinges, and its derivative with respect to the angles.

If EI is given by a table, EI and the curvature may have kinks and jumps, but the moment M = EI κ does not. The cubic
then interpolates the moment at the hinges, and κ = M/EI with EI at the gauge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.beams import TableBeam
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor
from flexlink.dynamics.strain import beam_strain, known_at


def gauge_strain(sensor: Sensor, scene: Scene, q: Array) -> Array:
    """Strain ε at the gauge [1], shape (samples,), at angles q (samples, n)."""
    (y, z), position = sensor.fibre or (0.0, 0.0), sensor.x or 0.0
    found = beam_strain(scene, q, link=sensor.link, fibre=(y, z))
    nearest, weights = interpolation(found.x, position)
    number = scene.arm.number(sensor.link)
    link = scene.arm.links[number - 1]
    if link.rigidity is None:
        strain: Array = found.strain[..., nearest] @ weights
        return strain
    beam = TableBeam(link.beam.length, scene.arm.rigidities[link.rigidity])
    there, here = (
        beam.rigidities(x)[1:] for x in (known_at(scene, number)[nearest], np.array([position / beam.length]))
    )
    κ_y, κ_z = (found.curvature[..., nearest, k + 1] @ (weights * there[k]) / here[k] for k in range(2))
    return np.asarray(z * κ_y - y * κ_z)


def interpolation(nodes: Array, x: float) -> tuple[NDArray[np.intp], Array]:
    """Indices of the nodes nearest to x, at most four, and the Lagrange weights of their values.

    >>> nearest, weights = interpolation(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 1.0)
    >>> print(nearest, weights)
    [0 1 2 3] [0. 1. 0. 0.]
    """
    most = 4  # with hinges at a spacing h the error of the strain ε is about h⁴ ε⁗/24
    nearest = np.sort(np.argsort(np.abs(nodes - x), kind="stable")[:most])
    known = nodes[nearest]
    apart = known[:, None] - known
    ratios = (x - known) / np.where(apart == 0, 1.0, apart)
    np.fill_diagonal(ratios, 1.0)
    return nearest, np.asarray(ratios.prod(axis=1))


def gauge_slope(sensor: Sensor, scene: Scene, chain: Chain, q: Array) -> Array:
    """∂ε/∂q at angles q (n,), shape (n,).

    ε is linear in the angles, and the derivative is exact up to rounding, unless springs act on rotation vectors.
    """
    nudge = 1e-3  # step [rad] of the fourth-order differences; their error is 1e-13, plus rounding
    steps = nudge * np.array([1.0, -1.0, 2.0, -2.0])
    states = q + steps[:, None, None] * np.eye(chain.n)
    near, nearer, far, farther = gauge_strain(sensor, scene, states.reshape(-1, chain.n)).reshape(4, chain.n)
    return np.asarray((8 * (near - nearer) - (far - farther)) / (12 * nudge))
