"""Elastic, pendulum and rigid modes, told apart by where their energy is.

    E = φ* (k + |λ| d) φ          stored in springs, and dissipated by their dampers
    P = |φ* (K − k) φ|            stored in gravity, tip wrench and rotation
    F = |λ| Σ d |φ|²              dissipated in joints without springs

A mode is elastic if E > P + F. Of the others, loads hold a pendulum mode, or make it fall; nothing holds a rigid one:
λ = 0, or it loses its speed to friction. An overdamped mode of a beam is elastic, however fast it decays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Complex


class Loads(NamedTuple):
    """The load stiffness times shapes, (K − k) φ, shape (modes, n), and what its zeros are told from rounding by."""

    products: NDArray[np.inexact]
    square: Array  # S² of `Stiffness`, shape (n,)
    rounding: float


def mode_kinds(
    λ: Complex, shapes: NDArray[np.inexact], loads: Loads, stiffness: Array, damping: Array, coupled: Array
) -> tuple[tuple[str, ...], Array]:
    """The kind of every mode, and the share of its energy that is elastic, E / (E + P + F), shape (modes,).

    Parameters
    ----------
    λ, shapes
        Eigenvalues [1/s], shape (modes,), and shapes of the free coordinates, shape (modes, n).
    loads
        What loads hold of them.
    stiffness, damping
        Springs [N m/rad] and slopes of friction at rest [N m s/rad] of the free coordinates, shape (n,).
    coupled
        What springs and dampers between two coordinates add to E, shape (modes,).
    """
    square, spring = np.abs(shapes) ** 2, stiffness > 0
    losses = np.abs(λ)[:, None] * damping * square
    E = square @ stiffness + losses @ spring + coupled
    F = losses @ ~spring
    P = np.abs(np.einsum("mi,mi->m", shapes.conj(), loads.products))
    moving, total = λ != 0, E + P + F  # what rounding leaves of E where nothing moves is no share
    share = np.where(moving, E / np.where(total > 0, total, 1.0), 0.0)
    loaded = moving & (P > F) & (loads.rounding * (square @ loads.square) < P)
    names = np.where(share > 0.5, "elastic", np.where(loaded, "pendulum", "rigid"))
    return tuple(names.tolist()), share
