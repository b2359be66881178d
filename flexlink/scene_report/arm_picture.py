"""Draw an arm true to scale, for Scene.plot, Chain.plot, and figures of the report."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import SPRINGS
from flexlink.chain.layout import as_lines, base_body, sliding_bodies, unslid
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import frames
from flexlink.dynamics.tied_motion import rods_of
from flexlink.dynamics.ties import poses
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.style import WIDTH, legend_over
from flexlink.results.pictures.view import View, views_of
from flexlink.results.plotting import NotebookFigure as Figure
from flexlink.results.plotting import axes_of, literal


def plot_scene(scene: Scene, ax: Any = None) -> Figure:
    """Plot the arm in the initial state of the scene; errors are listed at `initial_state`."""
    chain = lump(open_chain(scene))
    return plot_chain(chain, initial_state(scene, chain)[0], scene, ax)


@literal
def plot_chain(chain: Chain, q: ArrayLike | None, scene: Scene | None = None, ax: Any = None) -> Figure:
    """Plot the arm at the angles q (n,) [rad], with the scene's rods; without q at joints zero and springs relaxed."""
    q = chain.rest if q is None else np.asarray(q, dtype=float)
    placed, rods = frames(chain, q), np.zeros((0, 2, 3))
    if scene is not None and scene.ties:
        (R, p), (ends, places) = poses(chain, q), rods_of(scene, chain)
        rods = (p[ends - 1] + np.einsum("kij,kj->ki", R[ends - 1], places)).reshape(-1, 2, 3)
    points, rails = placed.points, unslid(chain, placed.rotations, placed.points)
    seen = np.concatenate([of_arm(chain, points), rails[sliding_bodies(chain)], rods.reshape(-1, 3)])
    views = views_of(chain, seen)
    figure, axes = panels(views, chain, seen, ax)
    for panel, view in zip(axes, views, strict=True):
        draw_arm(panel, view, points, chain, rails)
        for k, rod in enumerate(rods):
            panel.plot(*view.flat(rod), color=GREY, linewidth=1.6, zorder=2, label="" if k else "rods")
    legend_over(axes[0], figure=figure if ax is None else None)
    return figure


def of_arm(chain: Chain, points: Array) -> Array:
    """Return the origins of the bodies (…, bodies, 3), from a floating base on."""
    return points[..., max(base_body(chain) - 1, 0) :, :]


def panels(views: list[View], chain: Chain, points: Array, ax: Any = None) -> tuple[Figure, list[Axes]]:
    """Return one panel per view; all show these points (…, 3) at the same scale, and the base if it is fixed."""
    shown = points.reshape(-1, 3)
    if not base_body(chain):
        shown = np.concatenate([np.zeros((1, 3)), shown])
    boxes = []
    for view in views:
        x, y = view.flat(shown)
        margin = 0.06 * (max(np.ptp(x), np.ptp(y)) or 1.0)
        boxes.append((x.min() - margin, x.max() + margin, y.min() - margin, y.max() + margin))
    width = max(box[1] - box[0] for box in boxes)
    heights = [min(max((box[3] - box[2]) / width, 0.18), 1.3) for box in boxes]
    size = WIDTH, 0.85 * WIDTH * sum(heights) + 0.75 * len(views)
    figure, axes = axes_of(ax, len(views), size, "", height_ratios=heights)
    for view, panel, box in zip(views, axes, boxes, strict=True):
        panel.set(xlim=box[:2], ylim=box[2:], xlabel=view.labels[0], ylabel=view.labels[1])
        panel.set_aspect("equal", adjustable="box")
    return figure, axes


def draw_arm(axes: Axes, view: View, points: Array, chain: Chain, rails: Array | None = None) -> None:
    """Draw the arm as lines between body origins, with dots for springs, rings for driven joints and stars for tips."""
    axes.plot(*view.flat(as_lines(chain, points, rails=rails)), color=BLUE, linewidth=2.2, zorder=2)
    base = base_body(chain)
    at = points[base - 1 : base] if base else np.zeros((1, 3))
    axes.plot(*view.flat(at), "s", color=INK, markersize=8, zorder=3, label="base")
    x, y = view.flat(points)
    hinges = [chain.body(int(k)) for k in chain.where(*SPRINGS)]
    driven = [chain.body(int(k)) for k in chain.active]
    if hinges:
        axes.plot(x[hinges], y[hinges], ".", color=INK, markersize=6, zorder=4, label="springs")
    if driven:
        ring = {"markerfacecolor": "none", "markeredgewidth": 1.8, "color": VERMILION}
        axes.plot(x[driven], y[driven], "o", markersize=9, zorder=5, label="driven joints", **ring)
    tips = list(chain.tips.values())
    axes.plot(x[tips], y[tips], "*", color=INK, markersize=9, zorder=5, label="tip" if len(tips) == 1 else "tips")


def draw_shadow(axes: Axes, view: View, points: Array, chain: Chain, *, base: bool = True, **look: Any) -> None:
    """Draw an arm as a thin line, with or without the line to a fixed base."""
    axes.plot(*view.flat(as_lines(chain, points, base=base)), **{"color": GREY, "linewidth": 1.0} | look)
