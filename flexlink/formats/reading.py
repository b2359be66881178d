"""Build a chain from the hinges, tip frames and springs in a file that flexlink has written, which is read strictly.

Its numbers may have been edited. The chain that was read is written again. Any difference from the file beyond rounding
is an error that names the difference, such as an unknown element, another structure, or a rotation that contradicts the
exact rotation next to it.
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

from flexlink.chain.builder import Body, recorded
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import BASE_AXES, BASE_JOINTS, KINDS, Coordinate, Kind
from flexlink.chain.odd_bodies import negative_inertia
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia
from flexlink.common.errors import DataFileError, FlexlinkError
from flexlink.common.safe_xml import numbers_of, parse
from flexlink.common.types import Array
from flexlink.describe.arm import BASE
from flexlink.formats.document import ROTATION_SPRINGS, UPPER_TRIANGLE
from flexlink.kernels.layout import COUPLING, HINGE, SLIDES, SPRINGS

ROUNDING = 1e-14  # rounding error of angles and quaternions, which depends on the machine's mathematical library


@dataclasses.dataclass(frozen=True)
class Node:
    """An XML element with its location for messages: the file and the last two elements of its path."""

    element: ET.Element
    what: str
    path: tuple[str, ...] = ()

    def error(self, message: str) -> DataFileError:
        """Return an error whose message names this element's location."""
        return DataFileError(f"{': '.join([self.what, *self.path])}: {message}", id="file-content")

    def into(self, element: ET.Element) -> Node:
        """Return the node of a child element."""
        return Node(element, self.what, (*self.path, _label(element))[-2:])

    def all(self, path: str) -> list[Node]:
        """Return the elements of a path in document order."""
        return [self.into(one) for one in self.element.findall(path)]

    def one(self, path: str) -> Node:
        """Return the first element of a path, or raise an error if there is none."""
        found = self.element.find(path)
        if found is None:
            raise self.error(f"<{path}> is missing: not a file written by flexlink")
        return self.into(found)

    def attribute(self, key: str) -> str:
        """Return the text of an attribute, or raise an error if there is none."""
        value = self.element.get(key)
        if value is None:
            raise self.error(f"attribute {plain(key)} is missing")
        return value

    def numbers(self, count: int, key: str | None = None) -> list[float]:
        """Return the numbers in an attribute or in the element's text."""
        text = (self.element.text or "") if key is None else self.attribute(key)
        values = numbers_of(text)
        if values is None or len(values) != count or not np.isfinite(values).all():
            shown = f"{text[:60]!r}" if key is None else f"{plain(key)} = {text[:60]!r}"
            raise self.error(f"{shown}: expected {count} finite number{'s' * (count > 1)}")
        return values

    def number(self, key: str | None = None) -> float:
        """Return one number from an attribute or from the element's text."""
        return self.numbers(1, key)[0]

    def rotation(self, key: str) -> Array:
        """Return R, row by row, from a custom attribute, a rotation without stretching; by default the identity."""
        if self.element.get(key) is None:
            return np.eye(3)
        values = self.numbers(9, key)
        R = np.reshape(values, (3, 3))
        tolerance = 1e-13  # rounding error of a product of a hundred rotations
        if np.abs(R @ R.T - np.eye(3)).max() > tolerance or np.linalg.det(R) < 0:
            raise self.error(f"{list(values)}: not a rotation matrix")
        return R

    def unit_axis(self, values: Sequence[float], kind: str) -> int:
        """Return the axis of a joint of this type as in `HINGE`: X, Y or Z."""
        for axis, unit in enumerate(np.eye(3).tolist()):
            if list(values) == unit:
                return axis + SLIDES * (kind == "prismatic")
        raise self.error(f"axis {values}: expected X, Y or Z")

    def names(self, key: str) -> tuple[str, ...]:
        """Return the names of the arm's links or of their joints, written by `document.names_text`."""
        try:
            names = json.loads(self.attribute(key))
        except (ValueError, RecursionError):
            names = None
        if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
            raise self.error(f"{plain(key)} = {self.attribute(key)[:60]!r}: expected a JSON list of names")
        return tuple(names)


