"""Pictures of trajectories and modes; the only module of the library that imports matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flexlink.modal import Modes
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


def plot_modes(found: Modes, name: str, count: int = 8) -> Figure:
    """Mode shapes as displaced arms, one panel a mode, seen along the axis of frame 0 in which the arm moves least."""
    shown = min(count, len(found.eigenvalues))
    paths = found.paths[:shown].real
    spread = np.ptp(found.points, axis=0) + np.abs(paths).max(axis=(0, 1))
    across, up = sorted(np.argsort(spread)[1:])
    reach = np.ptp(found.points, axis=0).max() or 1.0
    rows = -(-shown // 2)
    figure = Figure(figsize=(7.2, 3.0 * rows + 0.6), layout="constrained")
    figure.suptitle(f"{name}: mode shapes, amplitude not to scale")
    panels = np.atleast_1d(figure.subplots(rows, 2, sharex=True, sharey=True)).ravel()
    for k, panel in enumerate(panels):
        panel.set_visible(k < shown)
        if k < shown:
            largest = np.abs(paths[k]).max() or 1.0
            bent = found.points + 0.25 * reach / largest * paths[k]
            panel.plot(*found.points[:, [across, up]].T, color="0.7", linewidth=1.0, label="posture")
            panel.plot(*bent[:, [across, up]].T, marker=".", markersize=4, label=f"mode {k + 1}")
            panel.set_title(f"{k + 1}: {found.hertz[k]:.4g} Hz", fontsize="medium")
            panel.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]")
            panel.set_aspect("equal")
            panel.grid(alpha=0.3)
    return figure


def _lines(panel: Axes, run: Trajectory, joints: list[int], label: str) -> None:
    for place, k in enumerate(joints):
        name = run.chain.joint_name(k) if place < LEGEND_ENTRIES else None
        panel.plot(run.t, np.degrees(run.q[:, k]), label=name, linewidth=1.0)
    if len(joints) > LEGEND_ENTRIES:
        label += f"\n(first {LEGEND_ENTRIES} of {len(joints)} named)"
    panel.set_ylabel(label)
