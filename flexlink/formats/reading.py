"""Common parts of the readers: strict numbers, a chain from its hinges, and a check that nothing is ignored.

The readers read files of our writers, whose numbers may have been edited. The chain that was read is written again, and
whatever differs from the file, up to rounding, is refused by name: an unknown element, another structure, a rotation
that contradicts the exact one next to it.
"""

from __future__ import annotations

import dataclasses
import heapq
import itertools
import json
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexlink.chain import free_base
from flexlink.chain.builder import Body, recorded
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import LAG, Coordinate
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia
from flexlink.common.errors import DataFileError, FlexlinkError
from flexlink.common.safe_xml import numbers_of, parse
from flexlink.common.types import Array
from flexlink.describe.arm import BASE
from flexlink.formats.document import ROTATION_SPRINGS, UPPER_TRIANGLE, WIDE
from flexlink.kernels.layout import COUPLING, HINGE, SPRINGS

ROUNDING = 1e-14  # of angles and quaternions, which depends on the machine's mathematical library
Mass = tuple[float, Array, Array]
"""Mass, centre and inertia."""


@dataclasses.dataclass(frozen=True)
class Node:
    """An element with its location for messages: the file and the last two elements of its path."""

    element: ET.Element
    what: str
    path: tuple[str, ...] = ()

    def error(self, message: str) -> DataFileError:
        """An error with the location."""
        return DataFileError(f"{': '.join([self.what, *self.path])}: {message}")

    def into(self, element: ET.Element) -> Node:
        """A child of this element."""
        return Node(element, self.what, (*self.path, _label(element))[-2:])

    def all(self, path: str) -> list[Node]:
        """The elements of a path, in document order."""
        return [self.into(one) for one in self.element.findall(path)]

    def one(self, path: str) -> Node:
        """The first element of a path, which must be there."""
        found = self.element.find(path)
        if found is None:
            raise self.error(f"<{path}> is missing: not a file that flexlink has written")
        return self.into(found)

    def attribute(self, key: str) -> str:
        """The text of an attribute, which must be there."""
        value = self.element.get(key)
        if value is None:
            raise self.error(f"attribute {_plain(key)} is missing")
        return value

    def numbers(self, count: int, key: str | None = None) -> list[float]:
        """The numbers of an attribute, or of the element's text."""
        text = (self.element.text or "") if key is None else self.attribute(key)
        values = numbers_of(text)
        if values is None or len(values) != count or not np.isfinite(values).all():
            shown = f"{text[:60]!r}" if key is None else f"{_plain(key)} = {text[:60]!r}"
            raise self.error(f"{shown}: expected {count} finite number{'s' * (count > 1)}")
        return values

    def number(self, key: str | None = None) -> float:
        """One number, as in `numbers`."""
        return self.numbers(1, key)[0]

    def rotation(self, key: str) -> Array:
        """R, row by row, in an attribute of our own; without it the identity."""
        return np.eye(3) if self.element.get(key) is None else self.rotation_matrix(self.numbers(9, key))

    def rotation_matrix(self, values: Sequence[float]) -> Array:
        """R of its nine elements; they must be a rotation, since angles alone would not show a stretch."""
        R = np.reshape(values, (3, 3))
        tolerance = 1e-13  # of a product of a hundred rotations
        if np.abs(R @ R.T - np.eye(3)).max() > tolerance or np.linalg.det(R) < 0:
            raise self.error(f"{list(values)}: not a rotation matrix")
        return R

    def unit_axis(self, values: Sequence[float]) -> int:
        """0, 1, 2 for X, Y, Z."""
        for axis, unit in enumerate(np.eye(3).tolist()):
            if list(values) == unit:
                return axis
        raise self.error(f"axis {values}: expected X, Y or Z")

    def links(self, key: str) -> tuple[str, ...]:
        """The names of the arm's links, as `document.links_text` writes them."""
        try:
            names = json.loads(self.attribute(key))
        except (ValueError, RecursionError):
            names = None
        if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
            raise self.error(f"{_plain(key)} = {self.attribute(key)[:60]!r}: expected a JSON list of names")
        return tuple(names)


class Hinge(NamedTuple):
    """A hinge of a file, and its body."""

    node: Node
    parent: str  # name of the joint that it hangs on; "" the base
    translation: Array
    rotation: Array
    numbers: dict[str, float]  # the fields of HINGE
    coordinate: Coordinate
    body: Mass | None  # None: no body

    def follows(self, before: Hinge) -> bool:
        """Whether it moves the same body as the hinge before it."""
        here, there = self.coordinate, before.coordinate  # springs at a root move a body of their own
        return before.body is None and here[:2] == there[:2] and here.of_root == there.of_root


