"""Plots of trajectories and modes; this module needs matplotlib, so it is imported only for plotting."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.branches import as_lines
from flexlink.common.types import Array
from flexlink.describe.joint_units import in_joint_units
from flexlink.pages.colours import BLUE, CYCLE, GREEN, GREY, INK, VERMILION
from flexlink.results.notebook_figure import NotebookFigure as Figure
from flexlink.results.notebook_figure import literal
from flexlink.results.pictures.view import view_of_motion
from flexlink.results.resolved_modes import resolved

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flexlink.chain.chain import Chain
    from flexlink.dynamics.vibration.modal import Modes
    from flexlink.results.samples import RunSamples


@literal
def plot_trajectory(run: RunSamples) -> Figure:
    """Plot all `panels` of a run against time, each with its legend to the right."""
    # each curve of a legend has a different colour
    colours = (*CYCLE, GREY, INK)
    panel_height = 1.9  # [in]
    shown = list(panels(run))
    figure = Figure(figsize=(8.4, panel_height * len(shown) + 0.7), layout="constrained")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False).ravel()
    figure.suptitle(run.chain.name)
    for draw, panel in zip(shown, axes, strict=True):
        panel.set_prop_cycle(color=colours)
        draw(panel)
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    axes[-1].set_xlabel("time [s]")
    return figure


def panels(run: RunSamples) -> Iterator[Callable[[Axes], None]]:
    """Functions that draw the panels of a run, from top to bottom."""
    of_joints = (
        (_driven(run, slides=False), "active joints [deg]"),
        (_driven(run, slides=True), "sliding joints [m]"),
        (_hinges(run, slides=False), "passive joints [deg]"),
        (_hinges(run, slides=True), "springs of\nsliding joints [m]"),
    )
    yield from (partial(_coordinates, run=run, joints=joints, label=label) for joints, label in of_joints if joints)
    there = {
        base: run.chain.has_free_base, tip: True, exchanged_energy: True,
        elastic_energy: bool(run.chain.stiffness.any()), imbalance: run.work is not None,
    }  # fmt: skip
    yield from (partial(draw, run=run) for draw, shown in there.items() if shown)
    of_drives = ((False, "drive torques\n[N m]"), (True, "drive forces\n[N]"))
    for slides, label in of_drives:
        joints = _driven(run, slides=slides)
        if run.tau[:, joints].any():
            yield partial(_curves, run=run, joints=joints, values=run.tau[:, joints], label=label)


def base(panel: Axes, run: RunSamples) -> None:
    """Plot the position of a free base."""
    for k, axis in enumerate("xyz"):
        panel.plot(run.t, run.q[:, k], label=axis)
    panel.set_ylabel("base, frame 0 [m]")


def tip(panel: Axes, run: RunSamples) -> None:
    """Plot the position of the tip."""
    for column, axis in enumerate("xyz"):
        panel.plot(run.t, run.tip[:, column], label=axis)
    panel.set_ylabel("tip, frame 0 [m]")


def exchanged_energy(panel: Axes, run: RunSamples) -> None:
    """Plot changes of kinetic, gravity and total energy since the start, as the zero of gravity energy is arbitrary."""
    for name, values in (("kinetic", run.energy.kinetic), ("gravity", run.energy.gravity)):
        panel.plot(run.t, _since_start(values), label=name)
    panel.plot(run.t, _since_start(run.energy.total), label="total", color=INK, linestyle="--")
    panel.set_ylabel("energy since\nthe start [J]")


def elastic_energy(panel: Axes, run: RunSamples) -> None:
    """Plot the energy of the springs, which is often thousands of times smaller than the other energies."""
    panel.plot(run.t, np.asarray(run.energy.elastic), label="elastic", color=GREEN)
    panel.set_ylabel("elastic\nenergy [J]")


def imbalance(panel: Axes, run: RunSamples) -> None:
    """Plot the energy error of the discretisation."""
    panel.plot(run.t, run.imbalance, label="E − E(0) − W", color=VERMILION)
    panel.set_ylabel("power\nbalance [J]")
    panel.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3))


@literal
def plot_modes(found: Modes, chain: Chain, count: int = 8) -> Figure:
    """Plot mode shapes as displaced arms, one panel per mode, each in the view that shows its motion best."""
    shown = min(count, len(found.eigenvalues))
    reach = np.ptp(found.points, axis=0).max() or 1.0
    rows = -(-shown // 2)
    figure = Figure(figsize=(7.2, 3.0 * rows + 0.6), layout="constrained")
    fine = resolved(found, chain)
    note = "" if all(fine[:shown]) else "\ndashed: fewer than two hinges per half-wave"
    figure.suptitle(f"{chain.name}: mode shapes, amplitude not to scale{note}")
    panels = np.atleast_1d(figure.subplots(rows, 2, squeeze=False)).ravel()
    for panel in panels[shown:]:
        panel.set_visible(False)
    for k, panel in enumerate(panels[:shown]):
        path = found.paths[k].real
        bent = found.points + 0.12 * reach / (np.abs(path).max() or 1.0) * path
        view = view_of_motion(chain, found.points, bent)
        panel.plot(*view.flat(as_lines(chain, found.points, base=False)), color=GREY, linewidth=1.0, label="posture")
        colour, line, words = (BLUE, "-", "") if fine[k] else (VERMILION, "--", ", not resolved")
        panel.plot(
            *view.flat(as_lines(chain, bent, base=False)),
            line,
            color=colour,
            marker=".",
            markersize=4,
            label=f"mode {k + 1}",
        )
        frequency = f"{found.hertz[k]:.4g} Hz" if np.isfinite(found.hertz[k]) else "unstable, no frequency"
        panel.set_title(f"{k + 1}: {frequency}{words}", fontsize="medium")
        panel.set(xlabel=view.labels[0], ylabel=view.labels[1])
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(alpha=0.3)
    return figure


def _driven(run: RunSamples, *, slides: bool) -> list[int]:
    """Indices of the driven joints that turn or, if `slides`, that slide."""
    return [k for k in run.chain.active.tolist() if run.chain.slides[k] == slides]


def _hinges(run: RunSamples, *, slides: bool) -> list[int]:
    """Indices of the links' passive joints that turn or, if `slides`, that slide."""
    chain, internal = run.chain, run.chain.internal
    passive = (k for k, c in enumerate(chain.coordinates) if c.link and c.axis and k not in internal)
    return [k for k in passive if chain.slides[k] == slides]


def _since_start(values: ArrayLike) -> NDArray[np.float64]:
    since: NDArray[np.float64] = np.asarray(values) - np.asarray(values)[0]
    return since


def _coordinates(panel: Axes, run: RunSamples, joints: list[int], label: str) -> None:
    """Plot the coordinates of joints of one kind."""
    _curves(panel, run, joints, in_joint_units(run.chain.slides[joints].tolist(), run.q[:, joints]), label)


def _curves(panel: Axes, run: RunSamples, joints: list[int], values: Array, label: str) -> None:
    """Plot one column of values per joint."""
    # more entries do not fit next to a panel
    legend_entries = 8
    for place, k in enumerate(joints):
        name = run.chain.joint_name(k) if place < legend_entries else None
        panel.plot(run.t, values[:, place], label=name, linewidth=1.0)
    if len(joints) > legend_entries:
        label += f"\n(first {legend_entries} of {len(joints)} named)"
    panel.set_ylabel(label)
