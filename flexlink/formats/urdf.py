"""Chain → URDF: one link and one revolute joint per coordinate; all but the last link at a point are massless.

URDF has no springs. What it cannot hold stands in elements of our own, which parsers skip: `<flexlink gravity>`
in the robot, `<flexlink stiffness rest coulomb_width armature>` in each joint. Viscous damping and Coulomb torque
are the standard `<dynamics damping friction>`.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain, unique
from flexlink.chain.rotation import rpy_from_matrix
from flexlink.formats.document import decimals, text, valid, xml_joint_names, xml_link_names

Array = NDArray[np.float64]

# A `continuous` joint takes two numbers per angle in Pinocchio; a `revolute` one needs limits, so they are wide.
LIMIT = {"lower": "-1e9", "upper": "1e9", "effort": "1e9", "velocity": "1e9"}
UPPER_TRIANGLE = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


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
    joints, links = xml_joint_names(chain), xml_link_names(chain)
    robot = ET.Element("robot", name=valid(chain.name))
    ET.SubElement(robot, "flexlink", gravity=decimals(chain.gravity))
    link = ET.SubElement(robot, "link", name=links[0])
    for body in chain.bodies[:-1]:
        translation, rotation = body["translation"], body["rotation"]
        for k in range(body["first"], body["stop"]):
            joint = _joint(robot, joints[k], "revolute", links[k], links[k + 1], translation, rotation)
            _hinge(joint, chain.hinges[k])
            link = ET.SubElement(robot, "link", name=links[k + 1])
            translation, rotation = np.zeros(3), np.eye(3)
        if body["mass"] or body["inertia"].any():
            _inertial(link, body)
    tip = chain.bodies[-1]
    fixed = unique([*joints, "tip_joint"])[-1]
    _joint(robot, fixed, "fixed", links[-2], links[-1], tip["translation"], tip["rotation"])
    ET.SubElement(robot, "link", name=links[-1])
    return text(robot)


def _joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, translation: Array, rotation: Array
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=decimals(translation), rpy=decimals(rpy_from_matrix(rotation)))
    return joint


def _hinge(joint: ET.Element, hinge: np.void) -> None:
    ET.SubElement(joint, "axis", xyz=decimals(np.eye(3)[hinge["axis"]]))
    ET.SubElement(joint, "limit", LIMIT)
    dynamics = {"damping": hinge["damping"], "friction": hinge["coulomb"]}
    ET.SubElement(joint, "dynamics", {name: decimals([value]) for name, value in dynamics.items()})
    own = ("stiffness", "rest", "coulomb_width", "armature")
    ET.SubElement(joint, "flexlink", {name: decimals([hinge[name]]) for name in own})


def _inertial(link: ET.Element, body: np.void) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=decimals(body["center"]))
    ET.SubElement(inertial, "mass", value=decimals([body["mass"]]))
    moments = {name: decimals([body["inertia"][place]]) for name, place in UPPER_TRIANGLE.items()}
    ET.SubElement(inertial, "inertia", moments)
