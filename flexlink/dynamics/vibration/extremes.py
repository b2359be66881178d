"""The slowest and the fastest swing of a chain's springs, in O(n) a step: what a method and its steps are chosen by."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.kernels.forward.mass_plus_plane import PlanePosture, plane_posture
from flexlink.kernels.forward.mass_plus_space import SpacePosture, space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue, smallest_square

FOUND = Memo(256)
"""Frequencies by chain and posture: runs of one scene share them."""

PASSES, CLOSE = 30, 1e-2
"""Passes of the power iteration at most, and the relative change of ω² at which it ends: what depends on it, an error's
weight and the choice of a method, asks for no more."""


def inertia_alone(chain: Chain) -> Chain:
    """The chain without gravity, springs and friction: at rest its dynamics are M q̈ = τ."""
    hinges = chain.hinges.copy()
    for name in ("stiffness", "damping", "coulomb"):
        hinges[name] = 0.0
    return dataclasses.replace(chain, hinges=hinges, gravity=np.zeros(3), couplings=chain.couplings[:0])


def slowest_frequency(chain: Chain, q: Array) -> float:
    """Lowest angular frequency of the springs [rad/s], joints without one free, without gravity.

    inf if none bends, or if what bends is so light that rounding leaves nothing of its mass.

    K φ = ω² S φ on the hinges with springs, S = M_pp − M_pa M_aa⁺ M_ap what is left of M with the free joints a, whose
    M_aa is singular where a stretched arm moves nothing but a point mass: the power iteration φ ← K⁻¹ S φ.
    """
    return FOUND.calling(_slowest_frequency, chain, q)


def _slowest_frequency(chain: Chain, q: Array) -> float:
    square = smallest_square(chain.arrays, q, PASSES, CLOSE)
    if math.isnan(square):  # a torque is beyond float64: this names it
        inverse_dynamics(inertia_alone(chain), q, np.zeros(chain.n), (chain.stiffness > 0) * 1.0)
    return math.sqrt(square) if square > 0 else math.inf


def fastest_frequency(chain: Chain, q: Array, stiffness: Array | None = None) -> float:
    """Highest angular frequency of springs [rad/s], as an estimate from below: K φ = ω² M φ.

    `stiffness` is the diagonal of K, the chain's or others; couplings are the chain's.

    0 if there is none; inf where rounding leaves a joint nothing of its inertia.
    """
    return float(np.sqrt(_found(chain, "stiffness", q, chain.stiffness if stiffness is None else stiffness)))


def fastest_decay(chain: Chain, q: Array, damping: Array | None = None) -> float:
    """Highest rate at which dampers take away a speed [1/s], from below: D φ = δ M φ, D likewise."""
    return _found(chain, "damping", q, chain.damping if damping is None else damping)


def fastest_of(chain: Chain, q: Array, stiffness: Array, damping: Array) -> tuple[float, float]:
    """`fastest_frequency` [rad/s] and `fastest_decay` [1/s] of these diagonals, found together."""
    return FOUND.calling(_fastest, chain, q, stiffness, damping)


def _fastest(chain: Chain, q: Array, stiffness: Array, damping: Array) -> tuple[float, float]:
    named = {"stiffness": stiffness, "damping": damping}
    some = {name: weights for name, weights in named.items() if np.count_nonzero(weights)}
    posture = scratch(chain) if some else None
    found = {name: _largest_eigenvalue(chain, name, q, weights, posture) for name, weights in some.items()}
    return float(np.sqrt(found.get("stiffness", 0.0))), found.get("damping", 0.0)


def _found(chain: Chain, name: str, q: Array, weights: Array) -> float:
    return FOUND.calling(_largest_eigenvalue, chain, name, q, weights) if weights.any() else 0.0


def scratch(chain: Chain) -> PlanePosture | SpacePosture:
    """Scratch of a chain's postures."""
    posture: PlanePosture | SpacePosture = (plane_posture if chain.is_planar else space_posture)(*chain.arrays)
    return posture


def _largest_eigenvalue(
    chain: Chain, name: str, q: Array, weights: Array, posture: PlanePosture | SpacePosture | None = None
) -> float:
    """Largest λ of W φ = λ M φ: the power iteration φ ← M⁻¹ W φ, at rest where motion is prescribed.

    W is of "stiffness" or "damping": `weights` on its diagonal, and the chain's couplings.
    """
    posture = posture or scratch(chain)
    weights, coupled = np.ascontiguousarray(weights), np.ascontiguousarray(chain.couplings[name])
    found = largest_eigenvalue(chain.arrays, q, weights, coupled, PASSES, CLOSE, posture)
    return float(found) if np.isfinite(found) else np.inf
