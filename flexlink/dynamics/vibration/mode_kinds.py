"""Classification of modes as elastic, pendulum, rigid or artificial by their energy.

    E = φ* (k + |λ| d) φ          stored in springs, and dissipated by their dampers
    P = |φ* (K − k) φ|            stored in gravity, tip wrench and rotation
    F = |λ| Σ d |φ|²              dissipated in joints without springs
    A = |λ|² Σ J |φ|²             kinetic energy of the inertias J that cells lend to the last segments of links

A mode is artificial if A > (E + P + F)/2, otherwise elastic if E > P + F, otherwise a pendulum mode if loads restore it
or make it unstable. All others are rigid: they have λ = 0, or friction brakes them. An overdamped mode of a beam is
elastic, however fast it decays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Complex


class Loads(NamedTuple):
    """Load stiffness times mode shapes, (K − k) φ, shape (modes, n), with data to detect rounding errors."""

    products: NDArray[np.inexact]
    square: Array  # S² of `Stiffness`, shape (n,)
    rounding: float


def mode_kinds(
    λ: Complex, shapes: NDArray[np.inexact], loads: Loads, stiffness: Array, damping: Array, coupled: Array, lent: Array
) -> tuple[tuple[str, ...], Array]:
    """Return the kind of every mode, and the elastic share of its energy, E / (E + P + F), shape (modes,).

    Parameters
    ----------
    λ, shapes
        Eigenvalues [1/s], shape (modes,), and mode shapes of the free coordinates, shape (modes, n).
    loads
        Products of the load stiffness with the mode shapes.
    stiffness, damping
        Springs [N m/rad] and derivatives of friction at rest [N m s/rad] of the free coordinates, shape (n,).
    coupled
        Contribution of springs and dampers between two coordinates to E, shape (modes,).
    lent
        J of the free coordinates [kg m²], shape (n,).
    """
    square, spring = np.abs(shapes) ** 2, stiffness > 0
    losses = np.abs(λ)[:, None] * damping * square
    E = square @ stiffness + losses @ spring + coupled
    F = losses @ ~spring
    P = np.abs(np.einsum("mi,mi->m", shapes.conj(), loads.products))
    moving, total = λ != 0, E + P + F  # if nothing moves, E is a rounding error
    share = np.where(moving, E / np.where(total > 0, total, 1.0), 0.0)
    loaded = moving & (P > F) & (loads.rounding * (square @ loads.square) < P)
    names = np.where(share > 0.5, "elastic", np.where(loaded, "pendulum", "rigid"))
    names = np.where(np.abs(λ) ** 2 * (square @ lent) > 0.5 * total, "artificial", names)
    return tuple(names.tolist()), share
