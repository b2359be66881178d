"""Readings of an instrument whose signal is known at samples and assumed to be linear between them.

    y(t) = gain · F[u](t_k − delay) + bias + bias_walk · W(t_k) + noise_k        t_k = k / rate ≤ t

The result is rounded to multiples of `resolution`; noise and the random walk W depend on time.
The filters F are exact for such a signal. Linear interpolation of a smooth signal with a sampling interval h has an
error of at most h² ü / 8.

White noise and random walks that depend only on a key and the time: the same in every run and order.

A walk W(t) starts at 0; its increments are independent, and normally distributed with the variance of their time [s].
Its values at whole seconds are sums of increments. Between them, the middle of an interval of length w is

    W(t + w/2) = (W(t) + W(t + w))/2 + √w/2 ξ        ξ normally distributed (construction of Lévy)

down to intervals shorter than any sampling period of sensors, in which W is linear.
"""

import functools
import hashlib
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array, Indices
from flexlink.describe.filters import Filter
from flexlink.describe.numbers import is_whole
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor, column_names
from flexlink.dynamics.filters import linear_filter, transition
from flexlink.dynamics.sensors.signals import Samples, signal_of


class Signal:
    """A signal, constant before its first sample and linear between samples, with the state of its filters."""

    def __init__(self, columns: int, filters: tuple[Filter, ...]) -> None:
        self.filters, self.chain, self.count = filters, linear_filter(filters), 0
        self._t, self._u = np.empty(16), np.empty((16, columns))
        self._z = np.empty((16, columns, len(self.chain.B)))

    def add(self, t: Array, u: Array) -> None:
        """Append samples u (samples, columns) at increasing times t [s]; replaces samples from t[0] on."""
        first = int(np.searchsorted(self._t[: self.count], t[0]))
        self.count = stop = first + len(t)
        while stop > len(self._t):
            self._t, self._u, self._z = (np.concatenate([a, np.empty_like(a)]) for a in (self._t, self._u, self._z))
        self._t[first:stop], self._u[first:stop] = t, u
        if not first:
            self._z[0] = self._u[0][:, None] * self.chain.settled
            first = 1
        if first == stop or not len(self.chain.B):
            return
        before, Δu = slice(first - 1, stop - 1), np.diff(self._u[first - 1 : stop], axis=0)
        Φ, Γ, Ψ, which = self._transitions(np.diff(self._t[first - 1 : stop]))
        forced = self._u[before, :, None] * Γ[which, None] + Δu[..., None] * Ψ[which, None]
        for k in range(first, stop):
            self._z[k] = self._z[k - 1] @ Φ[which[k - first]].T + forced[k - first]

    def _transitions(self, τ: Array) -> tuple[Array, Array, Array, Indices]:
        """Transitions of the different times τ (samples,) [s], and the index of each time among them."""
        different, which = np.unique(τ, return_inverse=True)
        found = [transition(self.filters, each) for each in different.tolist()]
        Φ, Γ, Ψ = (np.array([each[part] for each in found]) for part in range(3))
        return Φ, Γ, Ψ, which

    def at(self, times: Array) -> Array:
        """Output of the filters at times [s] up to the last sample, shape (times, columns)."""
        t, u = self._t[: self.count], self._u[: self.count]
        k = np.maximum(np.searchsorted(t, times, side="right") - 1, 0)
        after = np.minimum(k + 1, self.count - 1)
        h = np.where(after > k, t[after] - t[k], 1.0)
        τ = np.maximum(times - t[k], 0.0)  # constant before the first sample
        Δu = (u[after] - u[k]) / h[:, None] * τ[:, None]
        shown = self.chain.D * (u[k] + Δu)
        if not len(self.chain.B):
            return np.asarray(shown)
        Φ, Γ, Ψ, which = self._transitions(τ)
        by_state, by_u, by_Δu = self.chain.C @ Φ, Γ @ self.chain.C, Ψ @ self.chain.C
        shown += np.sum(self._z[k] * by_state[which, None], axis=2) + u[k] * by_u[which, None] + Δu * by_Δu[which, None]
        return np.asarray(shown)


class Instrument:
    """The instrument of a sensor. If it has no sampling rate, its noise changes every `between` seconds."""

    def __init__(self, sensor: Sensor, between: float) -> None:
        self.sensor, self.rate = sensor, sensor.rate or 1 / between
        self.signal = Signal(len(sensor.components), sensor.filters)

    def readings(self, times: Array) -> Array:
        """Readings at times [s] up to the last sample of the signal, shape (times, columns)."""
        sensor = self.sensor
        on_time = 1e-9  # a time up to this fraction of a period before an instant counts as this instant
        instants = np.floor(times * self.rate + on_time * np.maximum(1.0, times * self.rate))
        read_at = times if sensor.rate is None else instants / sensor.rate
        shown = sensor.gain * self.signal.at(read_at - sensor.delay) + sensor.bias
        keys = [f"{sensor.seed or 0} {sensor.name}{part}" for part in sensor.components]
        if sensor.bias_walk:
            shown += sensor.bias_walk * np.column_stack([walk(key, read_at) for key in keys])
        if sensor.noise:
            shown += sensor.noise * np.column_stack([noise(key, instants) for key in keys])
        if sensor.resolution is not None:
            shown = np.round(shown / sensor.resolution) * sensor.resolution
        return np.asarray(shown)


