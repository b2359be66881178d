"""Figure 5 of the paper: two falling links
========================================

The arm of *Dynamic Simulation of Nonrigid Link Manipulators*: a locked waist and two aluminium links of 1.25 m, each of
five segments joined by springs. They fall from rest, 10° from hanging vertically.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
scene = fl.load_scene(models / "paper_fig5.toml")
run = fl.simulate(scene)  # RK4 with the step of the scene, as in the paper
print(run, run.steps, sep="\n")

# %%
# The joints swing by ten degrees, each hinge by a thousandth of a degree, so the paper plots them separately.
chain = run.chain
fig, (joints, hinges, tip) = plt.subplots(3, 1, figsize=(5, 7), sharex=True, layout="constrained")
for k in chain.active:
    joints.plot(run.t, np.degrees(run.q[:, k]), label=chain.joint_name(k))
for k in chain.bending[::4]:  # the hinge at the root of each link, where it bends most
    hinges.plot(run.t, np.degrees(run.q[:, k]), linewidth=0.7, label=chain.joint_name(k))
tip.plot(run.t, run.tip[:, 0], label="x, forwards")
tip.plot(run.t, run.tip[:, 2], label="z, downwards")
for panel, label in (
    (joints, "driven joints [°]"),
    (hinges, "first hinges [°]"),
    (tip, "tip, frame 0 [m]"),
):
    panel.set_ylabel(label)
    panel.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)
    panel.grid(alpha=0.3)
tip.set_xlabel("time [s]")

# %%
# Without drives and friction the energy is constant. The energy error of the steps:
lost = np.abs(run.imbalance).max() / run.exchanged[-1]
print(f"{lost:.1e} of the {run.exchanged[-1]:.1f} J exchanged")
