"""Figure 5 of the paper, in both readings of its initial angle."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.picture import Picture
from reports.panels import TAKES, Motion, caption, data, draw_tall, draw_wide, motions
from reports.results import Results

__all__ = ["SECTION", "TAKES", "draw", "readme"]

SECTION = "figure5"
SCENES = {"paper_fig5": "hanging arm", "paper_fig5_raised": "raised arm"}


def draw(results: Results) -> Iterator[Picture]:
    """Five panels per reading."""
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
