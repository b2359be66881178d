"""Repeat a benchmark in another engine, with the M and torques that it computes from the exported file.

As a function of one angle, M and every torque of a chain are trigonometric polynomials of degree at most 2. Riesz's
formula gives the exact derivative: f'(q) = Σ_k (−1)^(k+1) f(q + x_k) / (8 sin²(x_k/2)), x_k = (2k − 1) π/4, k = 1 … 4.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from flexlink.common.types import Array, Indices
from flexlink.engines import Engine
from flexlink.engines.mujoco import MujocoEngine

SHIFTS = np.pi * np.array([1, 3, 5, 7]) / 4
WEIGHTS = np.array([1, -1, 1, -1]) / (8 * np.sin(SHIFTS / 2) ** 2)


def slope(torque: Callable[[Array], Array], q: Array) -> Array:
    """∂torque/∂q, shape (n, n)."""
    columns = [sum(w * torque(q + shift * e) for shift, w in zip(SHIFTS, WEIGHTS, strict=True)) for e in np.eye(len(q))]
    return np.asarray(columns).T


def springs(engine: Engine) -> Array:
    """Stiffness matrix ∂T_FL/∂q of the engine, exact since T_FL is linear in q."""
    zero = engine.elastic_torque(np.zeros(engine.n))
    return np.asarray([engine.elastic_torque(e) - zero for e in np.eye(engine.n)]).T


def load_stiffness(engine: Engine, q: Array, wrench: Array | None = None, qd: Array | None = None) -> Array:
    """∂(T_GC − Jᵀ w)/∂q of the engine at constant rates, with w a dead tip wrench."""
    rates = np.zeros(engine.n) if qd is None else qd
    return slope(lambda x: engine.bias_torque(x, rates, tip_wrench=wrench), q)


def follower_stiffness(engine: MujocoEngine, q: Array, force: Array) -> Array:
    """∂(T_GC − Jᵀ w)/∂q as in `load_stiffness`, for a force [N] in tip axes that rotates with the tip."""

    def torque(x: Array) -> Array:
        engine.gravity_torque(x)  # updates the poses of the bodies
        R = engine.data.xmat[engine.tip].reshape(3, 3)
        return engine.bias_torque(x, np.zeros(engine.n), tip_wrench=np.concatenate([R @ force, np.zeros(3)]))

    return slope(torque, q)


def chain_frequencies(engine: Engine) -> Array:
    """All ω of a straight chain with a spring in every joint. The eigenvalues of L⁻¹ M L⁻ᵀ, K = L Lᵀ, are 1/ω².

    In this form slow modes are accurate to rounding error, however fast the fast modes are.
    """
    L = linalg.cholesky(springs(engine), lower=True)
    half = linalg.solve_triangular(L, engine.mass_matrix(np.zeros(engine.n)), lower=True)
    S = linalg.solve_triangular(L, half.T, lower=True)
    return np.asarray(1 / np.sqrt(linalg.eigvalsh((S + S.T) / 2)[::-1]))


def squares(engine: Engine, q: Array, K: Array, free: Indices) -> NDArray[np.complex128]:
    """ω² of K φ = ω² M φ for the coordinates `free`, sorted by real part."""
    block = np.ix_(free, free)
    found = linalg.eigvals(K[block], engine.mass_matrix(q)[block])
    return np.asarray(found[np.argsort(found.real, kind="stable")])


def symmetric_squares(engine: Engine, q: Array, K: Array, free: Indices, more: Array | float = 0.0) -> Array:
    """The real ω² for a conservative load, as by `squares` but with the symmetric solver; `more` is added to M."""
    block = np.ix_(free, free)
    part = K[block]
    return np.asarray(linalg.eigh((part + part.T) / 2, (engine.mass_matrix(q) + more)[block], eigvals_only=True))
