"""The power balance, by which a run judges itself: E(t) − E(0) = W(t), the work done on the arm.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω

with T_EX of drives and prescribed motions, force f and moment m on the tip. W is integrated with the method of the
run, so that the imbalance E − E(0) − W is what the discretisation, or an unstable step, has done to the energy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain

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


def rounded(chain: Chain, energy: Array, work: Array, q: Array) -> Array:
    """What rounding may do to the balance in one step [J], shape (samples,).

    A step rounds angles, rates and work to eps of themselves, which changes the energies by a few eps of themselves;
    gravity's by eps |q| m g times the arm's reach, wherever its zero lies.
    """
    weight = chain.bodies["mass"].sum() * np.linalg.norm(chain.gravity) * reach(chain)
    size = np.abs(energy).sum(axis=0) + np.abs(work) + weight * np.maximum(1.0, np.abs(q).max(axis=1))
    return np.asarray(4 * np.finfo(float).eps * size)


def reach(chain: Chain) -> float:
    """How far from the origin of frame 0 any of the arm's masses can get [m], at most."""
    bodies = chain.bodies
    offsets, centers = (np.linalg.norm(bodies[name], axis=1) for name in ("translation", "center"))
    return float(offsets.sum() + centers.max())
