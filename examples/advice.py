"""Advice on segments and steps
============================

Which links must be flexible, about which axes, with how many hinges and which time steps, for a tip error below 1 mm?
``fl.advise`` finds the cheapest model for one arm and one motion, and gives its reasons.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
scene = fl.load_scene(models / "ptp_move.toml").varied(
    {"run.duration": 2.0, "drive.reference.shaper": None}
)
found = fl.advise(scene, tip="1 mm")
print(found)

# %%
# The recommended scene can be run and saved.
small = fl.simulate(found.scene)
print(small.chain, small.steps, sep="\n")

# %%
# Check the advice: ``converged_tip`` extrapolates from finer and finer models, with an estimate of its error.
off = np.linalg.norm(small.tip - found.converged_tip.tip, axis=1)
rigid = fl.simulate(found.scene.rigidified())
fig, panel = plt.subplots(figsize=(5, 3.5), layout="constrained")
panel.semilogy(small.t, 1e3 * off, label=f"recommended, {small.chain.n} joints")
panel.semilogy(
    rigid.t,
    1e3 * np.linalg.norm(rigid.tip - found.converged_tip.tip, axis=1),
    label="all links rigid",
)
panel.axhline(1.0, color="0.4", linestyle=":", label="requested: 1 mm")
panel.set(xlabel="time [s]", ylabel="tip error [mm]", ylim=(1e-3, 1e3))
panel.legend()
panel.grid(alpha=0.3)
