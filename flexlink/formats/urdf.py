"""Chain → URDF: one link and one revolute joint per coordinate; all but the last link at a point are massless.

URDF has no springs. What it cannot hold stands in elements of our own, which parsers skip: `<flexlink>` in the robot
(gravity, names of the arm's links) and in each joint (stiffness, rest, coulomb_width, armature, …, and the coordinate).
Viscous damping and Coulomb torque are the standard `<dynamics damping friction>`.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import given
from flexlink.chain.chain import Chain, unique
from flexlink.chain.rotation import rpy_from_matrix
from flexlink.formats.document import (
    UPPER_TRIANGLE,
    Array,
    decimals,
    limits,
    links_text,
    own_rotation,
    own_values,
    places,
    text,
    valid,
    xml_joint_names,
    xml_link_names,
)

# A `continuous` joint takes two numbers per angle in Pinocchio; a `revolute` one needs limits.
WIDE = {"lower": "-1e9", "upper": "1e9", "effort": "1e9", "velocity": "1e9"}
HELD = {"axis", "damping", "coulomb", "lower", "upper"}


def to_urdf(chain: Chain) -> str:
    """Write a chain as URDF.

    Parameters
    ----------
    chain
        The chain.

    Returns
    -------
    str
        The document; joints in sequential order, named as `Chain.joint_name` does. Link `tip` is the tip frame.
        Numbers read back exactly, except that placements turn by roll, pitch and yaw.

    Raises
    ------
    ArgumentError
        `chain` is no Chain.
    """
    given("chain", chain, Chain)
    joints, links = xml_joint_names(chain), xml_link_names(chain)
    robot = ET.Element("robot", name=valid(chain.name))
    ET.SubElement(robot, "flexlink", gravity=decimals(chain.gravity), links=links_text(chain))
    ET.SubElement(robot, "link", name=links[0])
    for k, translation, rotation, body in places(chain):
        joint = _joint(robot, joints[k], "revolute", links[k], links[k + 1])
        _hinge(joint, chain, k)
        _origin(joint, translation, rotation, own_values(chain, k, HELD))
        link = ET.SubElement(robot, "link", name=links[k + 1])
        if body is not None:
            _inertial(link, body)
    tip = chain.bodies[-1]
    fixed = _joint(robot, unique([*joints, "tip_joint"])[-1], "fixed", links[-2], links[-1])
    _origin(fixed, tip["translation"], tip["rotation"], {})
    ET.SubElement(robot, "link", name=links[-1])
    return text(robot)


def _joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _origin(joint: ET.Element, translation: Array, rotation: Array, own: dict[str, str]) -> None:
    """The placement, and our own element, with the rotation that roll, pitch and yaw round."""
    ET.SubElement(joint, "origin", xyz=decimals(translation), rpy=decimals(rpy_from_matrix(rotation)))
    if own := own | own_rotation(rotation):
        ET.SubElement(joint, "flexlink", own)


def _hinge(joint: ET.Element, chain: Chain, k: int) -> None:
    hinge = chain.hinges[k]
    ET.SubElement(joint, "axis", xyz=decimals(np.eye(3)[hinge["axis"]]))
    ET.SubElement(joint, "limit", WIDE | limits(hinge))
    dynamics = {"damping": hinge["damping"], "friction": hinge["coulomb"]}
    ET.SubElement(joint, "dynamics", {name: decimals([value]) for name, value in dynamics.items()})


def _inertial(link: ET.Element, body: np.void) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=decimals(body["center"]))
    ET.SubElement(inertial, "mass", value=decimals([body["mass"]]))
    moments = {name: decimals([body["inertia"][place]]) for name, place in UPPER_TRIANGLE.items()}
    ET.SubElement(inertial, "inertia", moments)
