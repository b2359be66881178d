"""Sensor readings as outputs of a linear model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor, column_names
from flexlink.dynamics.filters import linear_filter
from flexlink.dynamics.sensors.signals import joint_of, signal_of, slopes_of
from flexlink.dynamics.vibration.linear_model import Output


class SensorOutputs:
    """All or some sensors of a scene as outputs of `linearize`.

    Gains and biases are included, filters become states of the model, and delays are listed separately.
    Sampling, resolution, noise and the random walk of a bias, which are not linear, are left out.

    Parameters
    ----------
    scene
        The scene.
    names
        Names of sensors; default: all.

    Raises
    ------
    ArgumentError
        The scene has no sensors, or no sensor with such a name.

    Examples
    --------
    >>> gauge = fl.Sensor(name="gauge", kind="strain", link="upper", x=0.1, fibre=(0.025, 0.0), low_pass=50.0)  # Hz
    >>> model = fl.linearize(chain, q, outputs=(fl.small_motion.SensorOutputs(scene.varied({"sensor": (gauge,)})),))
    >>> model
    <LinearModel: 13 states, 2 inputs, 1 output>
    >>> print(model.outputs, model.states[-1])
    ('gauge [1]',) filter 1 gauge [1]
    """

    def __init__(self, scene: Scene, *names: str) -> None:
        self.scene, sensors = require_type("scene", scene, Scene), {sensor.name: sensor for sensor in scene.sensor}
        if not sensors:
            raise ArgumentError(f"scene = {scene!r}: has no [[sensor]]", id="no-sensors")
        for name in names:
            if name not in sensors:
                why = f"no such sensor; allowed are {', '.join(sensors)}{did_you_mean(name, sensors)}"
                raise ArgumentError(f"names = {truncated(name)}: {why}", id="unknown-sensor")
        self.sensors = tuple(sensors[name] for name in names or sensors)

    def __repr__(self) -> str:
        return f"<SensorOutputs: {', '.join(sensor.name for sensor in self.sensors)}>"

    def outputs(self, chain: Chain, q: Array, qd: Array, qdd: Array, tau: Array) -> list[Output]:
        """Outputs of the linear model about a state (n,).

        Raises
        ------
        ArgumentError
            A sensor measures the torque of a joint with prescribed motion, or is on a tie.
        SceneError
            As in `Trajectory.readings`.
        """
        return [self._output(sensor, chain, q, qd, qdd, tau) for sensor in self.sensors]

    def _output(self, sensor: Sensor, chain: Chain, q: Array, qd: Array, qdd: Array, tau: Array) -> Output:
        scene = self.scene
        if sensor.on_tie:
            text = f"sensor {sensor.name!r}: forces and pressures of ties are no outputs; leave the sensor out"
            raise ArgumentError(f"outputs: {text}", id="sensor-of-tie")
        if sensor.kind in {"torque", "current"} and chain.held[joint_of(sensor, chain, scene)]:
            why = "a linear model has the acceleration of this joint as input and no torque as output"
            text = f"sensor {sensor.name!r}: the motion of its joint is prescribed; {why}; leave the sensor out"
            raise ArgumentError(f"outputs: {text}", id="sensor-of-prescribed-joint")
        here = SimpleNamespace(chain=chain, t=np.zeros(1), q=q[None], qd=qd[None], qdd=qdd[None], tau=tau[None])
        slopes = slopes_of(sensor, scene, chain, q, qd, qdd)
        none = np.zeros_like(next(iter(slopes.values())))
        return Output(
            names=column_names([sensor], scene.arm), signal=np.asarray(signal_of(sensor, scene, here)[:, 0]),
            q=slopes.get("q", none), qd=slopes.get("qd", none), qdd=slopes.get("qdd"), tau=slopes.get("tau"),
            gain=sensor.gain, bias=sensor.bias,
            filter=linear_filter(sensor.filters), delay=sensor.delay,
        )  # fmt: skip
