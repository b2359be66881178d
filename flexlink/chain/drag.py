"""Where drag acts on a chain: Gauss points of the straight pieces of its links, of which each stands for a length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from flexlink.chain.builder import Piece
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene


def drag_rows(scene: Scene, chain: Chain, pieces: Sequence[Piece]) -> list[tuple[object, ...]]:
    """The points at which links meet drag, rows of dtype `DRAG`, at hand of the pieces of the links."""
    arm, counts = scene.arm, Counter(piece.link for piece in pieces)
    # Gauss points of a piece and of a link. Two integrate the moment of a drag that does not change sign exactly, in a
    # plane and of constant breadth; 8 points of a link put 1e-4 of the torque right where it does, or the link tapers.
    fewest, of_link = 2, 8
    rows = []
    for piece in pieces:
        link = arm.links[piece.link - 1]
        if link.drag is not None and piece.body and piece.length:
            rows += _of_piece(piece, link, arm, max(fewest, -(-of_link // counts[piece.link])), scene.fluid_density)
    return rows


def _of_piece(piece: Piece, link: Link, arm: Arm, count: int, density: float) -> list[tuple[object, ...]]:
    """Rows of dtype `DRAG`."""
    assert link.drag is not None
    (R, p), (start, stop) = piece.place, piece.part
    nodes, weights = np.polynomial.legendre.leggauss(count)
    rows: list[tuple[object, ...]] = []
    for part, weight in zip(((1 + nodes) / 2).tolist(), (weights / 2).tolist(), strict=True):
        breadths = _breadths(link, arm, start + part * (stop - start))
        drag = 0.5 * density * link.drag.coefficient * weight * piece.length * breadths
        rows.append((piece.body - 1, p + R @ (part * piece.end), R.T[1:], drag))
    return rows


def _breadths(link: Link, arm: Arm, x: float) -> Array:
    """Seen along the section's y and z, at a part of the link [m]."""
    assert link.drag is not None
    if link.drag.breadth is not None:
        return np.array(link.drag.breadth)
    root, tip = (arm.sections[name] for name in (link.section or "", link.section_tip or link.section or ""))
    return np.array(root.breadths(tip, x))
