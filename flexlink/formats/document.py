"""Common parts of the writers: joints one by one, valid and unique names, numbers that read back exactly."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain, unique
from flexlink.common.types import Array

UPPER_TRIANGLE = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
ROTATION_SPRINGS = "rotation_springs"
"""Attribute of our own of a file with such springs."""
WIDE = {"lower": "-1e9", "upper": "1e9"}
"""Limits [rad] of a joint without limits, in formats that require some."""


class Place(NamedTuple):
    """A hinge in formats with one link per joint: its placement on the link of the hinge before."""

    k: int
    translation: Array  # of the hinge's frame in the frame before it [m]
    rotation: Array  # R: v_before = R v, at zero angle
    body: np.void | None  # rigidly attached behind the hinge; None: no inertia


def places(chain: Chain) -> Iterator[Place]:
    """The hinges in sequential order; of several at one point only the last has a body."""
    for body in chain.bodies[:-1]:
        translation, rotation = body["translation"], body["rotation"]
        for k in range(body["first"], body["stop"]):
            last = k == body["stop"] - 1 and (body["mass"] or body["inertia"].any())
            yield Place(k, translation, rotation, body if last else None)
            translation, rotation = np.zeros(3), np.eye(3)


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
    """The finite limits of a hinge [rad], by name."""
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
    """Names of the base, of the frame behind each coordinate, and of the tip: n + 2 of them."""
    return unique(["base_link", *(f"{name}_link" for name in xml_joint_names(chain)), "tip"])


def decimals(values: Iterable[float]) -> str:
    """Shortest decimals that read back to the same float64; + 0.0 turns −0.0 into 0.0."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def text(root: ET.Element) -> str:
    """The document as indented UTF-8 XML, declaration included."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
