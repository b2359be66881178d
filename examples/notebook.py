"""flexlink in a notebook
======================

As the last line of a cell, every object displays itself: scenes, chains, modes, runs and advice as tables, plots as
figures. Download this page as a notebook and change its numbers.
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
# A scene is immutable; ``varied`` returns a changed copy. Paths are those of the scene's file.
scene.varied({"link.*.segments": 7, "tip.mass": 0.3})

# %%
# The chain of rigid segments: joints, springs, dampers.
chain = fl.lump(scene)
fl.lump(scene)

# %%
# Modes about the static equilibrium with the joints fixed, as a table …
rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active)
fl.modes(chain, rest.q, locked=chain.active)

# %%
# … and as figures.
modes = fl.modes(chain, rest.q, locked=chain.active)
modes.plot(chain, count=4)

# %%
# A run as a table of all samples …
fl.simulate(scene)

# %%
# … and as a plot.
run = fl.simulate(scene)
run.plot()

# %%
# The cheapest model for a tip error below 1 cm.
fl.advise(scene, tip="10 mm")
