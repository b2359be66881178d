"""Kinetic, gravitational and elastic energy of a chain."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.batches import each, is_batch
from flexlink.dynamics.result import Result
from flexlink.kernels.bodies.energy import energies


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Energy(Result):
    """Energies [J]: scalars for one state; arrays for several states, or for the samples of a `Trajectory`."""

    kinetic: Array | float
    gravity: Array | float  # relative to a state with all mass at the origin of frame 0
    elastic: Array | float

    @property
    def total(self) -> Array | float:
        """Kinetic + gravity + elastic."""
        return self.kinetic + self.gravity + self.elastic

    @property
    def parts(self) -> Array:
        """Kinetic, gravitational and elastic energy, stacked, shape (3, …)."""
        return np.array([self.kinetic, self.gravity, self.elastic])

    def __repr__(self) -> str:
        parts = [f"{name} {_span(np.asarray(value))} J" for name, value in vars(self).items()]
        return f"<Energy: {', '.join(parts)}>"


def _span(values: Array) -> str:
    if values.ndim == 0:
        return f"{float(values):.9g}"
    return f"{values.min():.6g} … {values.max():.6g}" if values.size else "–"


def energy(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Energy:
    """Return kinetic energy ½ q̇ᵀMq̇, gravitational energy −Σ m g·p and elastic energy Σ ½ k (θ − θ₀)².

    Parameters
    ----------
    chain
        The chain.
    q, qd
        Angles [rad] and rates [rad/s], shape (n,), or (b, n) for b states.

    Returns
    -------
    Energy
        The three parts [J], scalars, or shape (b,) each.

    Raises
    ------
    ArgumentError
        `q` or `qd` has the wrong shape, is not real or not finite, or an energy is beyond float64.

    Examples
    --------
    >>> found = fl.energy(chain, q, qd)
    >>> print(f"{found.gravity:.3f} J of gravity, {found.elastic:.3f} J in the springs")
    9.296 J of gravity, 0.188 J in the springs
    """
    if is_batch(q, qd):
        return each(energy, chain, {"q": q, "qd": qd})
    n = require_type("chain", chain, Chain).n
    q, qd = vector("q", q, n, many=True), vector("qd", qd, n, many=True)
    parts = np.array(energies(chain.arrays, q, qd))
    found = Energy(*parts.tolist())
    if not math.isfinite(found.total):
        name = next((name for name, value in vars(found).items() if not math.isfinite(value)), "total")
        raise beyond_float64(f"the {name} energy", q=q, qd=qd, gravity=chain.gravity)
    return found
