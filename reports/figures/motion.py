"""Motions in the panels of the paper's figure 5, and the paper's arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexlink.common.types import Array
from flexlink.pages.colours import GREY, INK, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, colour_along
from flexlink.pages.tables import table_csv
from reports.curves import floats
from reports.figures import figure
from reports.panels import Motion, caption, data, draw_tall, draw_wide, motions
from reports.results import Results


@figure("trajectory")
def motion(results: Results) -> Iterator[Picture]:
    """Motion of every scene except the paper's, in the panels of the paper's figure 5.

    Up to five panels per scene.
    """
    for motion in motions(results):
        if motion.scene not in SCENES:
            name, title = f"{motion.case}.{motion.scene}", f"{motion.scene}: motion"
            yield Picture(name, title, draw_tall(motion), caption(motion), data(motion))


SCENES = {"paper_fig5": "hanging arm", "paper_fig5_raised": "raised arm"}


@figure("figure5")
def paper_fig5(results: Results) -> Iterator[Picture]:
    """Figure 5 of the paper, in both readings of its initial angle.

    Five panels per reading.
    """
    for motion in _found(results):
        title = f"Figure 5 of the paper, {SCENES[motion.scene]}"
        yield Picture(f"figure5.{motion.scene}", title, draw_tall(motion), caption(motion), data(motion))


def readme(results: Results) -> Picture | None:
    """Figure for the README, with the first reading of the initial angle."""
    for motion in _found(results):
        return Picture("readme", "Figure 5 of the paper", draw_wide(motion), caption(motion), data(motion))
    return None


def _found(results: Results) -> list[Motion]:
    return sorted((m for m in motions(results) if m.scene in SCENES), key=lambda m: list(SCENES).index(m.scene))


ELBOW, HAND = "joint-3", "hand"
READINGS = {
    "paper_fig5": "hanging 10° from the vertical (scene paper_fig5)",
    "paper_fig5_raised": "10° from upright (scene paper_fig5_raised, the other reading of the paper's angle)",
}
"""Initial configuration by scene; the first scene in the study is drawn."""
UNTIL = 1.0  # end of the picture's interval [s]
POSTURES = 6  # configurations drawn in this interval
CAPTION = "Two flexible links of 1.25 m each fall from rest, {}. Light to dark: 0 to 1 s."
TITLE = "The arm of the paper's figure 5"


@figure("summary")
def arm(results: Results) -> Iterator[Picture]:
    """Picture for the first screen: the arm of the paper's figure 5 during the first second of its fall.

    One picture.
    """
    found = {motion.scene: motion for motion in motions(results) if _is_in_space(motion)}
    yield from (_arm_picture(found[scene]) for scene in [scene for scene in READINGS if scene in found][:1])


def _is_in_space(motion: Motion) -> bool:
    return all(part in motion.native and {"x", "z"} <= set(motion.native[part].columns) for part in (ELBOW, HAND))


def _arm_picture(motion: Motion) -> Picture:
    time, elbow = _path(motion, ELBOW)
    _, hand = _path(motion, HAND)
    end = int(np.searchsorted(time, UNTIL, side="right"))
    chosen = np.unique(np.linspace(0, max(end - 1, 0), POSTURES).astype(int))
    figure = Figure(figsize=(0.5 * WIDTH, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(hand[:end, 0], hand[:end, 1], color=GREY, linewidth=0.8)
    for k, part in zip(chosen, np.linspace(0.0, 1.0, len(chosen)), strict=True):
        joints = np.array([(0.0, 0.0), elbow[k], hand[k]])
        axes.plot(*joints.T, color=colour_along(part), linewidth=2.4, solid_capstyle="round")
        axes.plot(*joints[1:2].T, "o", color=VERMILION, markersize=5)
    axes.plot(0.0, 0.0, "s", color=INK, markersize=9)
    axes.plot(0.0, 0.0, "o", color=VERMILION, markersize=5)
    axes.set(xlabel="x [m]", ylabel="z, downwards [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    ring = {"marker": "o", "color": VERMILION, "linestyle": ""}
    key = {
        "flexible link": Line2D([], [], color=colour_along(1.0), linewidth=2.4), "free joint": Line2D([], [], **ring),
        "path of the hand": Line2D([], [], color=GREY, linewidth=0.8),
    }  # fmt: skip
    figure.legend(key.values(), key.keys(), loc="outside upper left", frameon=False)
    lines = [(float(time[k]), *elbow[k].tolist(), *hand[k].tolist()) for k in range(end)]
    heads = ("time [s]", "elbow x [m]", "elbow z [m]", "hand x [m]", "hand z [m]")
    return Picture("arm", TITLE, figure, CAPTION.format(READINGS[motion.scene]), table_csv(heads, lines))


def _path(motion: Motion, part: str) -> tuple[Array, Array]:
    """Times, and the coordinates x and z of a point at each time."""
    columns = motion.native[part].columns
    return floats(columns["time [s]"]), np.column_stack([floats(columns[axis]) for axis in "xz"])
