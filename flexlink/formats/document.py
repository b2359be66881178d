"""Common parts of the writers: joints one by one, valid and unique names, numbers that read back exactly."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain import free_base
from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.common.types import Array
from flexlink.describe.arm import BASE

UPPER_TRIANGLE = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
ROTATION_SPRINGS = "rotation_springs"
"""Attribute of our own of a file with such springs."""
WIDE = {"lower": "-1e9", "upper": "1e9"}
"""Limits [rad, m] of a joint without limits, in formats that require some."""


class Place(NamedTuple):
    """A hinge in formats with one link per joint: its placement on the link of the hinge that it hangs on."""

    k: int
    parent: int  # the hinge that it hangs on; −1: the base
    translation: Array  # of the hinge's frame in the frame before it [m]
    rotation: Array  # R: v_before = R v, at zero
    body: np.void | None  # rigidly attached behind the hinge; None: no inertia


def places(chain: Chain) -> Iterator[Place]:
    """The hinges in sequential order, those of a free base included; of several at one point only the last has a body.

    A free base's last hinge is what others hang on.
    """
    for body, on in zip(chain.bodies, _hung_on(chain), strict=True):
        parent, translation, rotation = on, body["translation"], body["rotation"]
        for k in range(body["first"], body["stop"]):
            last = k == body["stop"] - 1 and (body["mass"] or body["inertia"].any())
            yield Place(k, parent, translation, rotation, body if last else None)
            translation, rotation, parent = np.zeros(3), np.eye(3), k


def joint_places(chain: Chain) -> Iterator[Place]:
    """The same without those of a free base, which formats have other elements for."""
    return (place for place in places(chain) if place.k >= base_joints(chain))


class Tip(NamedTuple):
    """A tip frame."""

    name: str  # in files
    link: int  # number, from 1, of the link that it is the end of
    parent: int  # as in `Place`
    translation: Array
    rotation: Array


def tips(chain: Chain) -> list[Tip]:
    """The tip frames in the order of the bodies, so that of the arm is the last."""
    parents, found = _hung_on(chain), []
    names = xml_link_names(chain)[chain.n + 1 :]
    for name, (link, number) in zip(names, chain.tips.items(), strict=True):
        body = chain.bodies[number]
        place = body["translation"], body["rotation"]
        found.append(Tip(name, chain.link_names.index(link) + 1, parents[number], *place))
    return found


def loaded_tip(chain: Chain) -> Tip:
    """The one at which the wrench acts."""
    bodies = [number for number in chain.tips.values() if chain.bodies["loaded"][number]]
    return tips(chain)[[*chain.tips.values()].index(bodies[0]) if bodies else -1]


def base_joints(chain: Chain) -> int:
    """How many of the first joints are those of a free base."""
    return free_base.JOINTS if chain.has_free_base else 0


def tree_said(chain: Chain) -> dict[str, str]:
    """Attributes of our own: the rotation of a free base at angles of zero, row by row; the link where a wrench acts.

    Nothing of an arm that stands on the ground, and whose wrench acts at its last link.
    """
    said, tip = {}, loaded_tip(chain)
    if chain.has_free_base:
        said[BASE] = decimals(chain.bodies["rotation"][1].flat)
    return said | ({"loaded": str(tip.link)} if tip.link != len(chain.link_names) else {})


def _hung_on(chain: Chain) -> list[int]:
    """Of every body the last hinge of the one that it hangs on, −1 for the base."""
    stops = np.append(0, chain.bodies["stop"])
    return [int(stop) - 1 for stop in stops[chain.bodies["parent"]]]


def own_values(chain: Chain, k: int, standard: Iterable[str]) -> dict[str, str]:
    """Attributes of our own element of a joint: its coordinate, and the fields without a `standard` element."""
    hinge = chain.hinges[k]
    numbers = {name: decimals([hinge[name]]) for name in chain.hinges.dtype.names or () if name not in standard}
    return numbers | {"coordinate": " ".join(map(str, chain.coordinates[k]))}


def couplings(chain: Chain, joints: Sequence[str]) -> Iterator[dict[str, str]]:
    """Attributes of our own element of a spring between two hinges, by the names of their joints."""
    for i, j, k, d in chain.couplings.tolist():
        yield {"inner": joints[i], "outer": joints[j], "stiffness": decimals([k]), "damping": decimals([d])}


def rotation_springs(chain: Chain) -> dict[str, str]:
    """Which hinges' springs hold rotation vectors, by the number of the first of three and the kind, as in `BODY`."""
    triples = chain.bodies[chain.bodies["springs"] != 0]
    said = " ".join(f"{first}:{kind}" for first, kind in zip(triples["first"], triples["springs"], strict=True))
    return {ROTATION_SPRINGS: said} if said else {}


def limits(hinge: np.void) -> dict[str, str]:
    """The finite limits of a hinge [rad, m], by name."""
    return {name: decimals([hinge[name]]) for name in ("lower", "upper") if np.isfinite(hinge[name])}


def own_rotation(rotation: Array) -> dict[str, str]:
    """R, row by row, which angles or a quaternion would round."""
    return {} if np.array_equal(rotation, np.eye(3)) else {"rotation": decimals(rotation.flat)}


def links_text(chain: Chain) -> str:
    """The names of all links of the arm, also of those without a hinge, as a JSON list."""
    return json.dumps([valid(name) for name in chain.link_names], ensure_ascii=False)


def valid(name: str) -> str:
    """`name` with U+FFFD for every character that XML 1.0 cannot represent, not even escaped."""
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", name)


def xml_joint_names(chain: Chain) -> list[str]:
    """One name per coordinate, in sequential order; Pinocchio reserves "universe"."""
    require_type("chain", chain, Chain)
    return unique(["universe", *map(valid, chain.joint_names)])[1:]


def xml_link_names(chain: Chain) -> list[str]:
    """Names of the base, of the frame behind each coordinate, and of the tips, that of the arm last: n + 1 and theirs.

    Behind all coordinates of a free base is the base.
    """
    own, others = base_joints(chain), [valid(name) for name in chain.tips][:-1]
    behind = (f"{name}_link" for name in xml_joint_names(chain)[own:])
    base, *names = unique(["base_link", *behind, "tip", *others])
    n = chain.n - own
    return [base] * (1 + own) + names[:n] + names[n + 1 :] + names[n : n + 1]


def decimals(values: Iterable[float]) -> str:
    """Shortest decimals that read back to the same float64; + 0.0 turns −0.0 into 0.0."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def text(root: ET.Element) -> str:
    """The document as indented UTF-8 XML, declaration included."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