class End(NamedTuple):
    """A tip frame of a file."""

    node: Node
    link: int  # number, from 1, of the link that ends there
    parent: str  # as of a hinge
    translation: Array
    rotation: Array


class Tree(NamedTuple):
    """What a file says of the base and the branches."""

    ends: list[End]
    loaded: int  # number of the link at whose end the wrench acts
    base: Array | None = None  # rotation of a free base
    body: Mass | None = None  # and its mass


def tree_of(own: Node, ends: list[End], links: Sequence[str], body: Mass | None, prefix: str = "") -> Tree:
    """The same from the attributes of our own, `document.tree_said`."""
    base = f"{prefix}{BASE}"
    rotation = None if own.element.get(base) is None else own.rotation(base)
    return Tree(ends, link_of(own, f"{prefix}loaded", links), rotation, body)


def link_of(node: Node, key: str, links: Sequence[str]) -> int:
    """Number of a link that an attribute says; without it that of the last."""
    if node.element.get(key) is None:
        return len(links)
    number = node.number(key)
    if number not in range(1, len(links) + 1):
        raise node.error(f"{_plain(key)} = {number:g}: expected a link, 1 … {len(links)}")
    return int(number)


class Coupled(NamedTuple):
    """A spring and a damper between two joints of a file: its names of them, K_ij and D_ij."""

    node: Node
    inner: str
    outer: str
    stiffness: float
    damping: float


def coupling_of(node: Node) -> Coupled:
    """What an element of our own says, as `document.couplings` writes it."""
    ends = node.attribute("inner"), node.attribute("outer")
    return Coupled(node, *ends, node.number("stiffness"), node.number("damping"))


def coordinate(node: Node, numbers: Sequence[float], links: Sequence[str]) -> Coordinate:
    """The three indices of a hinge."""
    link, segment, axis = (int(number) if number == int(number) else -1 for number in numbers)
    if not (1 <= link <= len(links) and segment >= 0 and 0 <= axis < LAG):
        raise node.error(f"coordinate {list(numbers)}: expected link 1 … {len(links)}, segment, axis 0 … {LAG - 1}")
    return Coordinate(link, segment, axis)


def limits_of(lower: float, upper: float) -> dict[str, float]:
    """Limits of a hinge, infinite where the writer had to write some."""
    least, most = map(float, WIDE.values())
    return {"lower": -np.inf if lower == least else lower, "upper": np.inf if upper == most else upper}


def inertia_matrix(moments: Sequence[float]) -> Array:
    """Symmetric, from its upper triangle in the order of `UPPER_TRIANGLE`."""
    I = np.zeros((3, 3))
    for (row, column), moment in zip(UPPER_TRIANGLE.values(), moments, strict=True):
        I[row, column] = I[column, row] = moment
    return I


def chain_of(
    root: Node, name: str, gravity: Sequence[float], links: tuple[str, ...], hinges: Sequence[Hinge],
    tree: Tree, coupled: Iterable[Coupled] = (), own: Node | None = None, key: str = ROTATION_SPRINGS,
) -> Chain:  # fmt: skip
    """The chain of the hinges, without those of a free base, of base and tip frames, and of springs between hinges.

    Attribute `key` of `own`, if it is there, says whose springs hold rotation vectors (`document.rotation_springs`).

    Raises
    ------
    DataFileError
        There is no hinge or no tip, two hinges have the same coordinate, a hinge or tip hangs on none before it, a
        mass, moment, spring or damper is negative, or springs between hinges are stiffer than those of the hinges.
    """
    if not hinges and tree.base is None:
        raise root.error("no movable joint")
    for hinge in hinges:
        _require_sound(hinge)
    base = _base_hinges() if tree.base is not None else np.zeros(0, HINGE)
    coordinates = tuple(Coordinate(0, 0, k) for k in range(1, len(base) + 1)) + tuple(h.coordinate for h in hinges)
    if len(set(coordinates)) < len(coordinates):
        raise root.error("two joints have the same coordinate")
    bodies, ends = _bodies(tree, hinges)
    if len(links) not in ends:
        raise root.error("the tip frame of the arm is missing: not a file that flexlink has written")
    records = recorded(bodies)
    if len(base):
        records["turned"][1] = 1  # whatever its attitude is
    records["loaded"][ends.get(tree.loaded, -1)] = 1
    numbers = [tuple(hinge.numbers[field] for field in HINGE.names or ()) for hinge in hinges]
    if own is not None and own.element.get(key):
        axes = [*base["axis"].tolist(), *(int(hinge.numbers["axis"]) for hinge in hinges)]
        _put_rotation_springs(own, key, records, axes)
    return Chain(
        name=name,
        bodies=records,
        hinges=np.append(base, np.array(numbers, dtype=HINGE)),
        gravity=np.array(gravity),
        coordinates=coordinates,
        link_names=links,
        couplings=_couplings(coupled, hinges, len(base)),
        tips={links[link - 1]: number for link, number in ends.items()},
    )


