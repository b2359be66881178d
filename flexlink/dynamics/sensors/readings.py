"""Sensor readings of a scene: during a simulation, and as result columns at the samples of a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor, column_names
from flexlink.dynamics.sensors.instrument import Instrument
from flexlink.dynamics.sensors.signals import Samples, signal_of


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


# Result columns with the sensor readings of a scene at the samples of a run.


def readings_of(sensor: Sensor, scene: Scene, run: Samples) -> Array:
    """Readings of a sensor at the samples of a run, shape (columns, samples); errors as in `signal_of`."""
    return _shown(sensor, scene, run.t, signal_of(sensor, scene, run).T)


def _shown(sensor: Sensor, scene: Scene, t: Array, signal: Array) -> Array:
    instrument = Instrument(sensor, scene.run.spacing)
    instrument.signal.add(t, signal)
    return np.ascontiguousarray(instrument.readings(t).T)


def sensor_columns(scene: Scene, run: Samples) -> dict[str, Array]:
    """Reading columns of all sensors, by name; errors as in `signal_of`."""
    found = [column for sensor in scene.sensor for column in readings_of(sensor, scene, run)] if len(run.t) else []
    found = found or [np.empty(0)] * len(column_names(scene.sensor, scene.arm))
    return dict(zip(column_names(scene.sensor, scene.arm), found, strict=True))


def coarse_samples(scene: Scene, run: Samples) -> Iterator[Diagnostic]:
    """Warn about sensors whose signal is not resolved by its linear interpolation between the samples of a run.

    The interpolation error is estimated by leaving out every other sample, which makes it up to four times as large.
    Errors as in `signal_of`.
    """
    # fewer samples do not allow an estimate
    for sensor in scene.sensor if len(run.t) > 8 else ():
        if Instrument(sensor, scene.run.spacing).known_at_samples:
            continue
        plain = sensor.ideal
        signal = signal_of(sensor, scene, run).T
        fine, coarse = _shown(plain, scene, run.t, signal), _shown(plain, scene, run.t[::2], signal[::2])
        off, size = np.abs(fine[:, ::2] - coarse).max(), np.ptp(fine)
        # largest error that is not reported, relative to the range of a column
        if off > 0.01 * size:
            yield Diagnostic(
                f"sensor.{sensor.name}: its signal is interpolated linearly between samples {scene.run.spacing:g} s "
                f"apart; with half of them its readings change by {off / size:.1%} of their range; reduce run.sample",
                "coarse-samples",
            )
