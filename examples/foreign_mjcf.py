"""Find the mistakes in a third-party MJCF file
============================================

A colleague has modelled the same arm for MuJoCo, and it falls differently. ``fl.compare`` loads the file in MuJoCo,
compares the loaded model with the scene, and names the mistakes. (Here the file is exported, with two mistakes added.)
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
# The third-party file: springs of the upper arm in N m per degree, and gravity along −Z, as usual in MuJoCo.
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
# The difference of each term as a multiple of the rounding bound: all terms with springs or gravity differ.
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
