"""Natural frequencies and mode shapes about the arm at rest, its driven joints held."""

from __future__ import annotations

import numpy as np

from flexlink.dynamics.vibration.at_rest import modes_at_rest
from flexlink.dynamics.vibration.modal import Modes
from flexlink.inputs.tip_wrench import initial_wrench
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, GREY, WIDTH
from flexlink.pages.tables import Cell, Sheet, table_csv
from flexlink.scene_report.part import Part
from flexlink.scene_report.study import Array, Study
from flexlink.scene_report.views import View, views_of

from matplotlib.figure import Figure  # isort: skip

ID, TITLE, SHORT = "modes", "Modes", "Modes"

DRAWN, LISTED = 4, 12
BENT = 0.2
"""Part of the arm's reach that a mode is drawn with."""


def made(study: Study) -> Part | None:
    """The chapter."""
    if not study.bends:
        return None
    chain, rest = study.chain, study.rest
    wrench, follower = initial_wrench(study.scene, chain)
    found = modes_at_rest(chain, rest, tip_wrench=wrench, follower=follower)
    sentences = (
        "Small vibrations about the arm at rest, its driven joints held; gravity counts. " + _first(found),
        "" if found.stable else "Not all of them die out: about this posture the arm is not stable.",
    )
    heads = ("mode", "frequency [Hz]", "damping ratio", "kind", "tip moves most along")
    lines = tuple(_line(found, k) for k in range(len(found.eigenvalues)))
    table = Sheet("modes", "Modes, slowest first", heads, lines, to_look_up=len(lines) > LISTED)
    return Part(tuple(filter(None, sentences)), pictures=(_picture(study, found),), tables=(table,))


def _first(found: Modes) -> str:
    if "elastic" not in found.kinds:
        return "No mode is elastic: loads hold the arm, not springs."
    k = found.kinds.index("elastic")
    ratio = number(float(found.damping_ratios[k]))
    return f"First elastic frequency: {number(float(found.hertz[k]))} Hz, damping ratio {ratio}."


def _line(found: Modes, k: int) -> tuple[Cell, ...]:
    tip = np.abs(found.paths[k, -1])
    axis = "xyz"[int(np.argmax(tip))] if tip.any() else ""
    return k + 1, float(found.hertz[k]), float(found.damping_ratios[k]), found.kinds[k], axis


def _picture(study: Study, found: Modes) -> Picture:
    shown = min(DRAWN, len(found.eigenvalues))
    figure = Figure(figsize=(WIDTH, 2.3 * ((shown + 1) // 2)), layout="constrained")
    axes = np.atleast_1d(figure.subplots((shown + 1) // 2, 2, squeeze=False)).ravel()
    lines: list[tuple[object, ...]] = []
    for k, panel in enumerate(axes):
        panel.set_visible(k < shown)
        if k >= shown:
            continue
        path = found.paths[k].real if np.abs(found.paths[k].real).max() > 0 else found.paths[k].imag
        bent = found.points + BENT * study.reach / (np.abs(path).max() or 1.0) * path
        view = _best_view(found.points, bent, study)
        panel.plot(*view(found.points), color=GREY, linewidth=1.0)
        panel.plot(*view(bent), color=BLUE, marker=".", markersize=4)
        panel.set_title(f"{k + 1}: {number(float(found.hertz[k]))} Hz")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel(view.labels[0].removesuffix(" [m]"), fontsize=9)
        panel.set_ylabel(view.labels[1].removesuffix(" [m]"), fontsize=9)
        panel.set(xticks=[], yticks=[])
        lines += [(k + 1, body, *p) for body, p in enumerate(path.tolist())]
    csv = table_csv(("mode", "body", "x", "y", "z"), lines)
    told = "Grey: at rest. Blue: the mode, its size not to scale, each seen across the plane it moves in most."
    return Picture("shapes", "The slowest modes", figure, told, csv)


def _best_view(rest: Array, bent: Array, study: Study) -> View:
    """From the side or from above, wherever more of the mode is seen."""

    def seen(view: View) -> float:
        return sum(float(np.abs(a - b).sum()) for a, b in zip(view(rest), view(bent), strict=True))

    return max(views_of(np.stack([rest, bent]), study.chain.gravity), key=seen)
