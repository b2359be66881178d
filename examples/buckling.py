"""Buckling and post-buckling
==========================

A vertical strip of spring steel, clamped at its base, carries a load. ``fl.strength.buckling_loads`` computes the load
at which it buckles, Euler's load; ``fl.solve_static`` computes its shape beyond this load, Euler's elastica.
"""

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

LENGTH, WIDTH, HEIGHT, YOUNG = 0.5, 0.02, 0.001, 206e9  # m, m, m, Pa
euler = np.pi**2 * YOUNG * WIDTH * HEIGHT**3 / 12 / (4 * LENGTH**2)  # N, clamped below, free above


def strip(segments: int, load: float) -> fl.Scene:
    """Return a vertical strip along X without weight, under a load [N]."""
    link = fl.Link(
        name="strip",
        length=LENGTH,
        material="steel",
        section="flat",
        flex="z",
        segments=segments,
        joint=fl.Joint(locked=True),
    )
    arm = fl.Arm(
        links=(link,),
        materials={"steel": fl.Material(young=YOUNG, density=7850.0)},
        sections={"flat": fl.Section(shape="rectangle", height=HEIGHT, width=WIDTH)},
    )
    pressed = fl.Wrench(force=(-load, 0.0, 0.0))
    return fl.Scene(name="strip", arm=arm, gravity=(0.0, 0.0, 0.0), wrench=pressed)


# %%
# Buckling factors are multiples of the present load. This load is 1 N, so the first factor is the buckling load in N.
# Its error is inversely proportional to the square of the number of hinges.
factors = {}
for segments in (3, 5, 9, 17):
    scene = strip(segments, load=1.0)
    chain = fl.lump(scene)
    factors[segments - 1] = fl.strength.buckling_loads(
        chain, np.zeros(chain.n), tip_wrench=scene.tip_wrench
    )[0]
    found = factors[segments - 1]
    print(f"{segments - 1:2} hinges: {found:.6f} N, {found / euler - 1:+.1e}")
print(f"Euler    : {euler:.6f} N")

# %%
# Beyond the buckling load the straight strip is an unstable equilibrium. Starting slightly bent, the solver finds the
# stable one.
fig, panel = plt.subplots(figsize=(5, 3.8), layout="constrained")
shapes = {}
for part in (0.99, 1.015, 1.063, 1.152, 1.293):  # of Euler's load
    scene = strip(17, load=part * euler)
    chain = fl.lump(scene)
    shapes[part] = fl.solve_static(chain, np.full(chain.n, 0.05), tip_wrench=scene.tip_wrench)
    points = np.vstack([np.zeros(3), fl.frames(chain, shapes[part].q).points])
    tilt = np.degrees(shapes[part].q.sum())
    panel.plot(
        1e3 * points[:, 1],
        1e3 * points[:, 0],
        label=f"{part * euler:.2f} N: tip at {abs(tilt):.0f}°",
    )
panel.set(xlabel="sideways [mm]", ylabel="height [mm]", aspect="equal")
panel.legend(loc="upper left", bbox_to_anchor=(1.02, 1), frameon=False)
panel.grid(alpha=0.3)
