"""Bode and Nyquist plots of a loop, and poles with their path as a number changes; this module needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.common.types import Array, Complex
from flexlink.pages.colours import BLUE, GREY, VERMILION
from flexlink.results.notebook_figure import NotebookFigure as Figure
from flexlink.results.notebook_figure import literal


def plot_bode(hertz: Array, L: Complex, title: str) -> Figure:
    """Magnitude and phase of a loop broken at one input."""
    figure = Figure(figsize=(7.0, 5.6), layout="constrained")
    size, phase = figure.subplots(2, 1, sharex=True)
    size.loglog(hertz, np.abs(L), color=BLUE)
    size.axhline(1.0, color=GREY, linewidth=0.8)
    size.set_ylabel("|L|")
    phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(L))), color=BLUE)
    phase.axhline(-180.0, color=GREY, linewidth=0.8)
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    figure.suptitle(f"loop broken at {title}", parse_math=False)  # numbers on log axes are mathematics
    for panel in (size, phase):
        panel.grid(alpha=0.3)
    return figure


@literal
def plot_nyquist(hertz: Array, L: Complex, title: str) -> Figure:
    """The loop in the complex plane near −1; `hertz` is not drawn."""
    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    panel = figure.subplots()
    panel.plot(L.real, L.imag, color=BLUE, label="L")
    panel.plot(L.real, -L.imag, color=BLUE, linewidth=0.8, linestyle="--", label="negative frequencies")
    panel.plot(-1.0, 0.0, "+", color=VERMILION, markersize=12, label="−1")
    _circle(panel)
    panel.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0), aspect="equal", xlabel="Re L", ylabel="Im L")
    panel.grid(alpha=0.3)
    panel.legend(loc="upper right", fontsize="small")
    figure.suptitle(f"loop broken at {title}, {hertz[0]:.3g} … {hertz[-1]:.3g} Hz")
    return figure


@literal
def plot_poles(
    poles: Sequence[Sequence[complex]], *, sampled: bool, title: str, values: Sequence[float] = ()
) -> Figure:
    """Poles z inside or outside the unit circle, or s left or right of the axis; a root locus if there are `values`."""
    figure = Figure(figsize=(6.6, 6.0), layout="constrained")
    panel = figure.subplots()
    own = values or [float(k) for k in range(len(poles))]
    z = np.concatenate([np.asarray(each, complex) for each in poles])
    colour = np.concatenate([np.full(len(each), value) for each, value in zip(poles, own, strict=True)])
    both, colours = np.concatenate([z, z.conj()]), np.concatenate([colour, colour])
    dots = panel.scatter(both.real, both.imag, c=colours if values else BLUE, s=14, cmap="viridis", zorder=3)
    if values:
        figure.colorbar(dots, ax=panel, label=title)
    if sampled:
        _circle(panel)
        panel.set(aspect="equal", xlabel="Re z", ylabel="Im z")
    else:
        panel.axvline(0.0, color=GREY, linewidth=0.8)
        panel.set(xlabel="Re s [1/s]", ylabel="Im s [1/s]")
    panel.grid(alpha=0.3)
    figure.suptitle("poles of the closed loop" if values else title, fontsize="small")
    return figure


def _circle(panel: object) -> None:
    φ = np.linspace(0.0, 2 * np.pi, 361)
    panel.plot(np.cos(φ), np.sin(φ), color=GREY, linewidth=0.8)  # type: ignore[attr-defined]
