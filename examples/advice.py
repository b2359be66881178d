"""How many segments? Ask for advice
=================================

Which links must bend, about which axes, with how many hinges and by which steps, so that the tip of *this* arm in
*this* motion is right within a millimetre? ``fl.advise`` tries, and says why.
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
# The scene that it found is ready to run, and to save.
small = fl.simulate(found.scene)
print(small.chain, small.steps, sep="\n")

# %%
# Was it right? ``converged_tip`` is what finer and finer models converge to, with the error of that estimate.
off = np.linalg.norm(small.tip - found.converged_tip.tip, axis=1)
rigid = fl.simulate(fl.rigidified(found.scene).varied({"drive": found.scene.drive}))
fig, panel = plt.subplots(figsize=(5, 3.5), layout="constrained")
panel.semilogy(small.t, 1e3 * off, label=f"advised, {small.chain.n} joints")
panel.semilogy(
    rigid.t,
    1e3 * np.linalg.norm(rigid.tip - found.converged_tip.tip, axis=1),
    label="all links rigid",
)
panel.axhline(1.0, color="0.4", linestyle=":", label="asked for: 1 mm")
panel.set(xlabel="time [s]", ylabel="tip, off the converged path [mm]", ylim=(1e-3, 1e3))
panel.legend()
panel.grid(alpha=0.3)
