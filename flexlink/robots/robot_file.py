"""URDF → `Robot`: read masses, placements and joints; ignore everything that does not affect motion, such as meshes.

The reader is stricter than other readers. A number must be a decimal number (not `nan` or `1,5`, which some readers
take as 0 or 1), required values must be present, and nothing may be given twice. Mesh files are not opened.
"""

import dataclasses
import functools
import math
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import cast, get_args
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.rigid import NOTHING, Pose, SpatialInertia, matrix_from_rpy_deg
from flexlink.common import safe_xml
from flexlink.common.errors import DataFileError, Diagnostic, SceneError
from flexlink.common.safe_xml import LARGEST_NUMBER, numbers_in
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, truncated
from flexlink.data.documents import read_regular, read_toml, require_path, shown_path
from flexlink.describe.directions import unit
from flexlink.describe.spec import decode
from flexlink.robots.kinematic_tree import JointKind, Mimic, Robot, TreeJoint
from flexlink.robots.mjcf_file import read_mjcf
from flexlink.robots.sdf_file import as_urdf


@functools.cache
def words() -> dict[str, str]:
    """Names of what is read of a URDF file, separated by commas, and patterns of other names."""
    return decode(read_toml(Path(__file__).parent / "data" / "urdf.toml"), dict[str, str])


def read_robot(path: str | Path) -> Robot:
    """Read a robot, in SI units and radians, from a URDF, MJCF or SDF file; a xacro file must be expanded first."""
    path = require_path("path", path)
    if path.suffix.lower() in {".stl", ".obj", ".dae", ".step", ".stp", ".iges"}:
        raise DataFileError(f"{shown_path(path)}: a mesh or CAD file; import reads URDF, MJCF and SDF", id="not-xml")
    data = read_regular(path, largest=safe_xml.LARGEST, error=DataFileError)
    root = safe_xml.parse(data, shown_path(path), namespaces=False)
    try:
        return _robot(root, path)
    except DataFileError as error:
        hint = "; this is a xacro file: expand it first, xacro FILE > robot.urdf"
        hint *= error.id == "xacro" or "${" in str(error)
        raise DataFileError(f"{shown_path(path)}: {error}{hint}") from None


def _robot(root: ET.Element, path: Path) -> Robot:
    if root.tag not in {"robot", "mujoco", "sdf"}:
        why = "the root element of a URDF file is <robot>, of MJCF <mujoco>, of SDF <sdf>"
        raise DataFileError(f"<{truncated(root.tag)[1:-1]}>: {why}", id="unknown-root-element")
    own = root.find(".//flexlink"), root.find("custom/text[@name='flexlink.links']"), root.get("xmlns:flexlink")
    if any(each is not None for each in own):
        why = "<flexlink>: this file was exported by flexlink; load its scene instead"
        raise DataFileError(why, id="exported-by-flexlink")
    if root.tag == "mujoco":
        return read_mjcf(path)
    longest = 10_000  # characters of an attribute
    spaces = [key for key, space in root.attrib.items() if key.startswith("xmlns:") and "xacro" in space]
    macros = ("xacro:", *(f"{space.removeprefix('xmlns:')}:" for space in spaces))
    for element in root.iter():
        if element.tag.startswith(macros):
            raise DataFileError(f"<xacro:{truncated(element.tag.partition(':')[2])[1:-1]}>: a macro", id="xacro")
        if any(len(value) > longest for value in element.attrib.values()):
            why = f"<{truncated(element.tag)[1:-1]}>: has an attribute of more than {longest} characters"
            raise DataFileError(why, id="file-too-large")
    if root.tag == "sdf":
        tree, closures = as_urdf(root)
        return dataclasses.replace(_tree(tree), left_out=_left_out(root), closures=closures, source="SDF")
    return dataclasses.replace(_tree(root), left_out=_left_out(root))


