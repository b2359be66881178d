"""Force elements of a scene, other than springs between hinges, as rows of the dtypes `layout.FORCES`."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.builder import Piece
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.kernels.layout import FORCES

Rows = list[tuple[object, ...]]


def drag_rows(scene: Scene, chain: Chain, pieces: Sequence[Piece]) -> Rows:
    """Points at which drag acts, rows of dtype `DRAG`: Gauss points of the pieces, with the length of each."""
    arm, counts = scene.arm, Counter(piece.link for piece in pieces)
    # Least numbers of Gauss points on a piece and on a link. Two points integrate the drag moment exactly in a plane,
    # if the breadth and the velocity's sign are constant. If not, eight per link give a torque error of 1e-4.
    fewest, of_link = 2, 8
    rows: Rows = []
    for piece in pieces:
        link = arm.links[piece.link - 1]
        if link.drag is not None and piece.body and piece.length:
            count = max(fewest, -(-of_link // counts[piece.link]))
            rows += _drag_of_piece(piece, link, arm, count, scene.fluid_density)
    return rows


def _drag_of_piece(piece: Piece, link: Link, arm: Arm, count: int, density: float) -> Rows:
    """Points at which drag acts on a piece, rows of dtype `DRAG`."""
    assert link.drag is not None
    (R, p), (start, stop) = piece.place, piece.part
    nodes, weights = np.polynomial.legendre.leggauss(count)
    rows: Rows = []
    for part, weight in zip(((1 + nodes) / 2).tolist(), (weights / 2).tolist(), strict=True):
        breadths = link.drag.breadth  # seen along the section's y and z [m]
        if breadths is None:
            root, tip = (arm.sections[name] for name in (link.section or "", link.section_tip or link.section or ""))
            breadths = root.breadths(tip, start + part * (stop - start))
        drag = 0.5 * density * link.drag.coefficient * weight * piece.length * np.array(breadths)
        rows.append((piece.body - 1, p + R @ (part * piece.end), R.T[1:], drag))
    return rows


def joint_rows(scene: Scene, chain: Chain, pieces: Sequence[Piece], key: str) -> Rows:
    """Joints in which the number `key` is not 0, with this number."""
    joints = [(k, scene.arm.links[chain.coordinates[k].link - 1].joint) for k in chain.active.tolist()]
    return [(k, value) for k, joint in joints if (value := getattr(joint, key))]


def gyrator_rows(scene: Scene, chain: Chain, pieces: Sequence[Piece]) -> Rows:
    """Gyrators between joints and the internal coordinates of their lagging friction."""
    links = [(k, chain.coordinates[k].link) for k in chain.internal.tolist()]
    return [(chain.index(link, 0, 0), k, scene.arm.links[link - 1].joint.viscous) for k, link in links]


ROWS: dict[str, Callable[[Scene, Chain, Sequence[Piece]], Rows]] = {
    "drag": drag_rows, "dampers": partial(joint_rows, key="quadratic"), "gyrators": gyrator_rows,
    "hardening": partial(joint_rows, key="hardening"),
}  # fmt: skip
"""For each kind of force element, the function that returns a scene's rows, given the straight pieces of its links."""


def with_forces(chain: Chain, scene: Scene, pieces: Sequence[Piece]) -> Chain:
    """Return the chain with its force elements, which must be finite; the same chain if the scene has none."""
    forces = {}
    for name, rows_of in ROWS.items():
        if rows := rows_of(scene, chain, pieces):
            forces[name] = np.array(rows, dtype=FORCES[name])
            for field in forces[name].dtype.names or ():
                if not np.isfinite(forces[name][field]).all():
                    text = f"{scene.name}: the {field} of {name} overflows float64; use smaller values"
                    raise SceneError(text, id="overflow")
    return dataclasses.replace(chain, forces=forces) if forces else chain


def refuse_states(chain: Chain, what: str, instead: str = "", *, free: NDArray[np.intp] | None = None) -> None:
    """Refuse lagging friction for a method that does not support it; `free`: moving coordinates, by default all."""
    joints = chain.force("gyrators")["inner"]
    lagging = joints if free is None else np.intersect1d(joints, free)
    if len(lagging):
        text = f"viscous_lag of joint {chain.joint_name(int(lagging[0]))!r}: {what}; leave it out{instead}"
        raise ArgumentError(f"{chain.name}: {text}", id="not-supported-here")
