"""The power balance, by which a run checks itself: E(t) − E(0) = W(t), where W is the work done on the arm.

    d/dt (T + V_g + V_e) = q̇·(T_EX − T_FR) + f·ṗ + m·ω

T_EX are the torques of drives and of held joints; f and m are force and moment on the tip. W is integrated with the
method of the run, so the imbalance E − E(0) − W is the energy error that the discretisation or an unstable step causes.
"""

import functools
from collections.abc import Callable

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import Kept, Memo
from flexlink.common.types import Array, Indices
from flexlink.kernels.stepping.judgement import SEEN, Allowance, Bounds, look_at
from flexlink.kernels.tools.machine_code import direct

SHARE = 0.1
"""Imbalance relative to the energy exchanged above which a run is invalid.

A relative error ε of all rates changes the kinetic energy by 2 ε: a tenth if the rates are off by 5 %.
"""


def imbalance(energy: Array, work: Array, start: Array) -> Array:
    """E(t) − E(0) − W(t) [J], shape (…, samples), from energies T, V_g, V_e (…, 3, samples), initially (…, 3)."""
    return np.asarray((energy - start[..., None]).sum(axis=-2) - work)


def turned_over(energy: Array, work: Array, start: Array) -> Array:
    """T + |ΔV_g| + |ΔV_e| + |W| [J], shape (…, samples); its running maximum is the energy exchanged."""
    moved = np.abs(energy[..., 1:, :] - start[..., 1:, None]).sum(axis=-2)
    return np.asarray(energy[..., 0, :] + moved + np.abs(work))


NOTHING = Allowance()  # allowance of fixed steps, which is zero


class Balance:
    """Checks of a run's samples; `seen`, indexed by SEEN, contains their running results."""

    def __init__(
        self, chain: Chain, force: Array, *, insisted: bool = False, bend: float = np.inf, near: float = np.inf,
        kept: Kept | None = None,
    ) -> None:  # fmt: skip
        self.chain, self.kept, given = chain, Kept() if kept is None else kept, (insisted, bend, near)
        find = functools.partial(_bounds, chain, force, *given)
        self.bounds: Bounds = self.kept("bounds", (given, force.tobytes()), find)
        self.seen = np.empty(SEEN.size)
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self.seen[:] = 0.0
        self.seen[SEEN.garbage] = -1.0

    def start(self, energy: Array, tip: Array) -> None:
        """Set the energies (3,) [J] and the tip position (3,) [m] at the start of the run."""
        self.seen[SEEN.start : SEEN.start + 3] = energy
        self.seen[SEEN.low : SEEN.low + 3] = self.seen[SEEN.high : SEEN.high + 3] = tip

    def look(self, first: int, end: int, samples: tuple[Array, ...], allowance: Allowance = NOTHING) -> tuple[int, int]:
        """Check samples by `look_at`; return the index of the first invalid one (or `end`) and its fault (WRONG)."""
        row, wrong = self.compile(samples)(first, end, samples, self.chain.hinges, self.bounds, allowance, self.seen)
        return row, wrong

    def compile(self, samples: tuple[Array, ...]) -> Callable[..., tuple[int, int]]:
        """Compile the check for samples in arrays of these types."""
        of_these = 0, 0, samples, self.chain.hinges, self.bounds, NOTHING, self.seen
        return self.kept("look", None, functools.partial(direct, look_at, *of_these, types=self.kept.types))


def _bounds(chain: Chain, force: Array, insisted: bool, bend: float, near: float) -> Bounds:
    limited = np.isfinite(chain.hinges["lower"]).tobytes()
    joints = WATCHED(chain.coordinates, (limited, chain.held.tobytes()), lambda: _watched(chain))
    return Bounds(force, chain.weight * chain.size, SHARE, insisted, bend, near, *joints)


WATCHED = Memo(64)  # cache by chain layout: joints that bend, joints with limits, and driven joints that are not held


def _watched(chain: Chain) -> tuple[Indices, Indices, Indices]:
    free = chain.active
    if chain.held.any():
        free = free[~chain.held[free]]
        free.flags.writeable = False  # read-only like `chain.active`, so that the same compiled code fits
    return chain.bending, np.isfinite(chain.hinges["lower"]).nonzero()[0], free
