"""Common parts of the readers: elements that report their location, strict numbers, and a check for ignored content.

The readers accept files written by flexlink, whose numbers may have been edited. The chain that was read is written
again. Any difference from the file beyond rounding is an error that names the difference, such as an unknown element,
another structure, or a rotation that contradicts the exact rotation next to it.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Callable, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import DataFileError, FlexlinkError
from flexlink.common.safe_xml import numbers_of, parse
from flexlink.common.types import Array

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
        """Return R, row by row, from a custom attribute; the identity without it."""
        return np.eye(3) if self.element.get(key) is None else self.rotation_matrix(self.numbers(9, key))

    def rotation_matrix(self, values: Sequence[float]) -> Array:
        """Return R from its nine elements and check that it is a rotation matrix, not a stretched one."""
        R = np.reshape(values, (3, 3))
        tolerance = 1e-13  # rounding error of a product of a hundred rotations
        if np.abs(R @ R.T - np.eye(3)).max() > tolerance or np.linalg.det(R) < 0:
            raise self.error(f"{list(values)}: not a rotation matrix")
        return R

    def unit_axis(self, values: Sequence[float]) -> int:
        """Return 0, 1 or 2 for X, Y or Z."""
        for axis, unit in enumerate(np.eye(3).tolist()):
            if list(values) == unit:
                return axis
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
    """Parse the text, build the chain, write it again and compare.

    `ignored` lists elements and attributes ("element.attribute") that are not part of the chain.
    """
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
