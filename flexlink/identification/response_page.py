"""Pictures of measured and predicted frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexlink.common.types import Array, Complex
from flexlink.identification.block import unit_in
from flexlink.identification.fitted import Fitted
from flexlink.identification.frequency_response import Response, measured_response
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over, stacked_axes
from flexlink.pages.tables import Table, columns_csv


class Compared(NamedTuple):
    """A measured response, and predictions by name: "before" and "fitted"."""

    name: str
    use: str
    measured: Response
    predicted: Mapping[str, Complex]


def compared(fitted: Fitted) -> list[Compared]:
    """The frequency responses of a fit, measured, before and after."""
    found = []
    for number, part in enumerate(fitted.problem.frf, 1):
        name, scene = f"frf {number}", fitted.problem.scene.varied(part.set)
        real, imaginary = (one for one in fitted.columns if one.source == name)
        predicted = {"before": real.before + 1j * imaginary.before, "fitted": real.after + 1j * imaginary.after}
        found.append(Compared(name, part.use, measured_response(scene, part, name), predicted))
    return found


def pictures(responses: Sequence[Compared]) -> tuple[Picture, ...]:
    """One picture for each response: magnitude, phase, and coherence if it is known."""
    return tuple(_picture(one) for one in responses)


def _picture(one: Compared) -> Picture:
    looks: dict[str, dict[str, Any]] = {
        "measured": {"color": GREY, "linestyle": "", "marker": ".", "markersize": 4}, "fitted": {"color": BLUE},
        "before": {"color": VERMILION, "linewidth": 0.8},
    }  # fmt: skip
    f, known = one.measured.f, bool(np.isfinite(one.measured.coherence).any())
    figure, axes = stacked_axes(2 + known, 2.2)
    columns = {"f [Hz]": f}
    for label, H in {"measured": one.measured.H, **one.predicted}.items():
        size, phase = np.abs(H), np.degrees(np.angle(H))
        axes[0].loglog(f, np.where(size > 0, size, np.nan), label=label, **looks[label])
        axes[1].semilogx(f, _with_breaks(phase) if label != "measured" else phase, **looks[label])
        columns |= {f"{label} {one.measured.name}": size, f"{label} phase [deg]": phase}
    axes[0].set_ylabel(unit_in(one.measured.name))
    axes[0].set_title(f"{one.name} ({one.use}): {one.measured.name.rpartition(' [')[0]}", loc="left")
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_yticks([-180, -90, 0, 90, 180])
    columns["standard deviation"] = one.measured.σ
    if known:
        axes[2].semilogx(f, one.measured.coherence, color=INK, linewidth=0.9)
        axes[2].set_ylabel("coherence")
        axes[2].set_ylim(0, 1.05)
        columns["coherence"] = one.measured.coherence
    axes[-1].set_xlabel("frequency [Hz]")
    legend_over(axes[0], figure=figure)
    names = ", ".join(("measured", *one.predicted))
    caption = f"Magnitude and phase: {names}{'; coherence of the measurement' if known else ''}."
    return Picture(one.name.replace(" ", "_"), "Frequency response", figure, caption, columns_csv(columns))


def _with_breaks(phase: Array) -> Array:
    """Phase [deg] with nan where it jumps by a turn, so that no line is drawn there."""
    return np.where(np.abs(np.diff(phase, append=phase[-1])) > 180, np.nan, phase)


def table(responses: Sequence[Compared]) -> Table:
    """RMS residuals of all responses, in their unit and in standard deviations."""
    heads = ("source", "response", "use", "frequencies", "from [Hz]", "to [Hz]", "prediction", "RMS residual",
             "RMS residual in standard deviations")  # fmt: skip
    lines = tuple(
        (one.name, one.measured.name, one.use, len(one.measured.f), float(one.measured.f[0]),
         float(one.measured.f[-1]), label, float(np.sqrt(np.mean(np.abs(H - one.measured.H) ** 2))),
         float(np.sqrt(np.mean(np.abs(H - one.measured.H) ** 2 / (2 * one.measured.σ**2)))))
        for one in responses for label, H in one.predicted.items()
    )  # fmt: skip
    return Table("responses", "Frequency responses", heads, lines)
