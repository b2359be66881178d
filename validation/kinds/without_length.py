"""Two scenes in which nothing has a length, a cart on a spring and a driven wheel, against closed forms.

m ẍ = −k x − d ẋ        x = x₀ e^(−σt) (cos ωt + σ/ω sin ωt)
I ω̇ = τ − d ω          θ = τ/d (t − I/d (1 − e^(−dt/I)))
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from validation.case import Case, Measured


def run(case: Case, ways: tuple[dict[str, Any], ...]) -> Iterator[Measured]:
    """Yield the error of the coordinate, relative to its largest value, by integration settings; {} is the default."""
    for scene in case.load_scenes():
        exact = _exact(scene, np.asarray(scene.run.times))
        for way in ways:
            found = fl.simulate(scene.varied({f"run.{key}": value for key, value in way.items()}))
            error = float(np.abs(found.q[:, 0] - exact).max() / np.abs(exact).max())
            yield Measured("motion by default" if not way else "motion", error, scene.name, varied=way)


def _exact(scene: fl.Scene, t: Array) -> Array:
    """Closed-form coordinate, from the values in the scene's file."""
    (link,), drive = scene.arm.links, scene.drive
    if drive.torque is not None:
        (τ,), I, d = drive.torque, link.hub.inertia[2], link.joint.viscous
        return np.asarray(τ / d * (t - I / d * (1 - np.exp(-d * t / I))))
    assert drive.kp is not None and drive.kd is not None and scene.initial.joint_m is not None
    (k,), (d,), (x0,), m = drive.kp, drive.kd, scene.initial.joint_m, link.hub.mass
    σ = d / (2 * m)
    ω = np.sqrt(k / m - σ**2)
    return np.asarray(x0 * np.exp(-σ * t) * (np.cos(ω * t) + σ / ω * np.sin(ω * t)))
