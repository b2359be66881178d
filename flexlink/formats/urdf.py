"""Chain ↔ URDF, with one link and one joint of one axis per coordinate; the last link at a point has mass.

A fixed base is a link without mass. A floating base has its mass but no joint. URDF has no other way to mark a base as
floating, so the program that loads the file must be configured to let it float.

URDF has no springs. Values that it cannot represent are in custom elements `<flexlink>`, which parsers ignore. The
robot's element contains gravity, link names, rotation-vector springs, the rotation of a floating base, and one
`<coupling>` for each pair of joints connected by a spring or damper. Each joint's element contains stiffness, rest,
coulomb_width, armature, … and the coordinate. Viscous damping and Coulomb torque are in `<dynamics damping friction>`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import require_bool, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.chain.forces import refuse_states
from flexlink.chain.rigid import rpy_from_matrix
from flexlink.common.types import Array
from flexlink.formats import document, reading
from flexlink.formats.document import UPPER_TRIANGLE, WIDE, Capsule, decimals, valid
from flexlink.formats.reading import End, Hinge, Mass, Node
from flexlink.kernels.layout import HINGE

# Rotating joints are `revolute`, which requires limits; Pinocchio would use two coordinates for a `continuous` joint.
LIMIT = WIDE | {"effort": "1e9", "velocity": "1e9"}
DYNAMICS = {"damping": "damping", "friction": "coulomb"}  # maps attributes of <dynamics> to fields of the hinge
STANDARD_FIELDS = {*DYNAMICS.values(), "axis", "lower", "upper"}


def to_urdf(chain: Chain, *, shapes: bool = True) -> str:
    """Write a chain as URDF.

    Parameters
    ----------
    chain, shapes
        The chain, and whether to write shapes for viewers, without mass and contact: a cylinder and a sphere for each
        capsule.

    Returns
    -------
    str
        The document. Joints are in sequential order, with the names of `Chain.joint_names`. Each driven joint has a
        transmission of the same name. Link `tip` is the tip frame; other tips are named after the links
        that end there. Other links are named after their joints, or, if a joint has a separate name (`Joint.name`),
        have the name of the scene's link. Numbers read back exactly; rotations are written as roll, pitch and yaw.

    Notes
    -----
    URDF cannot hold springs, armature, gravity, the smoothing of dry friction, or that a base floats: they are in
    elements `<flexlink>`, which other programs ignore, so their M lacks the armature. The log (level INFO) names those
    that the chain has. Drives, some forces and initial states are not written: see `flexlink export`.

    Raises
    ------
    ArgumentError
        `chain` is not a Chain.

    Examples
    --------
    >>> text = fl.to_urdf(chain)
    >>> print(text.count("<joint"), "joints, the last one fixed")
    9 joints, the last one fixed
    """
    refuse_states(require_type("chain", chain, Chain), "no file represents it")
    unheld = {"springs": chain.stiffness, "armature": chain.hinges["armature"], "gravity": chain.gravity}
    found = ", ".join(name for name, values in unheld.items() if values.any())
    if found:
        logging.getLogger(__name__).info("%s: a URDF cannot hold %s; only flexlink reads them", chain.name, found)
    joints, links = document.xml_joint_names(chain), document.xml_link_names(chain)
    robot = ET.Element("robot", name=valid(chain.name))
    own = ET.SubElement(robot, "flexlink", gravity=decimals(chain.gravity), links=document.names_text(chain.link_names))
    own.attrib.update(document.rotation_springs(chain) | document.tree_attributes(chain))
    for coupling in document.couplings(chain, joints):
        ET.SubElement(own, "coupling", coupling)
    if require_bool("shapes", shapes):
        for name, rgba in document.colours(chain):
            ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    base = ET.SubElement(robot, "link", name=links[0])
    shown = document.capsules_behind(chain) if shapes else {}
    if own_joints := document.base_joints(chain):
        _contents(base, chain.bodies[1], shown.get(own_joints - 1, []))
    for k, parent, translation, rotation, body in document.joint_places(chain):
        kind = chain.joint_kinds[k].name
        joint = _joint(robot, joints[k], kind, (links[parent + 1], links[k + 1]), (translation, rotation))
        hinge = chain.hinges[k]
        ET.SubElement(joint, "axis", xyz=document.axis_text(hinge))
        ET.SubElement(joint, "limit", LIMIT | document.limits(hinge))
        ET.SubElement(joint, "dynamics", {key: decimals([hinge[field]]) for key, field in DYNAMICS.items()})
        own_values = document.custom_values(chain, k, STANDARD_FIELDS) | document.exact_rotation(rotation)
        ET.SubElement(joint, "flexlink", own_values)
        _contents(ET.SubElement(robot, "link", name=links[k + 1]), body, shown.get(k, []))
    ends = document.tips(chain)
    names = unique([*joints, "tip_joint", *(f"{tip.name}_joint" for tip in ends[:-1])])[chain.n :]
    for tip, name in zip(ends, [*names[1:], names[0]], strict=True):
        fixed = _joint(robot, name, "fixed", (links[tip.parent + 1], tip.name), (tip.translation, tip.rotation))
        number = {} if tip is ends[-1] else {"link": str(tip.link)}
        ET.SubElement(fixed, "flexlink", number | document.exact_rotation(tip.rotation))
        ET.SubElement(robot, "link", name=tip.name)
    for name in (joints[k] for k in chain.active):  # a transmission with reduction 1, as in ROS
        transmission = ET.SubElement(robot, "transmission", name=name)
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        interface = "hardware_interface/EffortJointInterface"
        ET.SubElement(ET.SubElement(transmission, "joint", name=name), "hardwareInterface").text = interface
        ET.SubElement(ET.SubElement(transmission, "actuator", name=name), "mechanicalReduction").text = "1"
    return document.text(robot)


def _joint(robot: ET.Element, name: str, kind: str, ends: tuple[str, str], place: tuple[Array, Array]) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    for tag, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(joint, tag, link=link)
    translation, rotation = place
    ET.SubElement(joint, "origin", xyz=decimals(translation), rpy=decimals(rpy_from_matrix(rotation)))
    return joint


def _contents(link: ET.Element, body: np.void | None, shown: list[Capsule]) -> None:
    """Write the inertia of a link, if it has any, and its visual shapes."""
    if body is not None:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=decimals(body["center"]))
        ET.SubElement(inertial, "mass", value=decimals([body["mass"]]))
        ET.SubElement(inertial, "inertia", document.moments_text(body))
    for capsule in shown:
        radius, length = decimals([capsule.radius]), decimals([capsule.length])
        x, y, z, *rpy = capsule.pose
        cylinder = "cylinder", {"radius": radius, "length": length}, (x, y, z)
        for kind, dimensions, xyz in (cylinder, ("sphere", {"radius": radius}, (0.0, 0.0, 0.0))):
            visual = ET.SubElement(link, "visual")
            ET.SubElement(visual, "origin", xyz=decimals(xyz), rpy=decimals(rpy))
            ET.SubElement(ET.SubElement(visual, "geometry"), kind, dimensions)
            ET.SubElement(visual, "material", name=capsule.colour[0])


def read_urdf(text: str | bytes, *, what: str = "the URDF") -> Chain:
    """Read a URDF file written by `to_urdf`, numbers may be edited, back to its chain; `what`: its name in messages.

    A DataFileError: flexlink has not written it, or a number is missing, not finite, negative, or contradicts another.
    """
    ignored = frozenset({"visual", "material"})
    return reading.read(text, what, tag="robot", to_chain=_chain, write=to_urdf, ignored=ignored)


def _chain(robot: Node) -> Chain:
    own = robot.one("flexlink")
    links = own.names("links")
    bodies = {link.attribute("name"): link for link in robot.all("link")}
    moving = [joint for joint in robot.all("joint") if joint.attribute("type") != "fixed"]
    behind = {joint.one("child").attribute("link"): joint.attribute("name") for joint in moving}
    hinges = [_read_hinge(joint, bodies, links, behind) for joint in moving]
    ends = [
        End(joint, reading.link_of(joint.one("flexlink"), "link", links), _parent(joint, behind), *_read_place(joint))
        for joint in robot.all("joint[@type='fixed']")
    ]
    coupled, mass, gravity = own.all("coupling"), _read_body(robot.one("link")), own.numbers(3, "gravity")
    return reading.chain_of(robot, own, "", gravity, links, hinges, ends, mass, coupled)


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
    lower, upper, (least, most) = limit.number("lower"), limit.number("upper"), map(float, WIDE.values())
    numbers |= {"lower": -np.inf if lower == least else lower, "upper": np.inf if upper == most else upper}
    numbers["axis"] = axis.unit_axis(axis.numbers(3, "xyz"), joint.attribute("type"))
    place = reading.coordinate(own, own.numbers(3, "coordinate"), links)
    return Hinge(joint, _parent(joint, behind), *_read_place(joint), numbers, place, _read_body(bodies[child]))


def _read_body(link: Node) -> Mass | None:
    if not link.all("inertial"):
        return None
    inertial = link.one("inertial")
    I = reading.inertia_matrix([inertial.one("inertia").number(key) for key in UPPER_TRIANGLE])
    return inertial.one("mass").number("value"), np.array(inertial.one("origin").numbers(3, "xyz")), I
