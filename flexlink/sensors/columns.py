"""The columns of the sensors of a scene, of a run."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor
from flexlink.sensors.instrument import Instrument
from flexlink.sensors.signals import States, column_names, signal_of


class Samples(States, Protocol):
    """States with their times."""

    @property
    def t(self) -> Array:
        """Times (samples,) [s]."""


def readings_of(sensor: Sensor, scene: Scene, run: Samples, every: int = 1) -> Array:
    """What a sensor shows in the samples of a run, shape (columns, samples), of which `every` so many is looked at.

    Errors as in `signal_of`.
    """
    instrument = Instrument(sensor, scene.run.spacing)
    instrument.signal.add(run.t[::every], signal_of(sensor, scene, run).T[::every])
    return np.ascontiguousarray(instrument.readings(run.t[::every]).T)


def sensor_columns(scene: Scene, run: Samples) -> dict[str, Array]:
    """Columns of all sensors by their names; errors as in `signal_of`."""
    found = [column for sensor in scene.sensor for column in readings_of(sensor, scene, run)] if len(run.t) else []
    found = found or [np.empty(0)] * len(column_names(scene))
    return dict(zip(column_names(scene), found, strict=True))
