"""The power balance, by which a run judges itself: E(t) − E(0) = W(t), the work done on the arm.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω

with T_EX of drives and prescribed motions, force f and moment m on the tip. W is integrated with the method of the
run, so that the imbalance E − E(0) − W is what the discretisation, or an unstable step, has done to the energy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHARE = 0.1
"""Imbalance, as a part of the energy exchanged, from which a run is garbage. An error ε of all rates changes the
kinetic energy by 2 ε of itself: a tenth is lost or made where the rates are off by 5 %."""


def imbalance(energy: Array, work: Array, start: Array) -> Array:
    """E(t) − E(0) − W(t) [J], shape (samples,), from the energies T, V_g, V_e (3, samples), at first (3,)."""
    return np.asarray((energy - start[:, None]).sum(axis=0) - work)


def turned_over(energy: Array, work: Array, start: Array) -> Array:
    """T + |ΔV_g| + |ΔV_e| + |W| [J], shape (samples,); its largest value so far is the energy exchanged."""
    return np.asarray(energy[0] + np.abs(energy[1:] - start[1:, None]).sum(axis=0) + np.abs(work))
