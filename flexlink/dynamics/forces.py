"""Torques of force elements and their derivatives: those with a potential belong to T_FL, the others do not."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.dynamics.batches import is_batch, rows
from flexlink.kernels.forces.elements import POTENTIALS, motion_slopes, motion_torques
from flexlink.kernels.tools.finite import is_finite


def drag_torque(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """T_DRAG = −Σ Jᵀ f: joint torques, in addition to T_FR, that overcome the drag of links, `link.drag`.

    f = −½ ρ c_d b Δx |v| v at points along each link, where v is their velocity across it (`Drag`). q̇·T_DRAG ≥ 0 is
    the dissipated power [W]. The integral uses two Gauss points per segment and at least eight per link. The result is
    exact in a plane if v keeps its sign within a segment and the breadth is constant.

    Parameters
    ----------
    chain
        The chain.
    q, qd
        Angles [rad] and rates [rad/s], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        T_DRAG, shape (n,), or (b, n) [N m]; zero at rest and for a chain without drag.

    Raises
    ------
    ArgumentError
        `q` or `qd` has the wrong shape, is not real or not finite, or a torque is beyond float64.

    Examples
    --------
    >>> in_air = fl.lump(scene.varied({"link.*.drag": fl.Drag(coefficient=1.2)}))
    >>> rates = np.ones(chain.n)  # rad/s
    >>> print(f"{rates @ fl.drag_torque(in_air, q, rates):.2f} W")
    1.09 W
    """
    return all_torques(_with(require_type("chain", chain, Chain), chain.forces.keys() & {"drag"}), q, qd)


def force_torque(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Torque T of the force elements in `chain.forces` without a potential; errors and shape as in `drag_torque`."""
    return all_torques(_with(chain, chain.forces.keys() - POTENTIALS), q, qd)


def all_torques(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Torque T of all force elements in `chain.forces`; errors and shape as in `drag_torque`."""
    n, many = require_type("chain", chain, Chain).n, is_batch(q, qd)
    qs, qds = rows(n, {"q": q, "qd": qd}) if many else (vector(k, x, n)[None] for k, x in (("q", q), ("qd", qd)))
    found = np.zeros((len(qs), n))
    if chain.forces:
        motion_torques(chain.arrays, qs, qds, found)
        if not is_finite(found.reshape(-1)):
            raise beyond_float64(f"{names_of(chain)} of {chain.name!r}", q=qs, qd=qds)
    return found if many else found[0]


def force_slopes(chain: Chain, q: Array, qd: Array) -> tuple[Array, Array]:
    """∂T/∂q [N m/rad] and ∂T/∂q̇ [N m s/rad] of `force_torque` at one state, (n, n) each, exact up to rounding."""
    return _slopes(_with(chain, chain.forces.keys() - POTENTIALS), q, qd)


def potential_slopes(chain: Chain, q: Array) -> Array:
    """∂T/∂q [N m/rad] of the force elements with a potential, shape (n, n)."""
    return _slopes(with_potential(chain), q, np.zeros(chain.n))[0]


def _slopes(chain: Chain, q: Array, qd: Array) -> tuple[Array, Array]:
    by_angle, by_rate = np.zeros((2, chain.n, chain.n))
    if chain.forces:
        motion_slopes(chain.arrays, q, qd, by_angle, by_rate)
    return by_angle, by_rate


def has_potential(chain: Chain) -> bool:
    """Whether some force element of the chain has a potential."""
    return not POTENTIALS.isdisjoint(chain.forces)


def with_potential(chain: Chain) -> Chain:
    """Return the chain with only the force elements that have a potential."""
    return _with(chain, chain.forces.keys() & POTENTIALS)


def of_joint_rates(chain: Chain) -> Chain:
    """Return the chain with only the force elements that act on joint rates and so belong to T_FR."""
    return _with(chain, {name for name, rows in chain.forces.items() if "body" not in (rows.dtype.names or ())})


def _with(chain: Chain, names: set[str]) -> Chain:
    """Return the chain with only the force elements of these names; the same chain if it has no others."""
    if len(names) == len(chain.forces):
        return chain
    return dataclasses.replace(chain, forces={name: rows for name, rows in chain.forces.items() if name in names})


def names_of(chain: Chain) -> str:
    """Names of a chain's force elements, for messages."""
    return ", ".join(chain.forces)


def refuse_forces(what: str, chain: Chain, qd: Array | None = None) -> None:
    """Refuse a chain with force elements without a potential for a method that ignores them, unless it is at rest.

    Raises
    ------
    ArgumentError
        The chain has such force elements, which may act: it moves, or `qd` is not given.
    """
    others = [name for name in chain.forces if name not in POTENTIALS]
    if others and (qd is None or qd.any()):
        raise ArgumentError(
            f"{chain.name}: {what} do not support {', '.join(others)}; leave them out", id="arguments-not-counted"
        )
