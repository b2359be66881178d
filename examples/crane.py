"""A crane, from the scene to a film
=================================

A tapered steel boom of 10 m, a jib of 6 m, and a load of 500 kg. The arm is described in Python, moved by its drives
along an S-curve, and filmed with bending moments shown as colours.
"""

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

steel = fl.Material(young=210e9, density=7850.0)  # Pa, kg/m³
damping = fl.Damping(ratio=0.01, at_hz=2.0)  # welded steel: about 1 % of critical
bends = {"flex": "z", "segments": 5, "material": "steel", "damping": damping}
boom = fl.Link(name="boom", length=10.0, section="root", section_tip="middle", **bends)
jib = fl.Link(name="jib", length=6.0, section="middle", section_tip="end", **bends)
arm = fl.Arm(
    links=(boom, jib),
    materials={"steel": steel},
    sections={  # m; a tapered link goes from one section to another of the same shape
        "root": fl.Section(shape="tube", outer=0.36, inner=0.34),
        "middle": fl.Section(shape="tube", outer=0.24, inner=0.22),
        "end": fl.Section(shape="tube", outer=0.14, inner=0.12),
    },
    tip=fl.RigidBody(mass=500.0),  # kg
)
start = fl.InitialState(joint_deg=(30.0, -20.0), passive="static")  # sagged
luff = fl.Reference(
    profile="s_curve",
    to_deg=(60.0, -55.0),
    max_rate_deg=(12.0, 12.0),
    max_jerk_deg=(40.0, 40.0),
)
gains = {"kp": (8e6, 3e6), "kd": (8e5, 2e5)}  # N m/rad, N m s/rad
drive = fl.Drive(kind="pd", gravity="static", reference=luff, **gains)
run_for = fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=6.0, sample=0.02)
down = (0.0, -9.81, 0.0)  # m/s²; Y is up
scene = fl.Scene(name="crane", arm=arm, gravity=down, initial=start, drive=drive, run=run_for)
scene.plot()

# %%
# Static deflection, and first frequency with braked drives.
chain = fl.lump(scene)
bent, _ = fl.initial_state(scene, chain)
straight = np.where(np.isin(range(chain.n), chain.active), bent, 0.0)
sag = fl.tip_position(chain, straight)[1] - fl.tip_position(chain, bent)[1]
swing = fl.modes(chain, bent, locked=["boom", "jib"]).hertz[0]
torque = fl.gravity_torque(chain, bent)[0]
print(f"deflection {1e3 * sag:.0f} mm, first frequency {swing:.2f} Hz")
print(f"{1e-3 * torque:.0f} kN m at the boom's joint")

# %%
# The move. Frames are drawn from the samples of the run; ``speed=2`` shows two seconds in one.
run = fl.simulate(
    scene.varied({"run.outputs": ["loads"]})
)  # follows vibrations, which loads contain
run.animate("crane.gif", fps=12, speed=2, width=480)

# %%
# Deflection of the load by bending of boom and jib, and the residual vibration at the end.
driven = np.zeros_like(run.q)
driven[:, chain.active] = run.q[:, chain.active]
off = np.linalg.norm(run.tip - fl.tip_position(chain, driven), axis=1)
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
panel.plot(run.t, 1e3 * off)
panel.set(xlabel="time [s]", ylabel="deflection of the load [mm]")
panel.grid(alpha=0.3)
