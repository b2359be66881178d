"""An elastic gear between a motor and a link, a two-mass oscillator: ω² = k (1/I_motor + 1/I_link)."""

import numpy as np

import flexlink as fl

k, motor, length, payload, twist = 8e3, 0.6, 0.5, 4.0, 0.01  # N m/rad, kg m² beyond the gear, m, kg, rad
link = fl.Link(name="arm", length=length, flex="rigid", joint=fl.Joint(armature=motor, gear_stiffness=k))
scene = fl.Scene(
    name="two_mass_joint",
    arm=fl.Arm(links=(link,), tip=fl.Payload(mass=payload)),
    initial=fl.Initial(joint_deg=(0.0,)),
    run=fl.Run(method="RK10", step=1e-3, sample=1e-3, duration=0.5),
)
chain = fl.lump(scene)
inertia = payload * length**2
omega = np.sqrt(k * (1 / motor + 1 / inertia))  # the closed form [rad/s]
free = fl.natural_frequencies(chain, [0.0, 0.0]).max()
held = fl.natural_frequencies(chain, [0.0, 0.0], locked=["arm"]).max()

run = fl.simulate(scene, q0=(0.0, twist))  # the motor at zero, its gear twisted
swing = twist * np.cos(omega * run.t)  # of the gear; the motor answers it so that nothing turns as a whole
exact = np.column_stack([inertia / (motor + inertia) * (twist - swing), swing])
error = np.abs(run.q - exact).max()

print(f"free motor: {free / 2 / np.pi:.6f} Hz, closed form {omega / 2 / np.pi:.6f} Hz")
print(f"motor held: {held / 2 / np.pi:.6f} Hz, closed form {np.sqrt(k / inertia) / 2 / np.pi:.6f} Hz")
print(f"run of {run.t[-1]:g} s: {error:.1e} rad from the closed form")
