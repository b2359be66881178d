"""Outline of an arm for drawing, with links as wide as their sections, in the frames of its bodies."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.builder import Piece
from flexlink.chain.chain import Chain
from flexlink.chain.layout import base_body, branches_of, sliding_bodies
from flexlink.chain.lumping import open_chain, pieces
from flexlink.common.types import Array, Indices
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.material import Section
from flexlink.describe.scene import Scene
from flexlink.dynamics.tied_motion import rods_of

Whole = Indices
Cuts = tuple[tuple[int, ...], tuple[int, ...]]
"""Cuts whose loads act on the start and on the end of a piece; a cut is given by the index of its body, from 0.

The load at the start acts at the hinge where the piece begins or, without a hinge, at the cuts outboard of the piece.
The load at the end comes from all bodies that are attached to the piece's body outboard of the piece.
"""


class Outline(NamedTuple):
    """Stations along the arm's links, from the base outward; body 0 is the base, and other bodies count from 1."""

    link: Whole  # (s,), number of each station's link, from 1
    body: Whole  # (s,), number of the body to which it belongs
    place: Array  # (s, 3), position in the body's frame [m]
    axes: Array  # (s, 2, 3), axes y and z of the section in the body's frame
    across: Array  # (s, 2), half height and half width [m], of a round section its radius; 0 without a section
    round: NDArray[np.bool_]  # (s,), whether the section is round
    piece: Whole  # (s,), index into `pieces`
    part: Array  # (s,), fraction of the piece's length
    bodies: int  # number of bodies, including the base and the tip frame
    joints: Whole  # bodies attached to driven joints
    ball: float  # radius of the payload [m], or 0
    center: Array  # (3,), the payload's centre in the tip frame [m]
    pieces: list[Piece]
    cuts: list[Cuts]  # cuts of every piece, see `_cuts`
    base: int  # the body that is the base: 0, or a floating body
    rails: tuple[Whole, Array]  # zero positions of sliding joints, then both ends of rods: bodies (r,), places (r, 3)
    order: Whole  # order of points along the arm, as indices of bodies, stations and rails; −1 between two branches


def outline_of(scene: Scene, chain: Chain) -> Outline:
    """Outline with stations on every piece of every link; a hinge where pieces meet belongs to the outboard piece."""
    arm, found = scene.arm, [piece for piece in pieces(open_chain(scene)) if piece.length > 0]
    rows = [row for k, piece in enumerate(found) for row in _stations(arm, found, k, piece)]
    link, body, place, axes, across, is_round, number, part = zip(*rows, strict=True) if rows else [()] * 8
    steel = 7850.0  # kg/m³; a payload is drawn as a ball of steel of its mass
    ball = (3 * arm.tip.mass / (4 * math.pi * steel)) ** (1 / 3)
    sliding = sliding_bodies(chain)
    rails = chain.bodies["parent"][sliding].astype(np.int64), chain.bodies["translation"][sliding]
    rods = rods_of(scene, chain)
    marks = np.concatenate([rails[0], rods[0]]), np.concatenate([rails[1], rods[1]])
    joints = np.array([chain.body(int(k)) + 1 for k in chain.active], dtype=np.int64)
    bodies, numbers, cuts = np.array(body, dtype=np.int64), np.array(number, dtype=np.int64), _cuts(arm, chain, found)
    return Outline(
        np.array(link, dtype=np.int64), bodies, np.reshape(place, (-1, 3)),
        np.reshape(axes, (-1, 2, 3)), np.reshape(across, (-1, 2)), np.array(is_round, dtype=bool),
        numbers, np.array(part, dtype=float),
        len(chain.bodies) + 1, joints, ball, np.array(arm.tip.center), found,
        cuts, base_body(chain), marks, _order(chain, bodies, numbers, cuts, len(rods[0])),
    )  # fmt: skip


def _order(chain: Chain, body: Whole, piece: Whole, cuts: list[Cuts], ends: int) -> Whole:
    """`Outline.order`: pairs of ends of rods, then all points along every branch, starting at its parent body."""
    count, order = len(chain.bodies) + 1, list[int]()
    first = count + len(body) + len(sliding_bodies(chain))
    for end in range(first, first + ends, 2):
        order += [end, end + 1, -1]
    rails = {k + 1: [count + len(body) + row] for row, k in enumerate(sliding_bodies(chain))}
    for branch in branches_of(chain):
        order += [-1, branch[0]] if order and order[-1] != -1 else [branch[0]]
        for b, following in pairwise(branch):
            order += [count + s for s in np.flatnonzero(body == b).tolist() if following - 1 in cuts[piece[s]][1]]
            order += [*rails.get(following, []), following]
    return np.array(order, dtype=np.int64)


def _cuts(arm: Arm, chain: Chain, found: list[Piece]) -> list[Cuts]:
    """Cuts of every piece, due to its own hinges and the children of its link, not due to other links on its body."""
    hinges = zip(chain.bodies["first"].tolist(), chain.bodies["stop"].tolist(), strict=True)
    of_body = [chain.coordinates[first].link if stop > first else 0 for first, stop in hinges]
    for name, number in chain.tips.items():
        of_body[number] = arm.number(name)
    behind = [{k} for k in range(len(arm.links) + 1)]
    for k in range(len(arm.links), 0, -1):
        behind[arm.parents[k - 1]] |= behind[k]
    parents, cuts = chain.bodies["parent"].tolist(), []
    for k, piece in enumerate(found):
        children = [j for j, parent in enumerate(parents) if parent == piece.body]
        beyond = tuple(j for j in children if of_body[j] in behind[piece.link])
        first = piece.body > 0 and (not k or found[k - 1].body != piece.body)
        alone = len(beyond) == len(children) or of_body[piece.body - 1] == piece.link
        cuts.append(((piece.body - 1,) if first and alone else beyond, beyond))
    return cuts


def _stations(arm: Arm, found: list[Piece], k: int, piece: Piece) -> list[tuple[object, ...]]:
    link = arm.links[piece.link - 1]
    stations = 24  # minimum number of stations along a link, to resolve its colour
    steps = max(1, math.ceil((piece.part[1] - piece.part[0]) * stations))
    ends_here = k + 1 == len(found) or found[k + 1].link != piece.link
    rows: list[tuple[object, ...]] = []
    for u in np.arange(steps + ends_here) / steps:
        (R, p), x = piece.place, piece.part[0] + u * (piece.part[1] - piece.part[0])
        across, is_round = half_dimensions(arm, link, x)
        place = p + R @ np.array([u * piece.length, 0.0, 0.0])
        rows.append((piece.link, piece.body, place, R.T[1:], across, is_round, k, u))
    return rows


def half_dimensions(arm: Arm, link: Link, x: float) -> tuple[tuple[float, float], bool]:
    """Half height and width of a section at `x` of a link [m] (general: by radii of gyration); whether it is round."""
    if link.section is None:
        return (0.0, 0.0), False
    root, tip = arm.sections[link.section], arm.sections[link.section_tip or link.section]

    def between(name: str) -> float:
        return float((1 - x) * getattr(root, name) + x * getattr(tip, name)) / 2

    if root.shape in {"circle", "tube"}:
        radius = between("diameter" if root.shape == "circle" else "outer")
        return (radius, radius), True
    if root.shape == "general":
        area, i_y, i_z, _ = root.towards(tip, x)
        return (math.sqrt(3 * i_z / area), math.sqrt(3 * i_y / area)), False
    return (between("height"), between("width")), False


def has_rectangle_instead(section: Section) -> bool:
    """Whether a section is drawn as a rectangle, since its shape is not known."""
    return section.shape == "general"
