"""How far single fixed steps of an implicit method are off: one of them against two of half the size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.kernels import clock, controlled
from flexlink.kernels.implicit import ImplicitWork
from flexlink.kernels.samples import tips_and_energies
from flexlink.motion.result import Record

Array = NDArray[np.float64]

STEP_SETTINGS = slice(6, 8)
"""Where `advance` takes the shortest and the longest step from."""


class Probe:
    """Takes steps from the samples of a run, on scratch of its own.

    Parameters
    ----------
    work
        Scratch of the run's method.
    settings
        The run's, as `advance` takes them.
    record
        The samples.
    """

    def __init__(self, work: ImplicitWork, settings: tuple[float, ...], record: Record) -> None:
        self.work, self.settings, self.record = work, settings, record
        self.count = np.zeros(clock.COUNTS, np.int64)

    def errors(self, rows: NDArray[np.int64]) -> Array:
        """Distance [m] of the tips that one step and two of half the size reach from each of these samples."""
        h, tips, n = self.settings[-1], np.empty((2, 3)), self.record.chain.n
        found = np.empty(len(rows))
        for k, row in enumerate(rows):
            ends = np.array([self._end(int(row), h, parts) for parts in (1, 2)])
            tips_and_energies(self.record.chain.arrays, ends, np.zeros((2, n)), tips, np.empty((3, 2)))
            found[k] = np.linalg.norm(tips[1] - tips[0])
        return found

    def _end(self, row: int, h: float, parts: int) -> Array:
        """Angles after a step of length h, in so many parts, from a sample; nan where the iteration does not end."""
        record, t = self.record, float(self.record.t[row])
        state = record.q[row].copy(), record.qd[row].copy(), np.zeros(record.chain.n), np.zeros(2)
        controlled.begin(t, record.inputs, state, np.zeros(record.chain.n), record.scratch)
        now, none = self.work.clock, np.empty((0, record.chain.n))
        now[clock.TIME], now[clock.STEP] = t, h / parts
        now[clock.LAST] = now[clock.ERROR] = now[clock.CEILING] = now[clock.REFUSED] = now[clock.ACCEPTED] = 0.0
        self.count[:] = 0
        settings = *self.settings[: STEP_SETTINGS.start], h / parts, h / parts
        how = controlled.advance(
            self.work, record.scratch, record.inputs, settings, self.count, state, np.array([t + h]),
            (np.empty(0), none, none, np.empty(0)), 2 * parts,
        )  # fmt: skip
        return state[0] if how == controlled.ENDED else np.full(record.chain.n, np.nan)
