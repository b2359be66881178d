"""Computed torque from the rigid model, sampled at 1 kHz: what it is worth on a rigid arm, and on one that bends."""

from pathlib import Path

import numpy as np

import flexlink as fl

bending = fl.load_scene(Path(__file__).parents[1] / "models" / "computed_torque.toml")
twin = fl.rigidified(bending)
rigid, model, reference = twin.varied({"drive": bending.drive}), fl.lump(twin), bending.course


def follow(scene: fl.Scene) -> tuple[float, np.ndarray]:
    """Largest error of a driven joint [rad]; how far the tip is from its place on a rigid arm [m], (samples,)."""
    run = fl.simulate(scene)
    angle, _, _ = reference(run.t)
    error = np.abs(run.q[:, run.chain.active] - angle).max()
    return error, np.linalg.norm(run.tip - fl.tip_position(model, angle), axis=1)


found = {"rigid": follow(rigid), "bending": follow(bending)}
for name, (error, away) in found.items():
    print(f"{name:7}: joints at most {np.degrees(error):.4f}° off, the tip {1e3 * away.max():.2f} mm")
