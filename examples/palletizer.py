"""A palletizer with parallelograms
================================

Two rods, each parallel to a link, keep a palletizer's hand level, without a motor at the wrist. Also if the links bend?
A ``distance`` tie is a rod; with ``stiffness`` it is elastic.
"""

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

bends = {"flex": "z", "segments": 5, "material": "steel"}
bends["damping"] = fl.Damping(ratio=0.02, at_hz=8.0)
upper = fl.Link(name="upper", length=1.2, section="upper", **bends)  # m
plate = fl.Link(name="plate", on="upper", hub=fl.RigidBody(mass=5.0, inertia=(0.1, 0.1, 0.1)))
fore = fl.Link(name="fore", on="upper", length=1.3, section="fore", **bends)
hand = fl.Link(name="hand", on="fore", line=((0.0, 0.0, 0.0), (0.1, -0.4, 0.0)))
rear, top = (-0.25, 0.0, 0.0), (0.0, 0.25, 0.0)  # m, from joints to ends of rods
rod = {"kind": "distance", "point": rear, "to": {"point": rear}, "length": 1.2}
rear_rod = fl.details.Tie(name="rear rod", link="plate", **rod)
rod |= {"point": top, "to": {"link": "plate", "point": top}, "length": 1.3}
top_rod = fl.details.Tie(name="top rod", link="hand", **rod)
reference = fl.Reference(profile="quintic", to_deg=(60.0, -60.0, -90.0, 30.0), duration=1.2)
gains = {"kp": (4e6, 0.0, 4e6, 0.0), "kd": (1e5, 0.0, 1e5, 0.0)}  # N m/rad, N m s/rad
scene = fl.Scene(
    name="palletizer",
    arm=fl.Arm(
        links=(upper, plate, fore, hand),
        materials={"steel": fl.Material(young=210e9, density=7850.0)},  # Pa, kg/m³
        sections={
            "upper": fl.Section(shape="box", height=0.1, width=0.1, wall=0.004),  # m
            "fore": fl.Section(shape="box", height=0.08, width=0.08, wall=0.003),
        },
        tip=fl.RigidBody(mass=60.0, inertia=(1.0, 1.0, 1.0)),  # kg, kg m²
    ),
    gravity=(0.0, -9.81, 0.0),  # m/s²; Y is up
    initial=fl.InitialState(joint_deg=(120.0, -120.0, -130.0, 10.0), passive="static"),
    tie=(rear_rod, top_rod),
    drive=fl.Drive(kind="pd", reference=reference, **gains),
    run=fl.RunSettings(tolerance=1e-4, duration=2.0, sample=0.01, outputs=("loads",)),
)
run = fl.simulate(scene)
run.animate("palletizer.gif", fps=12.5, speed=0.5, width=480)

# %%
# Tilt of the hand: with these rods, with rods and bearings of 20 MN/m, and with a stiff motor at the wrist instead. The
# motor sees joints, but no bending. Rods keep the hand level, because bending moves their ends sideways only.
wrist = {"drive.kp": (4e6, 0.0, 4e6, 1e6), "drive.kd": (1e5, 0.0, 1e5, 1e4)}
serial = scene.varied({"tie": ()}).varied({"link.plate.joint.locked": True, **wrist})
steel_rods = scene.varied({"tie.*.stiffness": 2e7, "tie.*.damping": 2e3})  # N/m, N s/m
scenes = {"wrist motor": serial, "elastic rods": steel_rods, "rigid rods": scene}
fig, panel = plt.subplots(figsize=(5, 3.2), layout="constrained")
tilt = {}
for name, each in scenes.items():
    done = fl.simulate(each)
    turned = [name != "plate" for name in done.chain.joint_names]
    tilt[name] = done.q[:, turned].sum(axis=1)
    panel.semilogy(done.t, 1e3 * np.abs(tilt[name]), label=name)
panel.set(xlabel="time [s]", ylabel="tilt of the hand [mrad]", ylim=(5e-4, 100))
panel.legend(frameon=False, ncols=2, loc="upper center")
panel.grid(alpha=0.3)
