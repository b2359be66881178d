"""Functions that all writers use: single joints, unique names, numbers that read back exactly; capsules to look at."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import BASE_JOINTS, Kind, unique
from flexlink.chain.shapes import refuse_shapes
from flexlink.common.products import dot, product
from flexlink.common.types import Array
from flexlink.describe.arm import BASE
from flexlink.kernels.layout import SLIDES

UPPER_TRIANGLE = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
ROTATION_SPRINGS = "rotation_springs"  # custom attribute that lists the rotation-vector springs in a file
WIDE = {"lower": "-1e9", "upper": "1e9"}  # limits [rad, m] of an unlimited joint, for formats that require limits


class Place(NamedTuple):
    """A hinge in formats with one link per joint: its pose relative to the link of the parent hinge."""

    k: int
    parent: int  # parent hinge; −1: the base
    translation: Array  # of the hinge's frame in the parent's frame [m]
    rotation: Array  # R at zero angle: v_parent = R v
    body: np.void | None  # rigid body attached to the hinge; None: no inertia


def places(chain: Chain) -> Iterator[Place]:
    """Yield all hinges in sequential order; only the last of several hinges at one point has a body.

    Hinges of a floating base are included; the last of them is the parent of the arm's hinges.
    """
    for body, on in zip(chain.bodies, _parent_hinges(chain), strict=True):
        parent, translation, rotation = on, body["translation"], body["rotation"]
        for k in range(body["first"], body["stop"]):
            last = k == body["stop"] - 1 and (body["mass"] or body["inertia"].any())
            yield Place(k, parent, translation, rotation, body if last else None)
            translation, rotation, parent = np.zeros(3), np.eye(3), k


def joint_places(chain: Chain) -> Iterator[Place]:
    """Yield all hinges except the hinges of a floating base, for which formats have other elements."""
    return (place for place in places(chain) if place.k >= base_joints(chain))


class Tip(NamedTuple):
    """A tip frame."""

    name: str  # name of the tip in files
    link: int  # number, from 1, of the link that ends here
    parent: int  # parent hinge; −1: the base
    translation: Array
    rotation: Array


def tips(chain: Chain) -> list[Tip]:
    """Return the tip frames in the order of the bodies; the arm's tip is last."""
    bodies, parents, names = chain.bodies, _parent_hinges(chain), xml_link_names(chain)[chain.n + 1 :]
    return [
        Tip(name, chain.link_names.index(link) + 1, parents[k], bodies["translation"][k], bodies["rotation"][k])
        for name, (link, k) in zip(names, chain.tips.items(), strict=True)
    ]


def loaded_tip(chain: Chain) -> Tip:
    """Return the tip at which the wrench acts."""
    bodies = [number for number in chain.tips.values() if chain.bodies["loaded"][number]]
    return tips(chain)[[*chain.tips.values()].index(bodies[0]) if bodies else -1]


def base_joints(chain: Chain) -> int:
    """Number of joints of a floating base; they come first."""
    return BASE_JOINTS if chain.has_free_base else 0


def tree_attributes(chain: Chain) -> dict[str, str]:
    """Return custom attributes: a floating base's rotation at zero angles, row by row, names, the loaded link's number.

    Empty for an arm on a fixed base whose joints have the names of their links, and whose wrench acts at the last link.
    """
    attributes, tip = {}, loaded_tip(chain)
    if chain.has_free_base:
        attributes[BASE] = decimals(chain.bodies["rotation"][1].flat)
    if chain.joints_of_links != chain.link_names:
        attributes["joints"] = names_text(chain.joints_of_links)
    return attributes | ({"loaded": str(tip.link)} if tip.link != len(chain.link_names) else {})


def _parent_hinges(chain: Chain) -> list[int]:
    """Return for every body the last hinge of its parent body, −1 for the base."""
    return [int(stop) - 1 for stop in np.append(0, chain.bodies["stop"])[chain.bodies["parent"]]]


