"""Gains with which an unknown sampled law reads the rates: a law in Python, or the caller of a simulator.

    k_d = √(Σ Δτ² / Σ Δq̇²)

They follow from how much the torques change when the rates change, and count in the error of the steps
(`STEPPER.read`). Torques that change for other reasons make the gains larger, and the steps more accurate than needed.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array


def nothing_read(chain: Chain) -> Array:
    """Memory of `impulses` before the first instant, (4, d): τ and q̇ of the last instant, and both sums."""
    return np.repeat([[np.nan], [np.nan], [0.0], [0.0]], len(chain.active), axis=1)


def impulses(memory: Array, chain: Chain, tau: Array, qd: Array, period: float) -> Array:
    """T k_d of all coordinates (n,) from the torques (d,) and rates (n,) of an instant; updates the `memory`."""
    fading = 0.95  # weight of earlier instants; about twenty count
    before, found = memory[:2].copy(), np.zeros(chain.n)
    memory[0], memory[1] = tau, qd[chain.active]
    with np.errstate(all="ignore"):  # a diverging run overflows
        if not np.isnan(before).any():
            memory[2:] = fading * memory[2:] + np.square(memory[:2] - before)
        torque, rate = memory[2:]
        gain = np.sqrt(np.divide(torque, rate, out=np.zeros_like(torque), where=rate > 0.0))
    found[chain.active] = period * np.nan_to_num(gain, posinf=0.0)
    return found
