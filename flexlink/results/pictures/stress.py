"""Largest bending stress in a run, with its position along a link and its time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.results.pictures.colouring import colouring
from flexlink.results.pictures.film import placed
from flexlink.results.pictures.outline import Outline, has_rectangle_instead, outline_of
from flexlink.results.samples import RunSamples, picked

AT_ONCE = 500  # samples per batch, which limits the memory


class PeakStress(NamedTuple):
    """Largest bending stress E ε at the surface of a flexible link."""

    pascals: float
    link: str
    along: float  # distance from the root of the link's beam [m]
    time: float  # time at which it occurs [s]
    rectangle: bool  # whether a general section, of unknown surface, is replaced by a rectangle of equal inertia


def peak_stress(run: RunSamples) -> PeakStress | None:
    """Largest bending stress over all samples; None if no flexible link has a section and a material."""
    if run.scene is None or not len(run.t):
        return None
    arm, outline = run.scene.arm, outline_of(run.scene, run.chain)
    young = [arm.materials[name].young if (name := arm.links[k - 1].material) else np.nan for k in outline.link]
    best: PeakStress | None = None
    for first in range(0, len(run.t), AT_ONCE):
        part = picked(run, np.arange(first, min(first + AT_ONCE, len(run.t))))
        strain = 1e-6 * colouring("strain", arm, outline, placed(part, part.q), part).values
        stress = strain * np.array(young)
        if not np.isfinite(stress).any():
            return None
        row, station = np.unravel_index(int(np.nanargmax(stress)), stress.shape)
        link = arm.links[outline.link[station] - 1]
        if best is None or stress[row, station] > best.pascals:
            best = PeakStress(
                float(stress[row, station]), link.name, _along(outline, int(station)) * float(link.beam.length),
                float(part.t[row]), bool(link.section and has_rectangle_instead(arm.sections[link.section])),
            )  # fmt: skip
    return best


def _along(outline: Outline, station: int) -> float:
    """Position of a station as a fraction of its link's length."""
    begin, end = outline.pieces[outline.piece[station]].part
    return float(begin + outline.part[station] * (end - begin))
