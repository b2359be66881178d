"""Readings of an instrument whose signal is known at samples and assumed to be linear between them.

    y(t) = gain · LP[u](t_k − delay) + bias + noise_k, rounded to multiples of `resolution`, t_k = k / rate ≤ t

The low-pass filter LP is exact for such a signal. Linear interpolation of a smooth signal with a sampling interval h
has an error of at most h² ü / 8.
"""

from __future__ import annotations

import functools
import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Complex
from flexlink.describe.sensor import Sensor
from flexlink.describe.whole_steps import is_whole
from flexlink.dynamics.sensors.low_pass import LowPass, butterworth

BLOCK = 256
"""Number of noise values generated at once."""


class Signal:
    """A signal up to the last sample, linear between samples, with the state of its low-pass filter.

    Before the first sample the signal is constant. Samples are appended, or replaced from an earlier time on.
    """

    def __init__(self, columns: int, low_pass: LowPass | None) -> None:
        self.low_pass, self.count = low_pass, 0
        modes = 0 if low_pass is None else len(low_pass.poles)
        self._t, self._u = np.empty(16), np.empty((16, columns))
        self._z: Complex = np.empty((16, columns, modes), np.complex128)

    def add(self, t: Array, u: Array) -> None:
        """Append samples u (samples, columns) at increasing times t [s]; replaces samples from t[0] on."""
        first = int(np.searchsorted(self._t[: self.count], t[0]))
        self.count = stop = first + len(t)
        while stop > len(self._t):
            self._t, self._u, self._z = (np.concatenate([a, np.empty_like(a)]) for a in (self._t, self._u, self._z))
        self._t[first:stop], self._u[first:stop] = t, u
        if self.low_pass is not None:
            self._follow(self.low_pass, first, stop)

    def _follow(self, low_pass: LowPass, first: int, stop: int) -> None:
        if not first:
            self._z[0] = low_pass.settled(self._u[0])
            first = 1
        before = slice(first - 1, stop - 1)
        h = np.diff(self._t[first - 1 : stop])[:, None]
        g = np.diff(self._u[first - 1 : stop], axis=0) / h
        forced = low_pass.advanced(np.zeros_like(self._z[before]), self._u[before], g, np.broadcast_to(h, g.shape))
        decay = np.exp(h * low_pass.poles)
        for k in range(first, stop):
            self._z[k] = decay[k - first] * self._z[k - 1] + forced[k - first]

    def at(self, times: Array) -> Array:
        """Output of the low-pass filter at times [s] up to the last sample, shape (times, columns)."""
        t, u = self._t[: self.count], self._u[: self.count]
        k = np.maximum(np.searchsorted(t, times, side="right") - 1, 0)
        after = np.minimum(k + 1, self.count - 1)
        h = np.where(after > k, t[after] - t[k], 1.0)[:, None]
        g = (u[after] - u[k]) / h
        τ = np.maximum(times - t[k], 0.0)[:, None]  # constant before the first sample
        if self.low_pass is None:
            return np.asarray(u[k] + g * τ)
        return self.low_pass.output(self.low_pass.advanced(self._z[k], u[k], g, np.broadcast_to(τ, g.shape)))


class Instrument:
    """The instrument of a sensor. If it has no sampling rate, its noise changes every `between` seconds."""

    def __init__(self, sensor: Sensor, between: float) -> None:
        self.sensor, self.between, self.rate = sensor, between, sensor.rate or 1 / between
        low_pass = None if sensor.low_pass is None else butterworth(sensor.low_pass, sensor.order or 1)
        self.signal = Signal(len(sensor.components), low_pass)

    def readings(self, times: Array) -> Array:
        """Readings at times [s] up to the last sample of the signal, shape (times, columns)."""
        sensor = self.sensor
        on_time = 1e-9  # a time up to this fraction of a period before an instant counts as this instant
        instants = np.floor(times * self.rate + on_time * np.maximum(1.0, times * self.rate))
        read_at = times if sensor.rate is None else instants / sensor.rate
        shown = sensor.gain * self.signal.at(read_at - sensor.delay) + sensor.bias
        if sensor.noise:
            values = [noise(f"{sensor.seed or 0} {sensor.name}{part}", instants) for part in sensor.components]
            shown += sensor.noise * np.column_stack(values)
        if sensor.resolution is not None:
            shown = np.round(shown / sensor.resolution) * sensor.resolution
        return np.asarray(shown)

    @property
    def known_at_samples(self) -> bool:
        """Whether readings use only values of the signal at the run's samples, without filtering or interpolation."""
        sensor, apart = self.sensor, self.between
        times = [sensor.delay, *([] if sensor.rate is None else [1 / sensor.rate])]
        return sensor.low_pass is None and all(is_whole(time / apart) for time in times)


def noise(key: str, instants: Array) -> Array:
    """Normally distributed values for the instants with these numbers; they do not depend on their order or the run."""
    blocks, offsets = np.divmod(instants.astype(np.int64), BLOCK)
    found = np.empty(len(instants))
    for block in np.unique(blocks).tolist():
        found[blocks == block] = _block(key, block)[offsets[blocks == block]]
    return found


@functools.lru_cache(maxsize=256)
def _block(key: str, number: int) -> Array:
    """Noise values from Philox's counter and the inverse distribution, the same in all versions of NumPy."""
    from scipy.special import ndtri  # noqa: PLC0415  slow import that few scenes need

    hashed = int.from_bytes(hashlib.sha256(key.encode()).digest()[:16])
    raw: NDArray[np.uint64] = np.random.Philox(key=hashed, counter=[0, number, 0, 0]).random_raw(BLOCK)
    numbers: Array = ndtri(((raw >> np.uint64(11)) + 0.5) * math.ldexp(1.0, -53))
    numbers.flags.writeable = False
    return numbers
