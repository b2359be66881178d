"""A sweep, evaluated with pandas
==============================

Largest deflection of an arm for each payload and wall thickness of its tube: a table of thirty runs, one per row.
Runs of similar arms are computed eight at a time.
"""

import matplotlib.pyplot as plt

import flexlink as fl

link = fl.Link(name="arm", length=2.0, material="aluminium", section="tube", flex="z", segments=5)
scene = fl.Scene(
    name="swing",
    arm=fl.Arm(
        links=(link,),
        materials={"aluminium": fl.Material(young=70e9, density=2700.0)},
        sections={"tube": fl.Section(shape="tube", outer=0.06, inner=0.05)},
        tip=fl.RigidBody(mass=1.0),
    ),
    gravity=(0.0, -9.81, 0.0),  # m/s²
    initial=fl.InitialState(joint_deg=(0.0,), passive="static"),
    drive=fl.Drive(
        kind="pd",
        kp=(2e4,),  # N m/rad
        kd=(2e3,),  # N m s/rad
        gravity="static",
        reference=fl.Reference(profile="quintic", to_deg=(60.0,), duration=0.8),
    ),
    run=fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=1.5, sample=0.005),
)

# %%
# Keys are paths, as in ``Scene.varied`` and ``--set``; outputs are columns of a run, reduced to a number. With
# ``out="swing.db"`` rows are saved as they are completed, and an interrupted sweep continues.
plan = fl.Sweep(
    scene=scene,
    grid={
        "tip.mass": {"between": [0.0, 10.0], "count": 6},  # kg
        "section.tube.inner": [0.044, 0.048, 0.052, 0.055, 0.057],  # m
    },
    quantity={
        "bend [m]": {"of": "deflection [m]", "take": "max"},
        "torque [N m]": {"of": "tau arm [N m]", "take": "largest"},
    },
)
rows = fl.sweep(plan)
table = rows.to_pandas()
table.head()

# %%
# Evaluation with pandas: deflection in mm by payload and wall thickness.
table["wall [mm]"] = (500 * (0.06 - table["section.tube.inner"])).round(1)
bend = 1e3 * table.pivot_table(index="tip.mass", columns="wall [mm]", values="bend [m]")
print(bend.round(1))

# %%
fig, panel = plt.subplots(figsize=(5, 3.5), layout="constrained")
bend.plot(ax=panel, marker="o", markersize=3)
panel.set(xlabel="payload [kg]", ylabel="largest deflection of the tip [mm]")
panel.grid(alpha=0.3)
