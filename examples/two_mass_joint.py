"""An elastic gear between motor and link
======================================

``joint.gear_stiffness`` adds a spring between the motor, with its ``armature``, and the link: a two-mass oscillator
with the frequency ω² = k (1/I_motor + 1/I_link).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
scene = fl.load_scene(models / "two_mass_joint.toml")
link, payload, chain = scene.arm.links[0], scene.arm.tip, fl.lump(scene)
motor, k, length = link.joint.armature, link.joint.gear_stiffness, link.length
inertia = payload.mass * length**2 + payload.inertia[2]
omega = np.sqrt(k * (1 / motor + 1 / inertia))  # the closed form [rad/s]
free = fl.natural_frequencies(chain, [0.0, 0.0]).max()
held = fl.natural_frequencies(chain, [0.0, 0.0], locked=["arm"]).max()
print(f"free motor: {free / 2 / np.pi:.6f} Hz, closed form {omega / 2 / np.pi:.6f} Hz")
print(
    f"motor held: {held / 2 / np.pi:.6f} Hz, closed form {np.sqrt(k / inertia) / 2 / np.pi:.6f} Hz"
)

# %%
# A run with the motor initially at zero and the gear twisted by 0.01 rad, compared with the closed form.
run = fl.simulate(scene, method="RK10", step=1e-3)
twist = scene.initial.q[1]
swing = twist * np.cos(omega * run.t)  # of the gear; the total angular momentum is zero
exact = np.column_stack([inertia / (motor + inertia) * (twist - swing), swing])
error = np.abs(run.q - exact).max()
print(f"run of {run.t[-1]:g} s: {error:.1e} rad from the closed form")

# %%
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
for column, name in enumerate(("motor", "gear, link − motor")):
    (line,) = panel.plot(run.t, 1e3 * run.q[:, column], label=name)
    panel.plot(run.t[::10], 1e3 * exact[::10, column], ".", color=line.get_color())
panel.plot([], [], ".", color="0.4", label="closed form")
panel.set(xlabel="time [s]", ylabel="angle [mrad]", xlim=(0, 0.2))
panel.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)
panel.grid(alpha=0.3)
