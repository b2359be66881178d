"""Measures of a response: how far it overshoots, how long it takes to settle, what vibration is left."""

from flexlink.results.settling import overshoot, residual_vibration, settling_time

__all__ = [
    "overshoot",
    "residual_vibration",
    "settling_time",
]
