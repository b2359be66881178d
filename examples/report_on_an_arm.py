"""A report on an arm
==================

``fl.report`` checks one arm and writes a self-contained page: agreement with other engines, tip error by number of
hinges and by steps, static deflection, vibration and settling, and internal loads.
"""

import matplotlib.pyplot as plt

import flexlink as fl

link = fl.Link(
    name="arm",
    length=2.0,
    material="steel",
    section="box",
    flex="z",
    segments=5,
    damping=fl.Damping(ratio=0.01, at_hz=6.0),
    joint=fl.Joint(armature=5.0),
)
scene = fl.Scene(
    name="lifter",
    about="Two metres of steel box that lift 40 kg by 50° in a second and a half",
    arm=fl.Arm(
        links=(link,),
        materials={"steel": fl.Material(young=210e9, density=7850.0)},  # Pa, kg/m³
        sections={"box": fl.Section(shape="box", height=0.06, width=0.06, wall=0.003)},  # m
        tip=fl.RigidBody(mass=40.0, inertia=(0.5, 0.5, 0.5)),  # kg, kg m²
    ),
    gravity=(0.0, -9.81, 0.0),
    initial=fl.InitialState(joint_deg=(-10.0,), passive="static"),
    drive=fl.Drive(
        kind="pd",
        kp=(6e4,),  # N m/rad
        kd=(6e3,),  # N m s/rad
        gravity="static",
        reference=fl.Reference(profile="quintic", to_deg=(40.0,), duration=1.5),
    ),
    run=fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=2.5, sample=0.01),
)
written = fl.report(scene, "lifter_report")
print(written.page)
for verdict in written.verdicts:
    print(f"{verdict.about}: {verdict.word}. {verdict.text}")

# %%
# The main results are also available separately: the run, its loads, its settling time.
run = fl.simulate(
    scene.varied({"run.outputs": ["loads"]})
)  # follows vibrations, which loads contain
root = run.loads.M_z[:, run.chain.body("arm")]
goal = run.tip[-1]
settled = run.settling_time(target=goal, tolerance=1e-3)
print(f"settles within 1 mm of its final position {settled:.2f} s after the start")

# %%
fig, (upper, lower) = plt.subplots(2, 1, figsize=(5, 4.6), sharex=True, layout="constrained")
upper.plot(run.t, run.tip[:, 1])
upper.set(ylabel="height of the load [m]")
lower.plot(run.t, root)
lower.set(xlabel="time [s]", ylabel="bending moment\nat the root [N m]")
for panel in (upper, lower):
    panel.grid(alpha=0.3)
