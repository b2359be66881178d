"""Linearized dynamics beyond `modes` and `linearize`: about a steady motion, with sensors, or with a controller."""

from flexlink.dynamics.vibration.linear import pd_poles
from flexlink.dynamics.vibration.sensor_outputs import SensorOutputs
from flexlink.dynamics.vibration.steady import equilibrium_in_motion, modes_in_motion

__all__ = ["SensorOutputs", "equilibrium_in_motion", "modes_in_motion", "pd_poles"]
