"""A robot from its URDF, with two flexible links
==============================================

Import a URDF, or the paths to some of its links, and make links flexible by name. Each flexible link becomes a beam,
given by a measured first frequency or by its section. Mass, centre and inertia are those of the file. Replace
``reach_arm.urdf`` by your file; ``flexlink robots`` lists forty robots of the package example-robot-data.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

folder = Path("examples") if Path("examples").is_dir() else Path()  # in the checkout, or here
damping, tube = fl.Damping(ratio=0.01, at_hz=8.0), fl.Section(shape="tube", outer=0.07, inner=0.064)
motors = dict.fromkeys(("turn", "shoulder", "elbow"), 1.5)  # kg m², reflected rotor inertia
found = fl.import_urdf(
    folder / "reach_arm.urdf",
    flexible={
        "upper_arm": fl.FlexibleLink(frequency_hz=8.0, damping=damping),  # as measured
        "forearm": fl.FlexibleLink(section=tube),  # m; of aluminium
    },
    posture={"shoulder": 0.9, "elbow": -1.2},  # rad
    armature=motors | dict.fromkeys(("wrist_bend", "wrist_turn"), 0.1),
)
print(found)  # links that were merged, joints that were locked, and the beams

# %%
# The arm in its initial posture, and its first modes with the joints fixed.
scene = found.scene.varied({"initial.passive": "static"})
chain = fl.lump(scene)
start, _ = fl.initial_state(scene, chain)
fl.modes(chain, start, locked=chain.active).plot(chain, count=2)

# %%
# A move of the turntable in 1 s under joint PD with gravity compensation. Links have the names of the URDF.
there = (90.0, np.degrees(0.9), np.degrees(-1.2), 0.0, 0.0)
pd = fl.Drive(
    kind="pd",
    gravity="static",
    kp=(2e4, 2e4, 1e4, 1e3, 1e3, 0),  # N m/rad; the flange has no joint
    kd=(600, 600, 300, 20, 20, 0),
    reference=fl.Reference(profile="quintic", to_deg=(*there, 0.0), duration=1.0),
)
moved = scene.varied({"drive": pd, "run.relative_tolerance": 1e-4, "run.duration": 2.0})
run = fl.simulate(moved)
rigid = fl.simulate(moved.rigidified())
off = np.linalg.norm(run.tip - rigid.tip, axis=1)

# %%
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
panel.plot(run.t, 1e3 * off)
panel.set(xlabel="time [s]", ylabel="flange, distance from rigid robot [mm]")
panel.grid(alpha=0.3)
