"""Figure 5 of the paper, in both readings of its initial angle."""

from __future__ import annotations

from collections.abc import Iterator

from reports.panels import TAKES, Motion, caption, draw_tall, draw_wide, motions
from reports.picture import Picture
from reports.results import Results

__all__ = ["SECTION", "TAKES", "draw", "readme"]

SECTION = "figure5"
SCENES = ("paper_fig5", "paper_fig5_raised")


def draw(results: Results) -> Iterator[Picture]:
    """Five panels a reading."""
    for motion in _found(results):
        yield Picture(f"figure5.{motion.scene}", draw_tall(motion), caption(motion))


def readme(results: Results) -> Picture | None:
    """The first reading in a shape for the README."""
    for motion in _found(results):
        return Picture("readme", draw_wide(motion), caption(motion))
    return None


def _found(results: Results) -> list[Motion]:
    return sorted((m for m in motions(results) if m.scene in SCENES), key=lambda m: SCENES.index(m.scene))