def read(
    text: str | bytes, what: str, *, tag: str, to_chain: Callable[[Node], Chain], write: Callable[..., str],
    ignored: frozenset[str],
) -> Chain:  # fmt: skip
    """Parse the text, build the chain, write it again and compare; `ignored`: what is not part of the chain."""
    root = Node(parse(text, what), what)
    if root.element.tag != tag:
        raise root.error(f"<{root.element.tag[:60]}>: expected <{tag}>")
    try:
        chain = to_chain(root)
        again = parse(write(chain, shapes=False), what)
    except DataFileError:
        raise
    except FlexlinkError as error:  # `to_chain` or `write` refuses the chain
        raise root.error(str(error)) from None
    _require_same(root, again, ignored)
    return chain


def _require_same(node: Node, again: ET.Element, ignored: frozenset[str]) -> None:
    """Raise an error at the first difference between a file and the file that flexlink would write."""
    element = node.element
    for key in {**again.attrib, **element.attrib}:
        if f"{element.tag}.{key}" not in ignored:
            _require_equal(node, f"{plain(key)} = ", element.get(key), again.get(key))
    if not len(again):
        _require_equal(node, "", (element.text or "").strip(), (again.text or "").strip())
    pairs = itertools.zip_longest(*([one for one in parent if one.tag not in ignored] for parent in (element, again)))
    for one, other in pairs:
        if one is None or other is None or one.tag != other.tag:
            actual, expected = ("nothing more" if each is None else _label(each) for each in (one, other))
            raise node.error(f"{actual} where flexlink writes {expected}: not a file written by flexlink")
        _require_same(node.into(one), other, ignored)


def _require_equal(node: Node, key: str, actual: str | None, expected: str | None) -> None:
    if actual == expected:
        return
    one, other = (np.array(numbers_of(text or "") or [np.nan]) for text in (actual, expected))
    if one.shape == other.shape and (abs(one - other) <= ROUNDING * (1 + abs(other))).all():
        return
    here, written = ("nothing" if text is None else repr(text[:60]) for text in (actual, expected))
    raise node.error(f"{key}{here}, but a file by flexlink has {written}: not supported, or contradicts another number")


def plain(name: str) -> str:
    """Return a name without its namespace."""
    return name.rpartition("}")[2]


def _label(element: ET.Element) -> str:
    name = element.get("name")
    return f"<{plain(element.tag)[:60]}{'' if name is None else f' name={name[:60]!r}'}>"


Mass = tuple[float, Array, Array]  # mass [kg], centre [m] and inertia [kg m²]


class Hinge(NamedTuple):
    """A hinge of a file, and its body."""

    node: Node
    parent: str  # name of the parent joint; "": the base
    translation: Array
    rotation: Array
    numbers: dict[str, float]  # values of fields of `HINGE`, by name
    coordinate: Coordinate
    body: Mass | None  # None: no body

    def follows(self, before: Hinge) -> bool:
        """Whether the hinge moves the same body as the previous hinge."""
        here, there = self.coordinate, before.coordinate
        return before.body is None and here.body == there.body


class End(NamedTuple):
    """A tip frame of a file."""

    node: Node
    link: int  # number, from 1, of the link that ends here
    parent: str  # name of the parent joint; "": the base
    translation: Array
    rotation: Array


def link_of(node: Node, key: str, links: Sequence[str]) -> int:
    """Return the link number in an attribute; without the attribute, the number of the last link."""
    if node.element.get(key) is None:
        return len(links)
    number = node.number(key)
    if number not in range(1, len(links) + 1):
        raise node.error(f"{plain(key)} = {number:g}: expected a link, 1 … {len(links)}")
    return int(number)


def coordinate(node: Node, numbers: Sequence[float], links: Sequence[str]) -> Coordinate:
    """Return the three indices of a hinge: link, segment and axis."""
    found = Coordinate(*(int(number) if number == int(number) else -1 for number in numbers))
    if not (1 <= found.link <= len(links) and found.segment >= 0 and found.known and found.known.moves):
        last = max(axis for _, axis in KINDS)
        raise node.error(f"coordinate {list(numbers)}: expected link 1 … {len(links)}, segment, axis 0 … {last}")
    return found


