"""A crane with its cylinders
==========================

Two cylinders lift a crane with a load of 800 kg. They are ``distance`` ties of driven ``lengths`` and the ``stiffness``
of the oil. How large are their forces, and how much softer does the oil make the crane?
"""

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

bends = {"flex": "z", "segments": 5, "material": "steel"}
bends["damping"] = fl.Damping(ratio=0.01, at_hz=2.0)
boom = fl.Link(name="boom", length=6.0, section="boom", **bends)
jib = fl.Link(name="jib", length=5.0, section="jib", **bends)
oil = {"kind": "distance", "stiffness": 8e6, "damping": 4e4, "times": (0.0, 4.0)}  # N/m, N s/m, s
ends = {"point": (2.0, -0.15, 0.0), "to": {"point": (0.4, -1.2, 0.0)}}  # m, on boom and column
lift = fl.details.Tie(name="lift", link="boom", lengths=(2.32, 2.82), **ends, **oil)  # m
# Points of boom and of a lever of the jib, which the film does not show [m].
ends = {"point": (0.0, 0.6, 0.0), "to": {"link": "boom", "point": (3.5, 0.35, 0.0)}}
fold = fl.details.Tie(name="fold", link="jib", lengths=(3.02, 2.76), **ends, **oil)
scene = fl.Scene(
    name="loader crane",
    arm=fl.Arm(
        links=(boom, jib),
        materials={"steel": fl.Material(young=210e9, density=7850.0)},  # Pa, kg/m³
        sections={
            "boom": fl.Section(shape="box", height=0.3, width=0.2, wall=0.008),  # m
            "jib": fl.Section(shape="box", height=0.2, width=0.15, wall=0.006),
        },
        tip=fl.RigidBody(mass=800.0),  # kg
    ),
    gravity=(0.0, -9.81, 0.0),  # m/s²; Y is up
    initial=fl.InitialState(joint_deg=(20.0, -60.0), passive="static"),
    tie=(lift, fold),
    run=fl.RunSettings(tolerance=1e-3, duration=6.0, sample=0.02, outputs=("loads",)),
)
run = fl.simulate(scene)
run.animate("crane_cylinders.gif", fps=12.5, width=480)

# %%
# Forces of the cylinders, positive where they pull. ``passive="static"`` starts at rest.
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
for name, force in run.tie_forces.items():
    panel.plot(run.t, 1e-3 * force, label=name)
panel.set(xlabel="time [s]", ylabel="force of the cylinder [kN]")
panel.legend(frameon=False)
panel.grid(alpha=0.3)

# %%
# The first frequency on the way up: with rigid cylinders it would be twice as high. Dunkerley's rule,
# 1/f² = 1/f₁² + 1/f₂², combines the frequencies with rigid cylinders and with rigid links.
stiff = {f"tie.*.{key}": value for key, value in (("stiffness", None), ("damping", 0.0))}
rigid = {
    f"link.*.{key}": value for key, value in (("flex", "rigid"), ("segments", 1), ("damping", None))
}
chosen = np.flatnonzero(run.t <= 4.0)[::25]
first = {}
for name, changes in {
    "oil and links give": {},
    "rigid cylinders": stiff,
    "rigid links": rigid,
}.items():
    chain = fl.lump(scene.varied(changes).varied({"tie": ()}))
    moved = run.q if chain.n == run.chain.n else run.q[:, run.chain.active]
    at = [scene.varied({**changes, "initial.time": t}) for t in run.t[chosen]]  # lengths at t
    pairs = zip(moved[chosen], at, strict=True)
    first[name] = [fl.modes(chain, q, ties=ties).hertz[0] for q, ties in pairs]
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
for name, hertz in first.items():
    panel.plot(run.t[chosen], hertz, label=name)
dunkerley = sum(1 / np.square(first[name]) for name in ("rigid cylinders", "rigid links")) ** -0.5
panel.plot(run.t[chosen], dunkerley, "k.", label="Dunkerley")
panel.set(xlabel="time [s]", ylabel="first frequency [Hz]", ylim=(0, None))
panel.legend(frameon=False, ncols=2)
panel.grid(alpha=0.3)
