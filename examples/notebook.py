"""In a notebook
=============

Every object says what it is as the last line of a cell: scenes, chains, modes, runs and advice as tables, plots as
pictures. Download this page as a notebook and change its numbers.
"""

import flexlink as fl

steel = fl.Material(young=206e9, density=7850.0, loss_time=1e-3)  # Pa, kg/m³, s
strip = {"material": "steel", "section": "strip", "flex": "z", "segments": 5}
upper = fl.Link(name="upper", length=0.8, **strip)  # m
fore = fl.Link(name="fore", length=0.6, **strip)
arm = fl.Arm(
    links=(upper, fore),
    materials={"steel": steel},
    sections={"strip": fl.Section(shape="rectangle", height=0.004, width=0.03)},
    tip=fl.RigidBody(mass=0.2),  # kg
)
start = fl.InitialState(joint_deg=(60.0, -30.0))
run_for = fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=1.0, sample=0.005)
down = (0.0, -9.81, 0.0)  # m/s²; Y is up
scene = fl.Scene(name="strips", arm=arm, gravity=down, initial=start, run=run_for)
scene.plot()

# %%
# A scene never changes; another one comes of it by ``varied``, with paths in the words of the scene's file.
scene.varied({"link.*.segments": 7, "tip.mass": 0.3})

# %%
# The chain that it is cut into: joints, springs, dampers.
chain = fl.lump(scene)
fl.lump(scene)

# %%
# Modes about the posture in which it sags, joints held, as a table …
rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active)
fl.modes(chain, rest.q, locked=chain.active)

# %%
# … and as pictures.
modes = fl.modes(chain, rest.q, locked=chain.active)
modes.plot(chain, count=4)

# %%
# A run, as a table of all that is sampled …
fl.simulate(scene)

# %%
# … and drawn.
run = fl.simulate(scene)
run.plot()

# %%
# What is good enough for the tip to be right within a centimetre.
fl.advise(scene, tip="10 mm")
