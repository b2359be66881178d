"""MJCF → Chain: reads files written by `to_mjcf`, exact to the bit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.rotation import matrix_from_quaternion
from flexlink.common.types import Array
from flexlink.formats.document import ROTATION_SPRINGS
from flexlink.formats.mjcf import JOINT_ATTRIBUTES, USER_FIELDS, stand_in, to_mjcf
from flexlink.formats.reading import (
    ROUNDING,
    Coupled,
    End,
    Hinge,
    Mass,
    Node,
    chain_of,
    coordinate,
    inertia_matrix,
    limits_of,
    read,
    require_link,
    tree_of,
)
from flexlink.formats.tendons import SHARED
from flexlink.kernels.layout import SLIDES


def read_mjcf(text: str | bytes, *, what: str = "the MJCF") -> Chain:
    """Read an MJCF file that `to_mjcf` has written back to its chain; arguments and errors as in `read_urdf`."""
    not_of_chain = frozenset({"geom", "asset", "keyframe", "option.timestep"})
    return read(text, what, tag="mujoco", to_chain=_chain, write=to_mjcf, ignored=not_of_chain, canonical=_without_axes)


def _without_axes(root: ET.Element) -> None:
    """Remove principal axes, which are not unique and depend on the machine; `_read_body` has compared them."""
    exact = {one.get("name") for one in root.findall("custom/numeric")}
    for body in root.iter("body"):
        joints = [one.get("name") for kind in ("joint", "freejoint") for one in body.findall(kind)]
        if exact.intersection(f"flexlink.inertia.{name}" for name in joints):
            for inertial in body.findall("inertial"):
                for key in ("quat", "diaginertia"):
                    inertial.attrib.pop(key, None)


def _chain(root: Node) -> Chain:
    links = root.one("custom").one("text").links("data")
    own = {one.attribute("name"): one for one in root.all("custom/numeric")}
    found = _Found(own, links)
    found.read(root.one("worldbody"), "")
    gravity = root.one("option").numbers(3, "gravity")
    coupled = [_read_tendon(tendon) for tendon in root.all("tendon/fixed")]
    texts = {one.attribute("name"): one for one in root.all("custom/text")}
    said = {name.removeprefix("flexlink."): one.attribute("data") for name, one in texts.items()}
    tree = tree_of(Node(ET.Element("custom", said), root.what, ("custom",)), found.ends, links, found.base)
    springs = texts.get(f"flexlink.{ROTATION_SPRINGS}")
    hinges = sorted(found.hinges, key=lambda hinge: hinge.coordinate[:2])  # from branch by branch to link by link
    return chain_of(root, root.attribute("model"), gravity, links, hinges, tree, coupled, springs, key="data")


class _Found:
    """What nested bodies hold, branch by branch."""

    def __init__(self, own: Mapping[str, Node], links: Sequence[str]) -> None:
        self.own, self.links = own, links
        self.hinges, self.ends = list[Hinge](), list[End]()
        self.base: Mass | None = None

    def read(self, parent: Node, hung_on: str) -> None:
        """The bodies in one, which joint `hung_on` moves."""
        for body in parent.all("body"):
            joints, free = body.all("joint"), body.all("freejoint")
            if free:
                self.base = _read_body(body, free[0], self.own)
            elif not joints:
                self._read_end(body, hung_on)
            before = hung_on
            for joint in joints:
                mass = _read_body(body, joint, self.own) if joint is joints[-1] else None
                self.hinges.append(_read_hinge(joint, body, self.own, self.links)._replace(parent=before, body=mass))
                before = joint.attribute("name")
            self.read(body, before)

    def _read_end(self, body: Node, hung_on: str) -> None:
        exact = self.own.get(f"flexlink.tip.{body.attribute('name')}")
        if exact is None:
            self.ends.append(End(body, len(self.links), hung_on, *_read_place(body, self.own.get("flexlink.tip"))))
            return
        link, x, y, z, *rotation = exact.numbers(13, "data")
        place = np.array([x, y, z]), exact.rotation_matrix(rotation)
        self.ends.append(End(exact, require_link(exact, "data", link, self.links), hung_on, *place))


def _read_tendon(tendon: Node) -> Coupled:
    ends = tendon.all("joint")
    if len(ends) != 2:
        raise tendon.error(f"{len(ends)} joints: expected 2")
    (inner, outer), product = (end.attribute("joint") for end in ends), math.prod(end.number("coef") for end in ends)
    return Coupled(tendon, inner, outer, product * tendon.number("stiffness"), product * tendon.number("damping"))


def _read_hinge(joint: Node, body: Node, own: Mapping[str, Node], links: Sequence[str]) -> Hinge:
    *user, link, segment, axis = joint.numbers(len(USER_FIELDS) + 3, "user")
    numbers = dict(zip(USER_FIELDS, user, strict=True)) | {
        field: joint.number(key) for key, field in JOINT_ATTRIBUTES.items()
    }
    if whole := own.get(f"flexlink.springs.{joint.attribute('name')}"):  # of which the joint has a part
        numbers |= dict(zip(SHARED, whole.numbers(len(SHARED), "data"), strict=True))
    numbers |= limits_of(*(joint.numbers(2, "range") if "range" in joint.element.attrib else (-np.inf, np.inf)))
    if numbers["axis"] not in range(2 * SLIDES):
        raise joint.error(f"axis {numbers['axis']} in user: must be 0, 1, 2 or, of a slide, 3, 4, 5")
    place = _read_place(body, own.get(f"flexlink.placement.{joint.attribute('name')}"))
    return Hinge(joint, "", *place, numbers, coordinate(joint, (link, segment, axis), links), None)


def _read_place(body: Node, own: Node | None) -> tuple[Array, Array]:
    """Placement of the first hinge at a point: from our own numbers, or that of the body, without rotation."""
    if own is None:
        return np.array(body.numbers(3, "pos")), np.eye(3)
    x, y, z, *rotation = own.numbers(12, "data")
    return np.array([x, y, z]), own.rotation_matrix(rotation)


def _read_body(body: Node, last: Node, own: Mapping[str, Node]) -> Mass:
    inertial = body.one("inertial")
    moments, axes = inertial.numbers(3, "diaginertia"), matrix_from_quaternion(inertial.numbers(4, "quat"))
    exact = own.get(f"flexlink.inertia.{last.attribute('name')}")
    I = np.diag(moments) if exact is None else inertia_matrix(exact.numbers(6, "data"))
    mass, written = inertial.number("mass"), axes @ np.diag(moments) @ axes.T
    nothing = np.array_equal(moments, stand_in(mass))  # which means that it has none, if the exact one says so
    if np.abs(written - I).max() > ROUNDING * np.abs(moments).max() and not (nothing and not I.any()):
        raise inertial.error("diaginertia and quat contradict the inertia in <custom>")
    return mass, np.array(inertial.numbers(3, "pos")), I
