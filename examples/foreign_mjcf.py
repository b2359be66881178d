"""Their file gives other numbers: who is wrong?
=============================================

A colleague has rebuilt the arm for MuJoCo, and it falls differently. ``fl.compare`` reads the file with MuJoCo,
compares what MuJoCo has read, and names the mistake. (The file is ours here, with two mistakes planted in it.)
"""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

links = tuple(
    fl.Link(
        name=name,
        length=1.0,
        material="aluminium",
        section="tube",
        flex="z",
        segments=3,
    )
    for name in ("upper", "fore")
)
arm = fl.Arm(
    links=links,
    materials={"aluminium": fl.Material(young=70e9, density=2700.0)},
    sections={"tube": fl.Section(shape="tube", outer=0.04, inner=0.036)},
    tip=fl.RigidBody(mass=2.0, inertia=(4e-3, 4e-3, 4e-3)),
)
scene = fl.Scene(
    name="ours",
    arm=arm,
    gravity=(0.0, -9.81, 0.0),
    initial=fl.InitialState(joint_deg=(20.0, -40.0)),
)

# %%
# Their file: the springs of the upper arm are in N m per degree, and gravity points along −Z, as is usual in MuJoCo.
theirs = fl.to_mjcf(fl.lump(scene))
theirs = re.sub(
    r'(name="upper\.\d\.z"[^>]*stiffness=")([^"]+)',
    lambda m: f"{m[1]}{float(m[2]) * np.pi / 180!r}",
    theirs,
)
theirs = theirs.replace('gravity="0.0 -9.81 0.0"', 'gravity="0.0 0.0 -9.81"')
with TemporaryDirectory() as folder:
    path = Path(folder) / "theirs.xml"
    path.write_text(theirs, encoding="utf-8")
    found = fl.compare(scene, file=path)
print(found.diagnosis)

# %%
# How far each term is off, as a multiple of what rounding may explain: all that depend on springs and gravity.
rows = [row for row in found.rows if row.error > 0]
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
panel.barh(
    [row.quantity for row in rows],
    [row.error for row in rows],
    color=["C0" if r.passed else "C1" for r in rows],
)
panel.axvline(1.0, color="0.4", linestyle=":")
panel.set(xlabel="difference / rounding bound [1]; equal left of 1", xscale="log")
panel.invert_yaxis()
