"""A manufactured solution: a smooth motion of every joint and the torque that produces it, to 50 digits.

    q_k(t) = a_k sin(ω_k t + φ_k)        T_EX = M q̈ + T_GC + T_FL + T_FR + T_DRAG − Jᵀ w(t)

The Newton-Euler equations of each body in frame 0, projected on the hinges, include every term and share no recursion
with the kernels. Torques act on every joint, including those with springs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import SpatialChain, Vector, add, exactly

Wrench = Callable[[Any], Vector]
"""Force and moment on the tip as a function of time, in axes of frame 0."""


class Motion(NamedTuple):
    """Motion a sin(ω t + φ) of every joint."""

    amplitude: Vector
    rate: Vector
    phase: Vector

    def at(self, t: Any) -> tuple[Vector, Vector, Vector]:
        """q, q̇ and q̈."""
        found: tuple[Vector, Vector, Vector] = ([], [], [])
        for a, ω, φ in zip(*self, strict=True):
            sine, cosine = mp.sin(ω * t + φ), mp.cos(ω * t + φ)
            for values, value in zip(found, (a * sine, a * ω * cosine, -a * ω**2 * sine), strict=True):
                values.append(value)
        return found


def motion(chain: Chain, amplitudes: tuple[float, float], rates: tuple[float, float], seed: int) -> Motion:
    """Random motion, from the amplitudes of driven and of other joints [rad, m] and the range of rates [rad/s]."""
    random = np.random.default_rng(seed)
    driven = np.isin(np.arange(chain.n), chain.active)
    size = np.where(driven, *amplitudes)
    return Motion(
        exactly(size * random.uniform(0.5, 1.0, chain.n)),
        exactly(random.uniform(*rates, chain.n)),
        exactly(random.uniform(0.0, 2 * np.pi, chain.n)),
    )


def torque(oracle: SpatialChain, t: Any, moved: Motion, wrench: Wrench) -> Vector:
    """T_EX [N m] at time t [s]."""
    q, qd, qdd = moved.at(t)
    return add(oracle.torque(q, qd, qdd, wrench(t)), _coupled(oracle, q, qd))


def _coupled(oracle: SpatialChain, q: Sequence[Any], qd: Sequence[Any]) -> Vector:
    """Torques of springs and dampers that couple two hinges."""
    found = [mpf(0)] * oracle.n
    for row in oracle.chain.couplings:
        i, j = int(row["inner"]), int(row["outer"])
        k, d = mpf(float(row["stiffness"])), mpf(float(row["damping"]))
        for at, other in ((i, j), (j, i)):
            found[at] += k * (q[other] - oracle.joints[other]["rest"]) + d * qd[other]
    return found


def torque_pieces(
    chain: Chain, moved: Motion, wrench: Wrench, duration: float, pieces: int, degree: int
) -> tuple[Array, Array]:
    """T_EX as polynomials in the time since the last knot: knots (pieces,), coefficients (pieces, degree + 1, n).

    Each piece interpolates the torque at Chebyshev points that include both ends; coefficients are rounded once.
    """
    oracle = SpatialChain(chain)
    with mp.workdps(DIGITS):
        length = mpf(duration) / pieces
        at = [length * (1 - mp.cos(mp.pi * k / degree)) / 2 for k in range(degree + 1)]
        inverse = mp.matrix([[x**j for j in range(degree + 1)] for x in at]) ** -1
        knots = [length * k for k in range(pieces)]
        found = [inverse * mp.matrix([torque(oracle, knot + x, moved, wrench) for x in at]) for knot in knots]
        return np.array(knots, dtype=np.float64), np.array([each.tolist() for each in found], dtype=np.float64)


def torques(chain: Chain, at: Iterable[float], moved: Motion, wrench: Wrench) -> Array:
    """T_EX at several times, shape (times, n), rounded once."""
    oracle = SpatialChain(chain)
    with mp.workdps(DIGITS):
        return np.array([torque(oracle, mpf(float(t)), moved, wrench) for t in at], dtype=np.float64)


def states(at: Iterable[float], moved: Motion) -> tuple[Array, Array]:
    """q and q̇ at several times, shape (times, n) each, rounded once."""
    with mp.workdps(DIGITS):
        found = [moved.at(mpf(float(t)))[:2] for t in at]
    q, qd = np.array(found, dtype=np.float64).swapaxes(0, 1)
    return q, qd