class Readings:
    """Instruments of a scene's sensors, with their signals up to the present time."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.names = scene, column_names(scene.sensor, scene.arm)
        self._instruments = [Instrument(sensor, scene.run.spacing) for sensor in scene.sensor]

    def after(self, seen: Samples) -> dict[str, float]:
        """Add one sample, return readings by column name; samples added before at later times are discarded."""
        shown: list[float] = []
        for instrument in self._instruments:
            instrument.signal.add(seen.t, signal_of(instrument.sensor, self._scene, seen).T)
            shown += instrument.readings(seen.t)[0].tolist()
        return dict(zip(self.names, shown, strict=True))


def _shown(sensor: Sensor, scene: Scene, t: Array, signal: Array) -> Array:
    instrument = Instrument(sensor, scene.run.spacing)
    instrument.signal.add(t, signal)
    return np.ascontiguousarray(instrument.readings(t).T)


def sensor_columns(scene: Scene, run: Samples) -> dict[str, Array]:
    """Reading columns of all sensors, by name; errors as in `signal_of`."""
    names = column_names(scene.sensor, scene.arm)
    if not len(run.t):
        return {name: np.empty(0) for name in names}
    found = [_shown(sensor, scene, run.t, signal_of(sensor, scene, run).T) for sensor in scene.sensor]
    return dict(zip(names, (column for columns in found for column in columns), strict=True))


def coarse_samples(scene: Scene, run: Samples) -> Iterator[Diagnostic]:
    """Warn about sensors whose signal is not resolved by its linear interpolation between the samples of a run.

    The interpolation error is estimated by leaving out every other sample, which makes it up to four times as large.
    """
    # fewer samples do not allow an estimate
    for sensor in scene.sensor if len(run.t) > 8 else ():
        times = [sensor.delay, *([] if sensor.rate is None else [1 / sensor.rate])]
        if not sensor.filters and all(is_whole(time / scene.run.spacing) for time in times):
            continue  # readings use only values of the signal at the run's samples
        plain = sensor.ideal
        signal = signal_of(sensor, scene, run).T
        fine, coarse = _shown(plain, scene, run.t, signal), _shown(plain, scene, run.t[::2], signal[::2])
        off, size = np.abs(fine[:, ::2] - coarse).max(), np.ptp(fine)
        # largest error that is not reported, relative to the range of a column
        if off > 0.01 * size:
            why = f"its signal is interpolated linearly between samples {scene.run.spacing:g} s apart"
            change = f"with half of them its readings change by {off / size:.1%} of their range; reduce run.sample"
            yield Diagnostic(f"sensor.{sensor.name}: {why}; {change}", "coarse-samples")


BLOCK = 256  # number of noise values generated at once
HALVINGS = 30  # halvings of a second; a walk is linear in the intervals of 1 ns that result


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
    hashed = int.from_bytes(hashlib.sha256(key.encode()).digest()[:16])
    raw: NDArray[np.uint64] = np.random.Philox(key=hashed, counter=[0, number, 0, 0]).random_raw(BLOCK)
    numbers = _normal(raw)
    numbers.flags.writeable = False
    return numbers


def walk(key: str, times: Array) -> Array:
    """Values of the walk of a key at times ≥ 0 [s]; they do not depend on the other times."""
    scaled = np.ldexp(times, HALVINGS)
    cells, levels = np.floor(scaled).astype(np.int64), np.arange(HALVINGS + 1)[:, None]
    around = cells >> (HALVINGS - levels)  # the interval of each level, whole seconds first
    ξ = _scattered(f"{key} walk", around[:-1] * HALVINGS + levels[:-1])
    whole = _whole_seconds(key, 1 << int(around[0].max(initial=0) + 1).bit_length())
    left, right = whole[around[0]], whole[around[0] + 1]
    for level in range(HALVINGS):
        middle = (left + right) / 2 + math.sqrt(2.0**-level) / 2 * ξ[level]
        later = around[level + 1] % 2 == 1
        left, right = np.where(later, middle, left), np.where(later, right, middle)
    return np.asarray(left + (right - left) * (scaled - cells))


@functools.lru_cache(maxsize=16)
def _whole_seconds(key: str, count: int) -> Array:
    """Values of a walk at 0, 1, …, count seconds."""
    return np.concatenate([[0.0], np.cumsum(_scattered(f"{key} seconds", np.arange(count)))])


def _scattered(key: str, numbers: NDArray[np.int64]) -> Array:
    """Normally distributed values for any integers ≥ 0: SplitMix64 (Steele, Lea and Flood 2014), started by a key.

    Unlike noise in blocks, each value costs the same, since a walk uses few of the values of its shortest intervals.
    """
    begin = np.uint64(int.from_bytes(hashlib.sha256(key.encode()).digest()[:8]))
    x = begin + (numbers.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return _normal(x ^ (x >> np.uint64(31)))


def _normal(raw: NDArray[np.uint64]) -> Array:
    """Convert random 64-bit numbers to normally distributed ones, the same in all versions of NumPy."""
    from scipy.special import ndtri  # noqa: PLC0415  slow import that few scenes need

    return np.asarray(ndtri(((raw >> np.uint64(11)) + 0.5) * math.ldexp(1.0, -53)))
