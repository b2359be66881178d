"""Computed torque from the rigid model, sampled at 1 kHz: what it is worth on a rigid arm, and on one that bends."""

from pathlib import Path

import numpy as np

import flexlink as fl

bending = fl.load_scene(Path(__file__).with_name("three_links.toml")).varied({"run.duration": 2.0})
rigid = bending.varied({"link.*.segments": None, "link.*.flex": "rigid"})
model = fl.lump(rigid)
start, goal = np.radians([[0.0, 45.0, -60.0], [60.0, 30.0, -60.0]])
fast = 15.0  # [1/s], of the errors of a rigid arm: ë + 2 fast ė + fast² e = 0


def reference(t: float | np.ndarray) -> tuple[np.ndarray, ...]:
    """Angles [rad] of a quintic of 1 s, their rates and accelerations."""
    x = np.clip(t, 0.0, 1.0)
    shapes = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
    angle, rate, acceleration = (np.multiply.outer(shape, goal - start) for shape in shapes)
    return start + angle, rate, acceleration


def follow(scene: fl.Scene) -> tuple[float, np.ndarray]:
    """Largest error of a driven joint [rad]; how far the tip is from its place on a rigid arm [m], (samples,)."""
    own = fl.lump(scene).active

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        angle, rate, acceleration = reference(t)
        wanted = acceleration + 2 * fast * (rate - qd[own]) + fast**2 * (angle - q[own])
        return fl.inverse_dynamics(model, q[own], qd[own], wanted)

    run = fl.simulate(scene, control=law, rate=1000)
    angle = reference(run.t)[0]
    return np.abs(run.q[:, own] - angle).max(), np.linalg.norm(run.tip - fl.tip_position(model, angle), axis=1)


found = {"rigid": follow(rigid), "bending": follow(bending)}
for name, (error, away) in found.items():
    print(f"{name:7}: joints at most {np.degrees(error):.4f}° off, the tip {1e3 * away.max():.2f} mm")
