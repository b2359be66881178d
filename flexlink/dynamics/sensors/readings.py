"""Sensor readings during a simulation, for control laws and for arms that are stepped by the caller."""

from __future__ import annotations

from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.sensors.instrument import Instrument
from flexlink.dynamics.sensors.signals import Samples, signal_of


class Readings:
    """Instruments of a scene's sensors, with their signals up to the present time."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.names = scene, column_names(scene.sensor, scene.arm)
        self._instruments = [Instrument(sensor, scene.run.spacing) for sensor in scene.sensor]

    def after(self, seen: Samples) -> dict[str, float]:
        """Add one sample, return the readings by column name; samples previously added at later times are discarded.

        Raises
        ------
        SceneError, SingularMassError
            As in `signal_of`.
        """
        shown: list[float] = []
        for instrument in self._instruments:
            instrument.signal.add(seen.t, signal_of(instrument.sensor, self._scene, seen).T)
            shown += instrument.readings(seen.t)[0].tolist()
        return dict(zip(self.names, shown, strict=True))
