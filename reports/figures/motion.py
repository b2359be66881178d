"""Motion of every scene except the paper's, in the panels of the paper's figure 5."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.picture import Picture
from reports.figures import paper_fig5
from reports.panels import TAKES, caption, data, draw_tall, motions
from reports.results import Results

__all__ = ["SECTION", "TAKES", "draw"]

SECTION = "trajectory"


def draw(results: Results) -> Iterator[Picture]:
    """Up to five panels per scene."""
    for motion in motions(results):
        if motion.scene not in paper_fig5.SCENES:
            name, title = f"{motion.case}.{motion.scene}", f"{motion.scene}: motion"
            yield Picture(name, title, draw_tall(motion), caption(motion), data(motion))
