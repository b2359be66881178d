"""Measures of a response: overshoot, settling time, and residual vibration."""

from flexlink.results.settling import overshoot, residual_vibration, settling_time

__all__ = [
    "overshoot",
    "residual_vibration",
    "settling_time",
]
