"""Picture of a trajectory; the only module of the library that imports matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flexlink.trajectory import Trajectory

LEGEND_ENTRIES = 8  # more do not fit on a phone


def plot_trajectory(run: Trajectory) -> Figure:
    """Four panels against time: active joints, passive joints, tip, energy."""
    figure = Figure(figsize=(7.2, 9.6), layout="constrained")
    active, passive, tip, energy = figure.subplots(4, 1, sharex=True)
    figure.suptitle(run.chain.name)
    driven = set(run.chain.active.tolist())
    hinges = [k for k in range(run.chain.n) if k not in driven]
    _lines(active, run, sorted(driven), "active joints [deg]")
    _lines(passive, run, hinges, "passive joints [deg]")
    for column, axis in enumerate("xyz"):
        tip.plot(run.t, run.tip[:, column], label=axis)
    tip.set_ylabel("tip, frame 0 [m]")
    parts = run.energy._asdict() | {"total": run.energy.total}
    for name, values in parts.items():
        energy.plot(run.t, np.asarray(values), label=name, linestyle="--" if name == "total" else "-")
    energy.set(ylabel="energy [J]", xlabel="time [s]")
    for panel in (active, passive, tip, energy):
        panel.grid(alpha=0.3)
        if panel.lines:
            panel.legend(fontsize="small", ncols=2, loc="upper right")
    return figure


def _lines(panel: Axes, run: Trajectory, joints: list[int], label: str) -> None:
    for place, k in enumerate(joints):
        name = run.chain.joint_name(k) if place < LEGEND_ENTRIES else None
        panel.plot(run.t, np.degrees(run.q[:, k]), label=name, linewidth=1.0)
    if len(joints) > LEGEND_ENTRIES:
        label += f"\n(first {LEGEND_ENTRIES} of {len(joints)} named)"
    panel.set_ylabel(label)