def custom_values(chain: Chain, k: int, standard: Iterable[str]) -> dict[str, str]:
    """Return custom attributes of a joint: its coordinate, and all fields that have no `standard` element."""
    hinge = chain.hinges[k]
    numbers = {name: decimals([hinge[name]]) for name in chain.hinges.dtype.names or () if name not in standard}
    return numbers | {"coordinate": " ".join(map(str, chain.coordinates[k]))}


def couplings(chain: Chain, joints: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield custom attributes of the springs between two hinges, with the names of their joints."""
    for i, j, k, d in chain.couplings.tolist():
        yield {"inner": joints[i], "outer": joints[j], "stiffness": decimals([k]), "damping": decimals([d])}


def rotation_springs(chain: Chain) -> dict[str, str]:
    """List the rotation-vector springs as pairs "first of three hinges:kind"; `BODY` defines the kinds."""
    triples = chain.bodies[chain.bodies["springs"] != 0]
    pairs = " ".join(f"{first}:{kind}" for first, kind in zip(triples["first"], triples["springs"], strict=True))
    return {ROTATION_SPRINGS: pairs} if pairs else {}


def limits(hinge: np.void) -> dict[str, str]:
    """Return the finite limits of a hinge [rad, m], by name."""
    return {name: decimals([hinge[name]]) for name in ("lower", "upper") if np.isfinite(hinge[name])}


def axis_text(hinge: np.void) -> str:
    """Return the axis about which a hinge turns, or along which it slides."""
    return decimals(np.eye(3)[hinge["axis"] % SLIDES])


def moments_text(body: np.void) -> dict[str, str]:
    """Return moments and products of inertia of a body, by name."""
    return {name: decimals([body["inertia"][place]]) for name, place in UPPER_TRIANGLE.items()}


def exact_rotation(rotation: Array) -> dict[str, str]:
    """Return R row by row, because angles or a quaternion would round it; empty for the identity."""
    return {} if np.array_equal(rotation, np.eye(3)) else {"rotation": decimals(rotation.flat)}


def names_text(names: Iterable[str]) -> str:
    """Return the names of all links of the arm, including those without a hinge, or of their joints, as a JSON list."""
    return json.dumps([valid(name) for name in names], ensure_ascii=False)


def valid(name: str) -> str:
    """Replace every character of `name` that XML 1.0 cannot represent, even escaped, by U+FFFD."""
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", name)


def xml_joint_names(chain: Chain) -> list[str]:
    """Return one name per coordinate, in sequential order; Pinocchio reserves "universe"."""
    refuse_shapes(require_type("chain", chain, Chain), "an export")
    return unique(["universe", *map(valid, chain.joint_names)])[1:]


def xml_link_names(chain: Chain) -> list[str]:
    """Names of the base, of the frame that each coordinate moves (six move a floating base), and of the tips."""
    own, moved = base_joints(chain), moved_links(chain, xml_joint_names(chain))
    base, tip, *names = unique(["base_link", "tip", *moved, *other_ends(chain, moved)])
    return [base] * (1 + own) + names + [tip]


def body_names(chain: Chain) -> list[str]:
    """Return names of the frames of all bodies: of the last coordinate of each, or of a tip."""
    links, ends = xml_link_names(chain), dict(zip(chain.tips.values(), tips(chain), strict=True))
    return [ends[k].name if k in ends else links[body["stop"]] for k, body in enumerate(chain.bodies)]


def moved_links(chain: Chain, joints: Sequence[str]) -> list[str]:
    """Return names of the frames that `joints` move, without a floating base: links of joints with separate names."""
    named = [own != link for own, link in zip(chain.joints_of_links, chain.link_names, strict=True)]
    pairs = list(zip(chain.coordinates, joints, strict=True))[base_joints(chain) :]
    own = (chain.link_names[c.link - 1] if c.kind is Kind.JOINT and named[c.link - 1] else "" for c, _ in pairs)
    return [valid(link) or f"{joint}_link" for link, (_, joint) in zip(own, pairs, strict=True)]


def other_ends(chain: Chain, moved: Sequence[str]) -> list[str]:
    """Return names of all tips but the arm's: their links' names, with "_tip" where a moved frame has this name."""
    return [f"{name}_tip" if name in moved else name for name in map(valid, [*chain.tips][:-1])]


def decimals(values: Iterable[float]) -> str:
    """Return the shortest decimals that read back to the same float64; + 0.0 turns −0.0 into 0.0."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def text(root: ET.Element) -> str:
    """Return the document as indented UTF-8 XML with its declaration."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


# Draw a chain as capsules without mass or contact: one along each rigid segment, coloured by link.
#
# A chain has no cross-sections. A capsule gets the radius of a solid cylinder that has the segment's inertia about its
# axis, r = √(2 I / m), limited to a visible fraction of the arm's length.


THICKNESS = 0.004, 0.04  # smallest and largest radius as fractions of the arm's length
COLOURS = (
    (0.00, 0.45, 0.70), (0.90, 0.62, 0.00), (0.00, 0.62, 0.45), (0.80, 0.47, 0.65),
    (0.34, 0.71, 0.91), (0.84, 0.37, 0.00), (0.94, 0.89, 0.26), (0.45, 0.45, 0.45),
)  # fmt: skip
"""Colour-blind-safe palette of Okabe and Ito; the links use its colours in turn."""


class Capsule(NamedTuple):
    """A capsule from the origin of a body to the origin of the next body."""

    end: Array  # far end in the body's frame [m]
    radius: float  # [m]
    colour: tuple[str, str]  # name of the colour; red, green, blue and opacity

    @property
    def length(self) -> float:
        """Distance between the centres of the two end caps [m]."""
        return math.sqrt(dot(self.end, self.end))

    @property
    def pose(self) -> tuple[float, ...]:
        """Pose (x, y, z, roll, pitch, yaw) of the capsule's midpoint, with local Z along the capsule."""
        x, y, z = map(float, self.end)
        return x / 2, y / 2, z / 2, 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def capsules(chain: Chain) -> Iterator[Capsule | None]:
    """Yield, for every body attached to another, the capsule from parent to body; None if their origins coincide."""
    of_link = colours(chain)
    hanging = chain.bodies[chain.bodies["parent"] > 0]
    ends = hanging["translation"]
    lengths = np.linalg.norm(ends, axis=1)
    shortest, thinnest, thickest = (share * float(lengths.sum()) for share in (1e-9, *THICKNESS))
    for body, end, length in zip(chain.bodies[hanging["parent"] - 1], ends, lengths, strict=True):
        if length <= shortest:  # the length is only a rounding error; MuJoCo refuses such capsules
            yield None
            continue
        along = dot(end, product(body["inertia"], end)) / length**2
        radius = math.sqrt(2 * along / body["mass"]) if body["mass"] > 0 else 0.0
        yield Capsule(end, min(max(radius, thinnest), thickest), of_link[chain.coordinates[body["first"]].link - 1])


def capsules_behind(chain: Chain) -> dict[int, list[Capsule]]:
    """Return the capsules of each joint; a body's capsules belong to its last hinge."""
    parents = chain.bodies["parent"][chain.bodies["parent"] > 0]
    found = dict[int, list[Capsule]]()
    for k, capsule in zip((chain.bodies["stop"][parents - 1] - 1).tolist(), capsules(chain), strict=True):
        if capsule is not None:
            found.setdefault(k, []).append(capsule)
    return found


def colours(chain: Chain) -> list[tuple[str, str]]:
    """Return for every link its name, and red, green, blue and opacity."""
    names = unique(map(valid, chain.link_names))
    return [(name, decimals([*COLOURS[number % len(COLOURS)], 1.0])) for number, name in enumerate(names)]