def inertia_matrix(moments: Sequence[float]) -> Array:
    """Return the symmetric matrix from its upper triangle in the order of `UPPER_TRIANGLE`."""
    I = np.zeros((3, 3))
    for (row, column), moment in zip(UPPER_TRIANGLE.values(), moments, strict=True):
        I[row, column] = I[column, row] = moment
    return I


def chain_of(
    root: Node, own: Node, prefix: str, gravity: Sequence[float], links: tuple[str, ...], hinges: Sequence[Hinge],
    ends: Sequence[End], body: Mass | None, coupled: Iterable[Node],
) -> Chain:  # fmt: skip
    """Build the chain from hinges, base, tip frames and springs between hinges.

    `own` is the element with flexlink's custom attributes of `document.tree_attributes` and `rotation_springs`, whose
    names have a `prefix`, and `coupled` are elements of `document.couplings`. `body` is the mass of a floating base,
    whose hinges are not among the `hinges`.
    """
    floats = own.element.get(f"{prefix}{BASE}") is not None
    attitude = own.rotation(f"{prefix}{BASE}")  # of a floating base at zero angles
    loaded = link_of(own, f"{prefix}loaded", links)
    if not hinges and not floats:
        raise root.error("no movable joint")
    for hinge in hinges:
        _require_sound(hinge)
    base = np.zeros(BASE_JOINTS if floats else 0, HINGE)  # without springs, friction and limits
    if floats:
        base["axis"], base["coulomb_width"] = BASE_AXES, 1.0
        base["lower"], base["upper"] = -np.inf, np.inf
    coordinates = tuple(Kind.BASE.at(0, axis=k) for k in range(len(base))) + tuple(h.coordinate for h in hinges)
    if len(set(coordinates)) < len(coordinates):
        raise root.error("two joints have the same coordinate")
    half = BASE_JOINTS // 2
    moved = Body(Pose(attitude, np.zeros(3)), half, 2 * half, 1, _rigid(body))
    bodies, tips = _bodies(ends, hinges, [Body(HERE, 0, half), moved] if floats else [])
    if len(links) not in tips:
        raise root.error("the tip frame of the arm is missing: not a file written by flexlink")
    records = recorded(bodies)
    if floats:
        records["turned"][1] = 1  # because the base may have any attitude
    records["loaded"][tips.get(loaded, -1)] = 1
    numbers = [tuple(hinge.numbers[field] for field in HINGE.names or ()) for hinge in hinges]
    if own.element.get(key := f"{prefix}{ROTATION_SPRINGS}"):
        axes = [*base["axis"].tolist(), *(int(hinge.numbers["axis"]) for hinge in hinges)]
        _put_rotation_springs(own, key, records, axes)
    chain = Chain(
        name=root.attribute(f"{prefix}name"), bodies=records, hinges=np.append(base, np.array(numbers, dtype=HINGE)),
        gravity=np.array(gravity), coordinates=coordinates, link_names=links,
        couplings=_couplings(coupled, hinges, len(base)), joints_of_links=_joints(own, f"{prefix}joints", links),
        tips={links[link - 1]: number for link, number in tips.items()},
    )  # fmt: skip
    if np.linalg.eigvalsh(records["inertia"]).min() < -ROUNDING and (place := negative_inertia(chain)):
        raise root.error(place)
    return chain