def _tree(root: ET.Element) -> Robot:
    """The robot of elements of URDF."""
    most_links = 5_000  # a humanoid has 130
    elements = root.findall("link")
    if len(elements) > most_links:
        raise DataFileError(f"{len(elements)} links; at most {most_links} are read", id="file-too-large")
    links, joints = dict[str, SpatialInertia](), dict[str, TreeJoint]()
    for element in elements:
        links[_new_name(element, links)] = _body(element)
    for element in root.findall("joint"):
        name = _new_name(element, joints)
        joints[name] = _joint(element, name)
    return Robot(root.get("name") or "robot", links, joints, {}, tuple(_in_degrees(root, joints)))


def _left_out(root: ET.Element) -> dict[str, list[tuple[str, str]]]:
    """Return what the file has and the reader does not read: for each element or attribute, its owners and values.

    Of an element that is not read, all parts with a mechanical name are left out as well; others go with it.
    """
    found: dict[str, list[tuple[str, str]]] = {}
    read, inside = words()["read_sdf" if root.tag == "sdf" else "read"].split(","), [(root, "", True)]
    for element, parent, is_read in inside:  # the loop appends to the list
        owner = element.get("reference") or (element is not root and element.get("name")) or parent
        parts = [(f"{element.tag} {key}", value) for key, value in element.attrib.items() if key[:5] != "xmlns"]
        known = [is_read and f"{element.tag}/{child.tag}" in read for child in element]
        inside += zip(element, [owner] * len(element), known, strict=True)
        parts += [(child.tag, (child.text or "").strip()) for child, one in zip(element, known, strict=True) if not one]
        for name, value in parts:
            if not (is_read and name in read) and (is_read or acts("mechanical", f"<{name}>")):
                found.setdefault(f"<{name}>", []).append((owner, value))
    return found


def acts(kind: str, name: str) -> bool:
    """Whether the name of an element or attribute is of this kind."""
    return re.search(words()[kind], name.removeprefix("<limit "), re.IGNORECASE) is not None


def _in_degrees(root: ET.Element, joints: Mapping[str, TreeJoint]) -> Iterator[Diagnostic]:
    """Warnings about angles that are likely in degrees: rotations of more than a turn, limits of whole degrees."""
    why = "likely given in deg; angles in URDF are in rad"
    for element in (*root.findall("link"), *root.findall("joint")):
        origin = element.find("origin" if element.tag == "joint" else "inertial/origin")
        rpy = "" if origin is None else origin.get("rpy", "")
        if max(map(abs, safe_xml.numbers_of(rpy) or [0.0])) > 2 * math.pi + 1e-3:
            text = f"{_label(element)}: <origin rpy> = {truncated(rpy)}: more than one turn; {why}"
            yield Diagnostic(text, "likely-degrees")
    for joint in joints.values():
        lower, upper = joint.limits or (0.0, 0.0)
        far = 4 * math.pi < max(abs(lower), abs(upper)) <= 720
        if joint.turns and far and lower.is_integer() and upper.is_integer():
            text = f"joint {truncated(joint.name)}: <limit> from {lower:g} to {upper:g}: more than two turns; {why}"
            yield Diagnostic(text, "likely-degrees")


def _new_name(element: ET.Element, known: dict[str, SpatialInertia] | dict[str, TreeJoint]) -> str:
    if not (name := element.get("name")):
        raise DataFileError(f"{element.tag} {len(known) + 1}: name: missing", id="missing-in-file")
    if name in known:
        raise DataFileError(f"{_label(element)}: this name is used twice", id="name-twice")
    return name


def _label(element: ET.Element) -> str:
    """Return the name of a link or joint for a message."""
    return f"{element.tag} {truncated(element.get('name'))}"


def _one(parent: ET.Element, tag: str, about: str) -> ET.Element | None:
    elements = parent.findall(tag)
    if len(elements) > 1:
        raise DataFileError(f"{about}: <{tag}> is given {len(elements)} times", id="element-twice")
    return elements[0] if elements else None


def _needed(parent: ET.Element, tag: str, about: str) -> ET.Element:
    if (child := _one(parent, tag, about)) is None:
        raise DataFileError(f"{about}: <{tag}>: missing", id="missing-in-file")
    return child


