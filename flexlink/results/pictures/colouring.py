"""The colour of a link, which shows the bending moment, or the strain at its surface, from a run's internal loads.

Loads are known at every hinge and joint, and moments are interpolated linearly between them. M_s = M + r × F transfers
a moment from a joint to the start of the adjacent beam. The strain due to bending about y and z is, with half height a
and half width b,

    ε = |M_z| a / EI_z + |M_y| b / EI_y          for a round section  ε = r √(M_y² + M_z²) / EI
"""

from typing import Literal, NamedTuple

import numpy as np

from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.results.pictures.outline import Outline, has_rectangle_instead
from flexlink.results.samples import RunSamples

Colour = Literal["moment", "strain"]

STOPS = ("#1f0c94", "#6a00a8", "#9c179e", "#c5407e", "#e16462", "#f38748", "#fdb42f")
"""Colours from 0 to the largest value, interpolated linearly; suitable for colour-blind readers and in greyscale."""

UNKNOWN = "#8a8f94"  # colour of links without a value: links without a section and, if strain is shown, rigid links


class Colouring(NamedTuple):
    """Values along the arm (≥ 0, or nan where a link has none), the largest value, and a label with the unit."""

    values: Array  # (frames, s), value at every station of the outline
    largest: float  # 0 if there is nothing to colour
    label: str


def colouring(colour: Colour, arm: Arm, outline: Outline, placed: tuple[Array, Array], run: RunSamples) -> Colouring:
    """Values at every station of the outline in every frame; `placed` are R and p of the bodies, as in `Film`."""
    about = _bending(outline, placed, run)
    if colour == "moment":
        values, label = np.hypot(about[..., 0], about[..., 1]), "bending moment [N m]"
        values[:, [arm.links[k - 1].section is None for k in outline.link]] = np.nan
    else:
        values, label = _strain(arm, outline, about), "bending strain at the surface [µm/m]"
        used = {name for link in arm.links for name in (link.section, link.section_tip) if name is not None}
        if any(has_rectangle_instead(arm.sections[name]) for name in used):
            label += ", general sections as rectangles"
    return Colouring(values, float(np.nanmax(values, initial=0.0)) if np.isfinite(values).any() else 0.0, label)


def _strain(arm: Arm, outline: Outline, about: Array) -> Array:
    """Bending strain at the surface [µm/m]; nan for rigid links."""
    rates = np.full((len(outline.link), 2), np.nan)  # strain per moment about y and z [1/(N m)]
    for s, number in enumerate(outline.link):
        link = arm.links[number - 1]
        if link.flex == "rigid" or link.section is None or link.material is None:
            continue
        root, tip = arm.sections[link.section], arm.sections[link.section_tip or link.section]
        begin, end = outline.pieces[outline.piece[s]].part
        _, i_y, i_z, _ = root.towards(tip, begin + outline.part[s] * (end - begin))
        a, b = outline.across[s]
        rates[s] = b / (arm.materials[link.material].young * i_y), a / (arm.materials[link.material].young * i_z)
    parts = np.abs(about) * rates
    return np.asarray(1e6 * np.where(outline.round, np.hypot(parts[..., 0], parts[..., 1]), parts.sum(axis=-1)))


def _bending(outline: Outline, placed: tuple[Array, Array], run: RunSamples) -> Array:
    """Moments about the section's y and z at every station, shape (frames, s, 2) [N m]."""
    R, p = placed
    sections = R[:, 1:] @ run.chain.described["section"]
    force, moment = (np.einsum("fbij,fbj->fbi", sections, part) for part in (run.loads.force, run.loads.moment))

    def at(cut: int, body: int, place: Array) -> Array:
        point = p[:, body] + R[:, body] @ place
        return np.asarray(moment[:, cut] + cross(p[:, cut + 1] - point, force[:, cut]))

    def of(cuts: tuple[int, ...], body: int, place: Array) -> Array:
        return np.asarray(sum((at(cut, body, place) for cut in cuts), np.zeros((len(p), 3))))

    ends = np.empty((len(outline.pieces), 2, len(p), 3))
    for k, (piece, (before, beyond)) in enumerate(zip(outline.pieces, outline.cuts, strict=True)):
        start = piece.place.p
        ends[k] = of(before, piece.body, start), of(beyond, piece.body, start + piece.length * piece.place.R[:, 0])
    between = np.moveaxis(ends[outline.piece], 2, 0)  # loads at both ends of each station's piece, (frames, s, 2, 3)
    u = outline.part[:, None]
    vectors = (1 - u) * between[:, :, 0] + u * between[:, :, 1]
    axes = np.einsum("fsij,saj->fsai", R[:, outline.body], outline.axes)
    return np.asarray(np.einsum("fsai,fsi->fsa", axes, vectors))
