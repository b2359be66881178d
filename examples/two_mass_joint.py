"""An elastic gear between a motor and a link, a two-mass oscillator: ω² = k (1/I_motor + 1/I_link)."""

from pathlib import Path

import numpy as np

import flexlink as fl

scene = fl.load_scene(Path(__file__).parents[1] / "models" / "two_mass_joint.toml")
link, payload, chain = scene.arm.links[0], scene.arm.tip, fl.lump(scene)
motor, k, length = link.joint.armature, link.joint.gear_stiffness, link.length
inertia = payload.mass * length**2 + payload.inertia[2]
omega = np.sqrt(k * (1 / motor + 1 / inertia))  # the closed form [rad/s]
free = fl.natural_frequencies(chain, [0.0, 0.0]).max()
held = fl.natural_frequencies(chain, [0.0, 0.0], locked=["arm"]).max()

run = fl.simulate(scene, method="RK10", step=1e-3)  # from the motor at zero, its gear twisted
twist = scene.initial.q[1]
swing = twist * np.cos(omega * run.t)  # of the gear; the motor answers it so that nothing turns as a whole
exact = np.column_stack([inertia / (motor + inertia) * (twist - swing), swing])
error = np.abs(run.q - exact).max()

print(f"free motor: {free / 2 / np.pi:.6f} Hz, closed form {omega / 2 / np.pi:.6f} Hz")
print(f"motor held: {held / 2 / np.pi:.6f} Hz, closed form {np.sqrt(k / inertia) / 2 / np.pi:.6f} Hz")
print(f"run of {run.t[-1]:g} s: {error:.1e} rad from the closed form")
