"""URDF → Chain: read files written by `to_urdf`, without rounding errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.formats.document import UPPER_TRIANGLE
from flexlink.formats.reading import (
    End,
    Hinge,
    Mass,
    chain_of,
    coordinate,
    inertia_matrix,
    limits_of,
    link_of,
)
from flexlink.formats.strict_reading import Node, read
from flexlink.formats.urdf import DYNAMICS, STANDARD_FIELDS, to_urdf
from flexlink.kernels.layout import HINGE, SLIDES


def read_urdf(text: str | bytes, *, what: str = "the URDF") -> Chain:
    """Read a URDF file written by `to_urdf` back to its chain; use `import_urdf` for other URDF files.

    Parameters
    ----------
    text
        The document; its numbers may have been edited.
    what
        Name of the document in messages, for example its path.

    Returns
    -------
    Chain
        The chain, with exactly the numbers and rotations that were written.

    Raises
    ------
    DataFileError
        The file was not written by flexlink, or a number is missing, not finite, negative, or contradicts another.
    """
    return read(text, what, tag="robot", to_chain=_chain, write=to_urdf, ignored=frozenset({"visual", "material"}))


def _chain(robot: Node) -> Chain:
    own = robot.one("flexlink")
    links = own.names("links")
    bodies = {link.attribute("name"): link for link in robot.all("link")}
    moving = [joint for joint in robot.all("joint") if joint.attribute("type") != "fixed"]
    behind = {joint.one("child").attribute("link"): joint.attribute("name") for joint in moving}
    hinges = [_read_hinge(joint, bodies, links, behind) for joint in moving]
    ends = [_read_end(joint, links, behind) for joint in robot.all("joint[@type='fixed']")]
    coupled = own.all("coupling")
    mass, gravity = _read_body(robot.one("link")), own.numbers(3, "gravity")
    return chain_of(robot, own, "", gravity, links, hinges, ends, mass, coupled)


def _read_end(joint: Node, links: Sequence[str], behind: Mapping[str, str]) -> End:
    return End(joint, link_of(joint.one("flexlink"), "link", links), _parent(joint, behind), *_read_place(joint))


def _parent(joint: Node, behind: Mapping[str, str]) -> str:
    """Return the joint that moves the parent link; "" for the base."""
    return behind.get(joint.one("parent").attribute("link"), "")


def _read_place(joint: Node) -> tuple[Array, Array]:
    return np.array(joint.one("origin").numbers(3, "xyz")), joint.one("flexlink").rotation("rotation")


def _read_hinge(joint: Node, bodies: Mapping[str, Node], links: Sequence[str], behind: Mapping[str, str]) -> Hinge:
    own, dynamics, child = joint.one("flexlink"), joint.one("dynamics"), joint.one("child").attribute("link")
    if child not in bodies:
        raise joint.error(f"child = {child[:60]!r}: no such link")
    numbers = {key: own.number(key) for key in HINGE.names or () if key not in STANDARD_FIELDS}
    numbers |= {field: dynamics.number(key) for key, field in DYNAMICS.items()}
    axis, limit = joint.one("axis"), joint.one("limit")
    numbers |= limits_of(limit.number("lower"), limit.number("upper"))
    slides = joint.attribute("type") == "prismatic"
    numbers["axis"] = axis.unit_axis(axis.numbers(3, "xyz")) + SLIDES * slides
    place = coordinate(own, own.numbers(3, "coordinate"), links)
    parent = _parent(joint, behind)
    return Hinge(joint, parent, *_read_place(joint), numbers, place, _read_body(bodies[child]))


def _read_body(link: Node) -> Mass | None:
    if not link.all("inertial"):
        return None
    inertial = link.one("inertial")
    moments = [inertial.one("inertia").number(key) for key in UPPER_TRIANGLE]
    return (
        inertial.one("mass").number("value"),
        np.array(inertial.one("origin").numbers(3, "xyz")),
        inertia_matrix(moments),
    )
