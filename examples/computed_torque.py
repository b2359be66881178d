"""Computed torque from the rigid model
====================================

How well does a controller, whose model has the right masses but rigid links, control an arm that bends? It is sampled
at 1 kHz, and is applied to a rigid arm and to a slender tube with 8 kg at the tip.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
bending = fl.load_scene(models / "computed_torque.toml")
rigid = bending.rigidified()
model, reference = fl.lump(rigid), bending.course


def follow(scene: fl.Scene) -> tuple[float, np.ndarray]:
    """Largest error of a driven joint [rad], and distance of the tip from that of a rigid arm [m], (samples,)."""
    run = fl.simulate(scene)
    angle, _, _ = reference(run.t)
    error = np.abs(run.q[:, run.chain.active] - angle).max()
    return error, np.linalg.norm(run.tip - fl.tip_position(model, angle), axis=1)


# %%
# The joints follow the reference. The tip does not: it sags, and oscillates after the end of the move at 1 s.
found = {"rigid": follow(rigid), "bending": follow(bending)}
for name, (error, away) in found.items():
    print(
        f"{name:7}: joints at most {np.degrees(error):.4f}° off, the tip {1e3 * away.max():.2f} mm"
    )

# %%
fig, panel = plt.subplots(figsize=(5, 3.2), layout="constrained")
for (name, (_, away)), style in zip(found.items(), ("--", "-"), strict=True):
    panel.plot(
        np.linspace(0, bending.run.duration, len(away)),
        1e3 * away,
        style,
        label=f"{name} arm",
    )
panel.set(xlabel="time [s]", ylabel="tip error [mm]")
panel.legend()
panel.grid(alpha=0.3)
