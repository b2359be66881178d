"""Energy, linear and angular momentum of an arm, which are conserved unless something acts on it."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.dynamics.batches import each, is_batch, rows
from flexlink.dynamics.result import Result
from flexlink.kernels.bodies.energy import energies, momenta


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
    chain, q, qd
        The chain; angles [rad] and rates [rad/s], shape (n,), or (b, n) for b states.

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
    found = Energy(*np.array(energies(chain.arrays, q, qd)).tolist())
    if not math.isfinite(found.total):
        name = next((name for name, value in vars(found).items() if not math.isfinite(value)), "total")
        raise beyond_float64(f"the {name} energy", q=q, qd=qd, gravity=chain.gravity)
    return found


class Momentum(NamedTuple):
    """Momentum of all bodies, in axes of frame 0, shape (3,) each, or (b, 3)."""

    linear: Array
    """Σ m v [N s]."""
    angular: Array
    """Σ c × m v + I ω, about the origin of frame 0 [N m s]."""
    center: Array
    """Centre of mass [m]."""

    @property
    def spin(self) -> Array:
        """Angular momentum about the centre of mass [N m s]."""
        return np.asarray(self.angular - cross(self.center, self.linear))


def momentum(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Momentum:
    """Return the total momentum of all bodies, excluding rotors (`armature`).

    If no wrench acts on an arm with a free base, its linear momentum changes at the rate m g, and its angular momentum
    about the centre of mass is constant for any joint motion.

    Parameters
    ----------
    chain, q, qd
        The chain; coordinates and rates, shape (n,), or (b, n) for b states.

    Returns
    -------
    Momentum
        Momentum in frame 0.

    Raises
    ------
    ArgumentError
        `q` or `qd` has the wrong shape, is not real or not finite; or no body has mass.

    Examples
    --------
    >>> rates = np.where(np.arange(chain.n) == 0, 1.0, 0.0)  # rad/s: only the first joint turns
    >>> print(fl.momentum(chain, q, rates).linear.round(2))  # N s
    [-0.95  7.91  0.  ]
    """
    n = require_type("chain", chain, Chain).n
    if not chain.mass:
        why = f"chain {chain.name!r}: no body has mass, so it has no centre of mass; add a mass"
        raise ArgumentError(why, id="no-mass")
    if is_batch(q, qd):
        return momentum_of_states(chain, *rows(n, {"q": q, "qd": qd}))
    found = momentum_of_states(chain, vector("q", q, n, many=True)[None], vector("qd", qd, n, many=True)[None])
    return Momentum(*(part[0] for part in found))


def momentum_of_states(chain: Chain, q: Array, qd: Array) -> Momentum:
    """Momentum at b states (b, n), already validated."""
    found = np.empty((len(q), 3, 3))
    momenta(chain.arrays, np.ascontiguousarray(q), np.ascontiguousarray(qd), found)
    return Momentum(found[:, 0], found[:, 1], found[:, 2])