def _base_hinges() -> NDArray[np.void]:
    """Those of a free base, without springs, friction and limits."""
    hinges = np.zeros(free_base.JOINTS, HINGE)
    hinges["axis"], hinges["coulomb_width"] = free_base.AXES, 1.0
    hinges["lower"], hinges["upper"] = -np.inf, np.inf
    return hinges


class _Item(NamedTuple):
    """A body to be, in the order of links, tips last."""

    rank: tuple[int, int]
    first: Hinge | End
    group: Sequence[Hinge]  # its hinges; none of a tip


def _bodies(tree: Tree, hinges: Sequence[Hinge]) -> tuple[list[Body], dict[int, int]]:
    """The bodies, those of a link before its tip, and the numbers of tips, from 0, by that of the link."""
    bodies, on, ends = list[Body](), {"": 0}, dict[int, int]()
    if tree.base is not None:
        half = free_base.JOINTS // 2
        bodies = [Body(HERE, 0, half), Body(Pose(tree.base, np.zeros(3)), half, 2 * half, 1, _rigid(tree.body))]
        on[""] = len(bodies)
    stop = bodies[-1].stop if bodies else 0
    begins = [k for k in range(len(hinges)) if k == 0 or not hinges[k].follows(hinges[k - 1])]
    groups = [hinges[k:end] for k, end in itertools.pairwise([*begins, len(hinges)])]
    tips = sorted(tree.ends, key=lambda tip: tip.link)
    moving = [_Item((group[0].coordinate.link, 0), group[0], group) for group in groups]
    for (link, _), first, group in heapq.merge(
        moving, [_Item((tip.link, 1), tip, []) for tip in tips], key=lambda item: item.rank
    ):
        if first.parent not in on:
            raise first.node.error(f"hangs on {first.parent[:60]!r}, which is no joint before it")
        body = Body(Pose(first.rotation, first.translation), stop, stop, on[first.parent])
        bodies.append(body)
        if not group and link in ends:
            raise first.node.error(f"another tip of link {link}: not a file that flexlink has written")
        if not group:
            ends[link] = len(bodies) - 1
            continue
        stop += len(group)
        body.stop, body.rigid = stop, _rigid(group[-1].body)
        on[group[-1].node.attribute("name")] = len(bodies)
    return bodies, ends


def _rigid(body: Mass | None) -> SpatialInertia:
    return NOTHING if body is None else SpatialInertia(*body)


def _couplings(coupled: Iterable[Coupled], hinges: Sequence[Hinge], before: int) -> NDArray[np.void]:
    """Records of dtype `COUPLING`; what a file says of the same two joints at several places is added."""
    number = {hinge.node.attribute("name"): k for k, hinge in enumerate(hinges)}
    found: dict[tuple[int, int], tuple[float, float]] = {}
    for one in coupled:
        for name in (one.inner, one.outer):
            if name not in number:
                raise one.node.error(f"joint {name[:60]!r}: no such joint")
        i, j = number[one.inner], number[one.outer]
        pair = before + i, before + j
        if i >= j:
            raise one.node.error(f"joint {one.outer[:60]!r} must follow {one.inner[:60]!r}")
        k, d = found.get(pair, (0.0, 0.0))
        found[pair] = constants = k + one.stiffness, d + one.damping
        for field, value in zip(("stiffness", "damping"), constants, strict=True):
            most = math.sqrt(hinges[i].numbers[field]) * math.sqrt(hinges[j].numbers[field])
            if abs(value) > most * (1 + ROUNDING):
                raise one.node.error(
                    f"{field} = {value!r} between joints {one.inner[:60]!r} and {one.outer[:60]!r}: must not exceed "
                    f"{most!r}, the geometric mean of theirs"
                )
    return np.array([(*pair, *constants) for pair, constants in found.items()], dtype=COUPLING)


