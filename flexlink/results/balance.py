"""The power balance, by which a run judges itself: E(t) − E(0) = W(t), the work done on the arm.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω

with T_EX of drives and prescribed motions, force f and moment m on the tip. W is integrated with the method of the
run, so that the imbalance E − E(0) − W is what the discretisation, or an unstable step, has done to the energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics import rounding

SHARE = 0.1
"""Imbalance, as a part of the energy exchanged, from which a run is garbage. An error ε of all rates changes the
kinetic energy by 2 ε of itself: a tenth is lost or made where the rates are off by 5 %."""


def imbalance(energy: Array, work: Array, start: Array) -> Array:
    """E(t) − E(0) − W(t) [J], shape (…, samples), from the energies T, V_g, V_e (…, 3, samples), at first (…, 3)."""
    return np.asarray((energy - start[..., None]).sum(axis=-2) - work)


def turned_over(energy: Array, work: Array, start: Array) -> Array:
    """T + |ΔV_g| + |ΔV_e| + |W| [J], shape (…, samples); its largest value so far is the energy exchanged."""
    moved = np.abs(energy[..., 1:, :] - start[..., 1:, None]).sum(axis=-2)
    return np.asarray(energy[..., 0, :] + moved + np.abs(work))


class Allowance(NamedTuple):
    """What a tolerance explains of an imbalance."""

    energy: Array | float = 0.0  # at each sample [J]
    share: float = np.inf  # of the energy exchanged, at most
    damped: bool = False  # losses are explained: an implicit method damps fast vibrations
    compared: bool = False  # the run is never stopped for its energy: a second run judges

    def of(self, imbalance: Array, exchanged: Array) -> Array:
        """Of such imbalances where so much was exchanged [J]."""
        most = np.minimum(self.energy, self.share * exchanged) if np.isfinite(self.share) else self.energy
        return np.where(self.damped & (imbalance < 0), np.inf, most)


class Judgement(NamedTuple):
    """Of some samples, each array of shape (samples,)."""

    imbalance: Array  # [J]
    exchanged: Array  # up to each sample [J]
    explained: Array  # by rounding, and by the tolerance [J]
    rounded: Array  # by rounding alone [J]
    garbage: NDArray[np.bool_]


NOTHING = Allowance()


class Balance:
    """The power balance of a run so far, from the energies (3,) that it starts with."""

    def __init__(self, chain: Chain, start: Array) -> None:
        self.chain, self.start = chain, start
        self._exchanged = self._rounded = 0.0  # largest so far [J]

    def judge(
        self, energy: Array, work: Array, q: Array, steps: Array | int, allowance: Allowance = NOTHING
    ) -> Judgement:
        """Energies (3, samples), work and angles (samples, n) of the next samples, after so many steps each."""
        r = imbalance(energy, work, self.start)
        X = _running_largest(self._exchanged, turned_over(energy, work, self.start))
        one = _running_largest(self._rounded, rounding.of_energy_balance(self.chain, energy, work, q))
        self._exchanged, self._rounded = float(X[-1]), float(one[-1])
        ε = one * (1 + steps)
        explained = ε + allowance.of(r, X)
        garbage = (np.abs(r) > SHARE * X + explained) & (not allowance.compared)
        return Judgement(r, X, explained, ε, garbage)


def _running_largest(so_far: float, values: Array) -> Array:
    return np.asarray(np.maximum.accumulate(np.maximum(so_far, values)))
