"""Frequencies of a clamped beam with shear (Timoshenko 1921) or with an axial tip force, by transfer matrices.

The state is the deflection w, the rotation ψ of the section, the moment M and the force Q normal to the undeformed
axis. P is a compressive dead force on the tip, used only for slender beams, which have w' = ψ:

    w' = ψ + Q / k_s G A      ψ' = M / EI      M' = −Q − (ρI ω² + P) ψ      Q' = −ρA ω² w

A clamped end has w = ψ = 0, a free end M = Q = 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from flexlink.common.types import Array


class Beam(NamedTuple):
    """EI [N m²], ρA [kg/m], ρI [kg m], k_s G A [N], length [m] and compressive force [N]."""

    EI: float
    mass: float
    rotary: float
    shear: float
    length: float
    push: float = 0.0


def free_tip(beam: Beam, ω: float) -> float:
    """Determinant of M and Q at the tip for the two states that satisfy the clamped root, in scaled units."""
    L, EI = beam.length, beam.EI
    A = np.zeros((4, 4))  # lengths in L, moments in EI / L, forces in EI / L²
    A[0, 1], A[0, 3] = 1.0, EI / (beam.shear * L**2)
    A[1, 2] = 1.0
    A[2, 1], A[2, 3] = -(beam.rotary * ω**2 + beam.push) * L**2 / EI, -1.0
    A[3, 0] = -beam.mass * ω**2 * L**4 / EI
    return float(np.linalg.det(expm(A)[2:, 2:]))


def frequencies(beam: Beam, count: int) -> Array:
    """The first natural angular frequencies [rad/s]."""
    unit = min(math.sqrt(beam.EI / beam.mass) / beam.length**2, math.sqrt(beam.shear / beam.mass) / beam.length)
    found: list[float] = []
    low = 1e-3 * unit
    while len(found) < count:
        high = low + 0.25 * unit
        if free_tip(beam, low) * free_tip(beam, high) < 0:
            found.append(float(brentq(lambda ω: free_tip(beam, ω), low, high, xtol=1e-14 * unit, rtol=1e-14)))
        low = high
    return np.array(found)