def _put_rotation_springs(own: Node, key: str, bodies: NDArray[np.void], axes: Sequence[int]) -> None:
    """Write what springs hold into the bodies, whose hinges turn about `axes`."""
    first = {int(body["first"]): k for k, body in enumerate(bodies[:-1])}
    for pair in own.attribute(key).split():
        begin, _, kind = pair.partition(":")
        k = first.get(int(begin) if begin.isdecimal() else -1, -1)
        turns = axes[bodies["first"][k] : bodies["stop"][k]] if k >= 0 else []
        if turns not in ([0, 1, 2], [2, 1, 0]) or kind not in {"1", "2"}:
            raise own.error(f"{pair[:60]!r}: expected the first of three joints about X, Y, Z or Z, Y, X, and 1 or 2")
        bodies["springs"][k] = int(kind)
    leads = np.flatnonzero(bodies["springs"] == SPRINGS.cell)
    if (bodies["springs"][leads + 1] != SPRINGS.rotation).any():
        raise own.error(f"{own.attribute(key)[:60]!r}: after three joints with 2 must come three with 1")


def _require_sound(hinge: Hinge) -> None:
    """Refuse invalid numbers; others are refused by the algorithms that need them."""
    for key in ("stiffness", "damping", "coulomb"):
        if hinge.numbers[key] < 0:
            raise hinge.node.error(f"{key} = {hinge.numbers[key]!r}: must not be negative")
    if hinge.numbers["coulomb_width"] <= 0:
        raise hinge.node.error(f"coulomb_width = {hinge.numbers['coulomb_width']!r}: must be > 0")
    if not hinge.numbers["lower"] <= hinge.numbers["upper"]:
        raise hinge.node.error(
            f"limits {hinge.numbers['lower']!r} … {hinge.numbers['upper']!r}: lower must not exceed upper"
        )
    if hinge.numbers["prescribed"] not in {0, 1}:
        raise hinge.node.error(f"prescribed = {hinge.numbers['prescribed']!r}: must be 0 or 1")
    if hinge.body is not None and (hinge.body[0] < 0 or np.linalg.eigvalsh(hinge.body[2])[0] < -ROUNDING):
        raise hinge.node.error(f"mass {hinge.body[0]!r} or a moment of inertia behind it is negative")


def read(
    text: str | bytes, what: str, *, tag: str, to_chain: Callable[[Node], Chain], write: Callable[..., str],
    ignored: frozenset[str],
) -> Chain:  # fmt: skip
    """Parse, build the chain, write it again, compare.

    `ignored` are elements and attributes, as "element.attribute", that do not belong to the chain.
    """
    root = Node(parse(text, what), what)
    if root.element.tag != tag:
        raise root.error(f"<{root.element.tag[:60]}>: expected <{tag}>")
    try:
        chain = to_chain(root)
        again = parse(write(chain, shapes=False), what)
    except DataFileError:
        raise
    except FlexlinkError as error:  # the writer refuses the chain
        raise root.error(str(error)) from None
    _require_same(root, again, ignored)
    return chain


def _require_same(node: Node, again: ET.Element, ignored: frozenset[str]) -> None:
    """Refuse the first difference of a file from the one that we would write."""
    element = node.element
    for key in {**again.attrib, **element.attrib}:
        if f"{element.tag}.{key}" not in ignored:
            _require_equal(node, f"{_plain(key)} = ", element.get(key), again.get(key))
    if not len(again):
        _require_equal(node, "", (element.text or "").strip(), (again.text or "").strip())
    pairs = itertools.zip_longest(*([one for one in parent if one.tag not in ignored] for parent in (element, again)))
    for one, other in pairs:
        if one is None or other is None or one.tag != other.tag:
            actual, expected = ("nothing more" if each is None else _label(each) for each in (one, other))
            raise node.error(f"{actual} where flexlink writes {expected}: not a file that flexlink has written")
        _require_same(node.into(one), other, ignored)


def _require_equal(node: Node, key: str, actual: str | None, expected: str | None) -> None:
    if actual == expected:
        return
    one, other = (np.array(numbers_of(text or "") or [np.nan]) for text in (actual, expected))
    if one.shape == other.shape and (abs(one - other) <= ROUNDING * (1 + abs(other))).all():
        return
    here, written = ("nothing" if text is None else repr(text[:60]) for text in (actual, expected))
    raise node.error(f"{key}{here} where flexlink writes {written}: it contradicts another number, or is unknown")


def _plain(name: str) -> str:
    """A name without its namespace."""
    return name.rpartition("}")[2]


def _label(element: ET.Element) -> str:
    name = element.get("name")
    return f"<{_plain(element.tag)[:60]}{'' if name is None else f' name={name[:60]!r}'}>"
