"""A crane driven into its stop
============================

Seen from above, a jib of 20 m slews at 8 °/s, with its brake released, into a buffer. How large does its bending moment
become, and how soft must the buffer be? A ``stop`` is a tie that keeps a joint within its limits.
"""

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

LENGTH, LOAD, RATE = 20.0, 500.0, 8.0  # m, kg, °/s
steel = fl.Material(young=210e9, density=7850.0)  # Pa, kg/m³
box = fl.Section(shape="box", height=0.5, width=0.5, wall=0.008)  # m
jib = fl.Link(
    name="jib",
    length=LENGTH,
    flex="z",  # sideways
    segments=5,
    material="steel",
    section="box",
    damping=fl.Damping(ratio=0.01, at_hz=1.0),
    joint=fl.Joint(limits_deg=(-180.0, 0.0)),
)
scene = fl.Scene(
    name="slewing crane",
    arm=fl.Arm(
        links=(jib,),
        materials={"steel": steel},
        sections={"box": box},
        tip=fl.RigidBody(mass=LOAD),
    ),
    gravity=(0.0, 0.0, 0.0),  # the weight bends the jib vertically: not shown here
    initial=fl.InitialState(joint_deg=(-6.0,), rate_deg=(RATE,)),
    tie=(fl.details.Tie(name="buffer", kind="stop", link="jib", stiffness=1e7),),  # N m/rad
    run=fl.RunSettings(tolerance=1e-3, duration=2.5, sample=0.02, outputs=("loads",)),
)
run = fl.simulate(scene)
touches = run.tie_forces["buffer"] > 0
print(f"in the buffer for {0.02 * touches.sum():.1f} s, from t = {run.t[touches][0]:.2f} s on")
print(f"bending moment up to {1e-3 * np.abs(run.loads.M_z).max():.0f} kN m")

# %%
# Deflections are magnified; colours are bending moments.
run.animate("slewing_stop.gif", magnify=10, fps=12.5, width=480)

# %%
# A rigid jib of inertia I turns the buffer's torque up to √(k I) times its rate. A jib that bends is a spring itself:
# beyond some stiffness of the buffer, the moment hardly grows.
rigid = {"link.jib.flex": "rigid", "link.jib.segments": 1, "link.jib.damping": None}
inertia = (steel.density * (0.5**2 - 0.484**2) * LENGTH / 3 + LOAD) * LENGTH**2  # kg m²
stiffness = np.array([1e6, 1e7, 1e8, 1e9])  # N m/rad
peak = {"jib bends": [], "jib rigid": []}
for name, changes in zip(peak, ({}, rigid), strict=True):
    for k in stiffness:
        changes |= {"tie.buffer.stiffness": k, "run.sample": 5e-3}
        peak[name].append(fl.simulate(scene.varied(changes)).tie_forces["buffer"].max())
closed = np.sqrt(stiffness * inertia) * np.radians(RATE)
fig, panel = plt.subplots(figsize=(5, 3.4), layout="constrained")
for name, most in peak.items():
    panel.loglog(stiffness, 1e-3 * np.array(most), "o-", label=name)
panel.loglog(stiffness, 1e-3 * closed, "k:", label="√(k I) · rate")
panel.set(xlabel="stiffness of the buffer [N m/rad]", ylabel="largest moment [kN m]")
panel.legend(frameon=False)
panel.grid(alpha=0.3)
