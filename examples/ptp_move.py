"""Input shaping: a move without residual vibration
================================================

A slender tube of 2 m with 8 kg at the tip turns by 60° in 1 s under joint PD. Without shaping, the load oscillates for
seconds. A shaper (ZV, ZVD) tuned to the poles of the arm takes 0.1 s longer and removes almost all of the vibration.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
scene = fl.load_scene(models / "ptp_move.toml")  # PD, shaped by ZVD
drive, move, chain = scene.drive, scene.drive.reference, fl.lump(scene)

# %%
# Poles for the shaper: the two slowest poles of the arm with its drives, at the end of the move. Both are first bending
# modes, one vertical and one lateral.
there = scene.varied({"initial.joint_deg": move.to_deg, "drive": fl.Drive()})
slack, _ = fl.initial_state(there, chain)
goal = fl.solve_static(chain, slack, locked=chain.active).q  # bent by gravity
slow = fl.small_motion.pd_poles(chain, goal, kp=drive.kp, kd=drive.kd)[:2]
shapers = {
    "unshaped": None,
    "ZV": fl.InputShaper.at(slow, "ZV"),
    "ZVD": fl.InputShaper.at(slow, "ZVD"),
}
print("shaped for", np.round(np.abs(slow) / (2 * np.pi), 4), "Hz")
print("in the scene's file", move.shaper.frequency_hz)

# %%
# The same move with three references, and the residual vibration after 2 s, when all of them have ended.
runs = {
    name: fl.simulate(scene.varied({"drive.reference.shaper": shaper}))
    for name, shaper in shapers.items()
}
left = {name: run.residual_vibration(after=2.0) for name, run in runs.items()}  # [m]
rest = fl.tip_position(chain, goal)
settled = {  # [s]
    name: run.settling_time(target=rest, tolerance=1e-3) for name, run in runs.items()
}
for name in runs:
    print(f"{name:8}: residual vibration {1e3 * left[name]:.3f} mm,", end=" ")
    print(f"within 1 mm after {settled[name]:.2f} s")

# %%
# Distance from the goal on a logarithmic scale.
fig, panel = plt.subplots(figsize=(5, 3.5), layout="constrained")
for name, run in runs.items():
    panel.semilogy(run.t, 1e3 * np.linalg.norm(run.tip - rest, axis=1), label=name, linewidth=1)
panel.axhline(1.0, color="0.5", linestyle=":", label="1 mm")
panel.set(xlabel="time [s]", ylabel="distance of tip from goal [mm]", xlim=(0, 4), ylim=(1e-2, 3e3))
panel.legend(ncols=2)
panel.grid(alpha=0.3)
