"""Pictures of an arm at rest: Scene.plot and Chain.plot."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from flexlink.chain.branches import base_body, sliding_bodies, unslid
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import frames
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.pages.style import legend_over
from flexlink.results.pictures.view import views_of
from flexlink.scene_report.views import draw_arm, panels


def plot_scene(scene: Scene) -> Figure:
    """The arm where the scene starts; errors as in `initial_state`."""
    chain = lump(scene)
    return plot_chain(chain, initial_state(scene, chain)[0])


def plot_chain(chain: Chain, q: ArrayLike | None) -> Figure:
    """The arm at the angles q (n,) [rad]; None: joints at zero, springs slack."""
    placed = frames(chain, chain.rest if q is None else np.asarray(q))
    points, rails = placed.points, unslid(chain, placed.rotations, placed.points)
    seen = points[max(base_body(chain) - 1, 0) :]
    seen = np.concatenate([seen, rails[sliding_bodies(chain)]])
    views = views_of(chain, seen)
    figure, axes = panels(views, chain, seen)
    for panel, view in zip(axes, views, strict=True):
        draw_arm(panel, view, points, chain, rails)
    legend_over(axes[0], figure=figure)
    return figure