def _text(element: ET.Element, key: str, about: str) -> str:
    if (text := element.get(key)) is None:
        inner = (element.text or "").strip()
        written = f'; it is an attribute, <{element.tag} {key}="{inner}"/>' if inner else ""
        raise DataFileError(f"{about}: <{element.tag} {key}>: missing{written}", id="missing-in-file")
    return text


def _number(
    element: ET.Element | None, key: str, about: str, default: float | None = None, largest: float = LARGEST_NUMBER
) -> float:
    """Return a numerical attribute; without a default it must be present."""
    if element is None or (default is not None and element.get(key) is None):
        return default or 0.0
    return numbers_in(_text(element, key, about), f"{about}: <{element.tag} {key}>", largest=largest)[0]


def _not_negative(element: ET.Element | None, key: str, about: str, default: float | None = None) -> float:
    value = _number(element, key, about, default)
    if value < 0 and element is not None:
        raise DataFileError(f"{about}: <{element.tag} {key}> = {value!r}: must not be negative", id="number-in-file")
    return value


def _vector(element: ET.Element | None, key: str, about: str, default: tuple[float, float, float]) -> Array:
    if element is None or (text := element.get(key)) is None:
        return np.array(default)
    return np.array(numbers_in(text, f"{about}: <{element.tag} {key}>", 3))


def _origin(parent: ET.Element, about: str) -> Pose:
    element = _one(parent, "origin", about)
    zero = (0.0, 0.0, 0.0)
    roll, pitch, yaw = np.degrees(_vector(element, "rpy", about, zero)).tolist()  # right angles are exact in degrees
    return Pose(matrix_from_rpy_deg((roll, pitch, yaw)), _vector(element, "xyz", about, zero))


def _body(link: ET.Element) -> SpatialInertia:
    about = _label(link)
    if (inertial := _one(link, "inertial", about)) is None:
        return NOTHING
    mass = _not_negative(_needed(inertial, "mass", about), "value", about)
    tensor = _needed(inertial, "inertia", about)
    xx, yy, zz, xy, xz, yz = (_number(tensor, key, about) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return SpatialInertia(mass, np.zeros(3), inertia).moved(_origin(inertial, about))


def _joint(element: ET.Element, name: str) -> TreeJoint:
    about = _label(element)
    kind, kinds = _text(element, "type", about), get_args(JointKind)
    if kind not in kinds:
        why = f"{about}: type = {truncated(kind)}: allowed are {', '.join(kinds)}{did_you_mean(kind, kinds)}"
        raise DataFileError(why, id="joint-type-in-file")
    dynamics, mimic = _one(element, "dynamics", about), _one(element, "mimic", about)
    parent, child = (_text(_needed(element, tag, about), "link", about) for tag in ("parent", "child"))
    origin = _origin(element, about)
    axis = _axis(element, about) if kind in {"revolute", "continuous", "prismatic"} else np.zeros(3)
    limits = _limits(element, kind, about)
    damping, friction = (_not_negative(dynamics, key, about, 0.0) for key in ("damping", "friction"))
    rule = None
    if mimic is not None:
        leader, multiplier = _text(mimic, "joint", about), _number(mimic, "multiplier", about, 1.0)
        rule = Mimic(leader, multiplier, _number(mimic, "offset", about, 0.0))
    return TreeJoint(name, cast(JointKind, kind), parent, child, origin, axis, limits, damping, friction, rule)


def _axis(element: ET.Element, about: str) -> Array:
    x, y, z = _vector(_one(element, "axis", about), "xyz", about, (1.0, 0.0, 0.0)).tolist()
    try:
        return unit(f"{about}: <axis xyz>", (x, y, z))
    except SceneError as error:
        raise DataFileError(str(error)) from None


def _limits(element: ET.Element, kind: str, about: str) -> tuple[float, float] | None:
    limit = _one(element, "limit", about) if kind in {"revolute", "prismatic"} else None
    if limit is None:
        return None
    lower, upper = (_number(limit, key, about, 0.0, sys.float_info.max) for key in ("lower", "upper"))
    stated = max(abs(lower), abs(upper)) <= LARGEST_NUMBER  # some files write 1e16 for no limit
    return (lower, upper) if stated else None