def _joints(own: Node, key: str, links: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the links' joints; empty if they are those of the links."""
    names = own.names(key) if own.element.get(key) is not None else ()
    if names and len(names) != len(links):
        raise own.error(f"{plain(key)} has {len(names)} names for {len(links)} links")
    return names


Item = tuple[tuple[int, int], Hinge | End, Sequence[Hinge]]
"""A body to build: its sort key (by link, tips last), its first hinge or the tip, and its hinges."""


def _bodies(ends: Sequence[End], hinges: Sequence[Hinge], base: Sequence[Body]) -> tuple[list[Body], dict[int, int]]:
    """Return the bodies, with each link's bodies before its tip, and map link numbers to body numbers of the tips."""
    bodies, on, numbers = [*base], {"": len(base)}, dict[int, int]()
    stop = bodies[-1].stop if bodies else 0
    begins = [k for k in range(len(hinges)) if k == 0 or not hinges[k].follows(hinges[k - 1])]
    groups = [hinges[k:end] for k, end in itertools.pairwise([*begins, len(hinges)])]
    tips = sorted(ends, key=lambda tip: tip.link)
    moving: list[Item] = [((group[0].coordinate.link, 0), group[0], group) for group in groups]
    ending: list[Item] = [((tip.link, 1), tip, []) for tip in tips]
    for (link, _), first, group in heapq.merge(moving, ending, key=lambda item: item[0]):  # tips after their links
        if first.parent not in on:
            raise first.node.error(f"parent {first.parent[:60]!r} is not a joint before it")
        body = Body(Pose(first.rotation, first.translation), stop, stop, on[first.parent])
        bodies.append(body)
        if not group and link in numbers:
            raise first.node.error(f"another tip of link {link}: not a file written by flexlink")
        if not group:
            numbers[link] = len(bodies) - 1
            continue
        stop += len(group)
        body.stop, body.rigid = stop, _rigid(group[-1].body)
        on[group[-1].node.attribute("name")] = len(bodies)
    return bodies, numbers


def _rigid(body: Mass | None) -> SpatialInertia:
    return NOTHING if body is None else SpatialInertia(*body)


def _couplings(coupled: Iterable[Node], hinges: Sequence[Hinge], before: int) -> NDArray[np.void]:
    """Return records of dtype `COUPLING`; several entries for the same two joints add up."""
    number = {hinge.node.attribute("name"): k for k, hinge in enumerate(hinges)}
    found: dict[tuple[int, int], tuple[float, float]] = {}
    for one in coupled:
        inner, outer = one.attribute("inner"), one.attribute("outer")
        more = one.number("stiffness"), one.number("damping")
        for name in (inner, outer):
            if name not in number:
                raise one.error(f"joint {name[:60]!r}: no such joint")
        i, j = number[inner], number[outer]
        pair = before + i, before + j
        if i >= j:
            raise one.error(f"outer joint {outer[:60]!r} must follow inner joint {inner[:60]!r}")
        k, d = found.get(pair, (0.0, 0.0))
        found[pair] = constants = k + more[0], d + more[1]
        for field, value in zip(("stiffness", "damping"), constants, strict=True):
            most = math.sqrt(hinges[i].numbers[field]) * math.sqrt(hinges[j].numbers[field])
            if abs(value) > most * (1 + ROUNDING):
                between = f"{field} = {value!r} between joints {inner[:60]!r} and {outer[:60]!r}"
                raise one.error(f"{between}: must not exceed {most!r}, the geometric mean of the joints' values")
    return np.array([(*pair, *constants) for pair, constants in found.items()], dtype=COUPLING)


def _put_rotation_springs(own: Node, key: str, bodies: NDArray[np.void], axes: Sequence[int]) -> None:
    """Write the kinds of rotation-vector springs into the bodies whose hinges turn about `axes`."""
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
        raise own.error(f"{own.attribute(key)[:60]!r}: three joints with 2 must be followed by three with 1")


def _require_sound(hinge: Hinge) -> None:
    """Refuse invalid numbers that the algorithms do not refuse themselves."""
    numbers = hinge.numbers
    for key in ("stiffness", "damping", "coulomb"):
        if numbers[key] < 0:
            raise hinge.node.error(f"{key} = {numbers[key]!r}: must not be negative")
    if numbers["coulomb_width"] <= 0:
        raise hinge.node.error(f"coulomb_width = {numbers['coulomb_width']!r}: must be > 0")
    if not numbers["lower"] <= numbers["upper"]:
        raise hinge.node.error(f"limits {numbers['lower']!r} … {numbers['upper']!r}: lower must not exceed upper")
    if numbers["prescribed"] not in {0, 1}:
        raise hinge.node.error(f"prescribed = {numbers['prescribed']!r}: must be 0 or 1")
    if hinge.body is not None and hinge.body[0] < 0:
        raise hinge.node.error(f"mass {hinge.body[0]!r} attached to it is negative")
