"""The slowest and the fastest swing of a chain's springs, in O(n) a step: what a method and its steps are chosen by."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SingularMassError
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.terms import inverse_dynamics

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
    return dataclasses.replace(chain, hinges=hinges, gravity=np.zeros(3))


def slowest_frequency(chain: Chain, q: Array) -> float:
    """Lowest angular frequency of the springs [rad/s], joints without one free, without gravity.

    inf if none bends, or if what bends is so light that rounding leaves nothing of its mass.

    K φ = ω² S φ on the hinges with springs, S = M_pp − M_pa M_aa⁺ M_ap what is left of M with the free joints a, whose
    M_aa is singular where a stretched arm moves nothing but a point mass: the power iteration φ ← K⁻¹ S φ.
    """
    return FOUND(chain, ("slowest", q.tobytes()), lambda: _slowest_frequency(chain, q))


def _slowest_frequency(chain: Chain, q: Array) -> float:
    bent = np.flatnonzero((chain.stiffness > 0) & (chain.hinges["prescribed"] == 0))
    free = np.flatnonzero((chain.stiffness == 0) & (chain.hinges["prescribed"] == 0))
    if not len(bent):
        return np.inf
    bare, zero = inertia_alone(chain), np.zeros(chain.n)

    def times_mass(φ: Array) -> Array:
        return inverse_dynamics(bare, q, zero, φ)

    units = np.zeros((len(free), chain.n))
    units[np.arange(len(free)), free] = 1.0
    beside = np.array([times_mass(unit) for unit in units]).reshape(len(free), chain.n)
    following = -np.linalg.pinv(beside[:, free]) @ beside[:, bent]
    φ = np.zeros(chain.n)
    φ[bent], last = 1.0, 0.0
    for _ in range(PASSES):
        φ[free] = following @ φ[bent]
        after = times_mass(φ)[bent] / chain.stiffness[bent]
        square = float(φ[bent] @ (chain.stiffness[bent] * φ[bent]) / (φ[bent] @ (chain.stiffness[bent] * after)))
        φ[bent] = after / np.abs(after).max()
        if abs(square - last) <= CLOSE * square:
            break
        last = square
    return float(np.sqrt(square)) if square > 0 else np.inf


def fastest_frequency(chain: Chain, q: Array) -> float:
    """Highest angular frequency of the springs [rad/s], as an estimate from below: K φ = ω² M φ.

    0 if there is none; inf where rounding leaves a joint nothing of its inertia.
    """
    find = functools.partial(_largest_eigenvalue, chain, q, chain.stiffness)
    return float(np.sqrt(FOUND(chain, ("stiffness", q.tobytes()), find)))


def fastest_decay(chain: Chain, q: Array) -> float:
    """Highest rate at which the dampers alone take away a speed [1/s], as an estimate from below: D φ = δ M φ."""
    return FOUND(chain, ("damping", q.tobytes()), functools.partial(_largest_eigenvalue, chain, q, chain.damping))


def _largest_eigenvalue(chain: Chain, q: Array, weights: Array) -> float:
    """Largest λ of W φ = λ M φ, W diagonal: the power iteration φ ← M⁻¹ W φ."""
    weights = np.where(chain.hinges["prescribed"] == 0, weights, 0.0)
    if not weights.any():
        return 0.0
    bare, zero = inertia_alone(chain), np.zeros(chain.n)
    φ, last = np.where(np.arange(chain.n) % 2, 1.0, -1.0), 0.0
    for _ in range(PASSES):
        try:
            φ = forward_dynamics(bare, q, zero, weights * φ)
        except SingularMassError:
            return np.inf
        size = float(np.abs(φ).max())
        φ /= size
        if abs(size - last) <= CLOSE * size:
            break
        last = size
    return size
