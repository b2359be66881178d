"""Common mistakes planted into robot files of flexlink; each has an edit and a part of the expected finding."""

import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.data.documents import read_toml
from flexlink.diagnosis import mistakes
from flexlink.formats.document import UPPER_TRIANGLE

Edit = Callable[[ET.Element], object]


class Planted(NamedTuple):
    """A mistake in a file of this format; the finding contains `named`: a name, a value or its cause."""

    form: str
    mistake: str
    edit: Edit
    named: str = ""


def cause(field: str, shape: str = "", *factors: float, setting: str = "") -> str:
    """The mistake listed in `mistakes.toml` for a field that differs in this pattern; without one, a displacement."""
    table = read_toml(Path(mistakes.__file__).parent / "data" / "mistakes.toml")
    if not shape:
        return table["misplaced"][field]["likely"]
    return next(
        row["likely"]
        for row in table["mistake"]
        if (field in row["fields"], row["shape"], row.get("setting", "")) == (True, shape, setting)
        and {*factors} <= {*row.get("factors", ())}
    )


def each(path: str, **attributes: str | None) -> Edit:
    """Set attributes of all elements, or remove them (None)."""

    def edit(root: ET.Element) -> None:
        for element in root.iterfind(path):
            for name, value in attributes.items():
                if value is None:
                    element.attrib.pop(name, None)
                else:
                    element.set(name, value)

    return edit


def scaled(path: str, attribute: str, factor: float, only: int | None = None) -> Edit:
    """Multiply the numbers of an attribute, in one element or in all."""

    def edit(root: ET.Element) -> None:
        having = [element for element in root.iterfind(path) if attribute in element.attrib]
        for element in having if only is None else [having[only]]:
            element.set(attribute, numbers(factor * vector(element, attribute)))

    return edit


def text_set(path: str, value: str | None, only: int | None = None) -> Edit:
    """Replace the text of one or all elements; None removes the elements."""

    def edit(root: ET.Element) -> None:
        parents = {child: parent for parent in root.iter() for child in parent}
        found = root.findall(path)
        for element in found if only is None else [found[only]]:
            if value is None:
                parents[element].remove(element)
            else:
                element.text = value

    return edit


def text_scaled(path: str, *factors: float, only: int | None = None) -> Edit:
    """Multiply the numbers in the text of elements, one by one."""

    def edit(root: ET.Element) -> None:
        found = root.findall(path)
        for element in found if only is None else [found[only]]:
            element.text = numbers(np.array((element.text or "").split(), float) * factors)

    return edit


def both(*edits: Edit) -> Edit:
    """Apply several edits in sequence."""
    return lambda root: [edit(root) for edit in edits]


def vector(element: ET.Element, attribute: str) -> np.ndarray:
    return np.array(element.attrib[attribute].split(), float)


def numbers(values: object) -> str:
    return " ".join(repr(float(x)) for x in np.atleast_1d(values))


def written_with(digits: str) -> Edit:
    """Write every number of the file in another format."""

    def shortened(text: str) -> str:
        return re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda m: format(float(m[0]), digits), text)

    def edit(root: ET.Element) -> None:
        for element in root.iter():
            for name, value in element.attrib.items():
                element.set(name, value if name == "version" else shortened(value))
            element.text = shortened(element.text or "")

    return edit


def flag(*names: str) -> Edit:
    """Remove flags that disable something."""
    return each("option/flag", **dict.fromkeys(names))


def attribute_moved(path: str, name: str) -> Edit:
    """Swap the values of the first two successive elements whose values differ."""

    def edit(root: ET.Element) -> None:
        having = [element for element in root.iterfind(path) if name in element.attrib]
        one, other = next((a, b) for a, b in itertools.pairwise(having) if vector(a, name) != vector(b, name))
        one.attrib[name], other.attrib[name] = other.attrib[name], one.attrib[name]

    return edit


def hinges_reversed(root: ET.Element) -> None:
    for body in root.iter("body"):
        joints = body.findall("joint")
        for joint in joints:
            body.remove(joint)
        for joint in reversed(joints):
            body.insert(0 if joint is joints[-1] else 1, joint)
        body[:] = sorted(body, key=lambda e: e.tag != "joint")


def without_motors(root: ET.Element) -> None:
    """Remove actuators and keyframes, which depend on joint names and numbers."""
    for part in (*root.findall("actuator"), *root.findall("keyframe")):
        root.remove(part)


def unnamed(root: ET.Element) -> None:
    without_motors(root)
    for k, joint in enumerate(root.iter("joint")):
        joint.set("name", f"dof{k}")


def frame_quaternion(root: ET.Element) -> None:
    """Write x y z w instead of w x y z, in the first rotated body."""
    body = next(b for b in root.iter("body") if abs(vector(b, "quat")[0]) < 1)
    w, x, y, z = vector(body, "quat")
    body.set("quat", numbers([x, y, z, w]))


def frame_moved(path: str, attribute: str, k: int, by: tuple[float, ...]) -> Edit:
    def edit(root: ET.Element) -> None:
        element = root.findall(path)[k]
        element.set(attribute, numbers(vector(element, attribute) + by))

    return edit


def about_joint(root: ET.Element) -> None:
    for e in root.iter("inertial"):
        c, m = vector(e, "pos"), float(e.attrib["mass"])
        e.set("diaginertia", numbers(vector(e, "diaginertia") + m * (c @ c - c**2)))


def urdf_about_joint(root: ET.Element) -> None:
    for e in root.iter("inertial"):
        c, m = vector(e.find("origin"), "xyz"), float(e.find("mass").attrib["value"])
        more, I = m * (c @ c * np.eye(3) - np.outer(c, c)), e.find("inertia")
        for name, (i, j) in UPPER_TRIANGLE.items():
            I.set(name, numbers(float(I.attrib[name]) + more[i, j]))


def with_geoms(**attributes: str) -> Edit:
    def edit(root: ET.Element) -> None:
        for body in root.iter("body"):
            ET.SubElement(body, "geom", {"type": "capsule", "fromto": "0 0 0 0.2 0 0", "size": "0.01"} | attributes)

    return edit


def first_joint_gone(root: ET.Element) -> None:
    without_motors(root)
    body = next(root.iter("body"))
    body.remove(body.find("joint"))


def added(path: str, tag: str, **attributes: str) -> Edit:
    return lambda root: ET.SubElement(root.find(path), tag, attributes)


def servo(root: ET.Element) -> None:
    ET.SubElement(ET.SubElement(root, "actuator"), "position", joint="upper", kp="100")


def slender(root: ET.Element) -> None:
    """Give moments of inertia that violate the triangle inequality; the compiler then makes them equal."""
    next(root.iter("inertial")).set("diaginertia", "0.001 0.001 0.01")


def sdf_about_joint(root: ET.Element) -> None:
    for e in root.iter("inertial"):
        c, m = np.array(e.findtext("pose").split()[:3], float), float(e.findtext("mass"))
        more = m * (c @ c * np.eye(3) - np.outer(c, c))
        for name, (i, j) in UPPER_TRIANGLE.items():
            element = e.find(f"inertia/{name}")
            element.text = numbers(float(element.text) + more[i, j])


def effort_0(root: ET.Element) -> None:
    """Set effort 0, for which Drake makes no actuator and drops the rotor."""
    ET.SubElement(ET.SubElement(next(root.iter("axis")), "limit"), "effort").text = "0"


def expressed_in_model(root: ET.Element) -> None:
    """Express the axis of a distal joint, whose frame is rotated, in the model's frame."""
    root.findall(".//axis/xyz")[5].set("expressed_in", "__model__")


def impossible_without_a_world(root: ET.Element) -> None:
    """Give an inertia that is impossible; Drake refuses it in a world, but not in a model."""
    text_set(".//izz", "9", only=-1)(root)
    world = root[0]
    root[:] = world.findall("model")


def inertial_turned(root: ET.Element) -> None:
    for pose in root.findall(".//inertial/pose"):
        pose.text = " ".join([*pose.text.split()[:5], "0.3"])


for prefix, uri in {"drake": "http://drake.mit.edu", "flexlink": "urn:flexlink"}.items():
    ET.register_namespace(prefix, uri)
PER_DEGREE = math.pi / 180
DEGREES = cause("stiffness", "scaled_by", PER_DEGREE)
OPTION, COMPILER = "option", "compiler"
JOINT, BODY, INERTIAL = ".//joint", ".//body", ".//inertial"
OWN = "joint/flexlink"
ROTOR, SPRING, INERTIAS = ".//{http://drake.mit.edu}rotor_inertia", ".//spring_stiffness", ("ixx", "iyy", "izz")

PLANTED = (
    Planted("mjcf", "angles in degrees by default", each(COMPILER, angle=None), "18 joints"),
    Planted("mjcf", "rest angles left out", each(JOINT, springref=None), "18 joints"),
    Planted("mjcf", "springs left out", each(JOINT, stiffness=None), "18 joints"),
    Planted("mjcf", "stiffness per degree", scaled(JOINT, "stiffness", PER_DEGREE), DEGREES),
    Planted("mjcf", "one spring doubled", scaled(JOINT, "stiffness", 2, only=5), cause("stiffness", "scaled_by", 2)),
    Planted("mjcf", "spring at another joint", attribute_moved(JOINT, "stiffness"), cause("stiffness", "permuted")),
    Planted("mjcf", "springs disabled", each("option/flag", spring="disable"),
            cause("stiffness", "all_zero", setting="no springs")),
    Planted("mjcf", "armature left out", each(JOINT, armature=None), "3 joints"),
    Planted("mjcf", "armature added to all", each(JOINT, armature="0.01"), "20 joints"),
    Planted("mjcf", "gravity off", each(OPTION, gravity="0 0 0"), cause("gravity", "all_zero")),
    Planted("mjcf", "gravity disabled", each("option/flag", gravity="disable"), cause("gravity", "all_zero")),
    Planted("mjcf", "gravity the other way", each(OPTION, gravity="0 0 -9.81"), cause("gravity", "scaled_by", -1)),
    Planted("mjcf", "gravity 9.8", each(OPTION, gravity="0 0 9.8"), cause("gravity", "proportional")),
    Planted("mjcf", "gravity along y", each(OPTION, gravity="0 9.81 0"), cause("gravity", "same_length")),
    Planted("mjcf", "damping left out", each(JOINT, damping=None), "21 joints"),
    Planted("mjcf", "dampers disabled", each("option/flag", damper="disable"),
            cause("damping", "all_zero", setting="no dampers")),
    Planted("mjcf", "Coulomb torque left out", each(JOINT, frictionloss=None), "3 joints"),
    Planted("mjcf", "frictionloss as well", flag("frictionloss", "constraint"), "frictionloss"),
    Planted("mjcf", "axis flipped", scaled(JOINT, "axis", -1, only=5), cause("axes", "any_difference")),
    Planted("mjcf", "hinges in another order", hinges_reversed),
    Planted("mjcf", "hinges in another order, without names", both(hinges_reversed, unnamed)),
    Planted("mjcf", "6 digits", written_with(".6g"), "%.17g"),
    Planted("mjcf", "10 digits", written_with(".10g"), "%.17g"),
    Planted("mjcf", "7 decimals", written_with(".7f"), "%.17g"),
    Planted("mjcf", "inertia from geoms", both(each(COMPILER, inertiafromgeom="true"), with_geoms()),
            cause("masses", "any_difference", setting="inertiafromgeom")),
    Planted("mjcf", "inertial quaternion", each(INERTIAL, quat="0.8 0.6 0 0"), cause("inertias", "axes_rotated")),
    Planted("mjcf", "frame's quaternion x y z w", frame_quaternion, "168.2°"),
    Planted("mjcf", "frame displaced", frame_moved(BODY, "pos", 4, (0.0, 1e-3, 0.0)), "0.001 m"),
    Planted("mjcf", "inertia about the joint", about_joint, cause("inertias", "about_joint")),
    Planted("mjcf", "mass floor", each(COMPILER, boundmass="0.2"), "boundmass"),
    Planted("mjcf", "inertia floor", each(COMPILER, boundinertia="0.001"), "boundinertia"),
    Planted("mjcf", "balanceinertia", both(each(COMPILER, balanceinertia="true"), slender), "balanceinertia"),
    Planted("mjcf", "masses scaled to a total", each(COMPILER, settotalmass="10"),
            cause("masses", "any_difference", setting="settotalmass")),
    Planted("mjcf", "grams", both(scaled(INERTIAL, "mass", 1e3), scaled(INERTIAL, "diaginertia", 1e3)),
            cause("masses", "scaled_by", 1000)),
    Planted("mjcf", "another density", scaled(INERTIAL, "mass", 2.71 / 2.70), cause("masses", "proportional")),
    Planted("mjcf", "payload left out", scaled(INERTIAL, "mass", 0.5, only=-2), cause("masses", "one_too_light")),
    Planted("mjcf", "centre of mass in the joint", each(INERTIAL, pos="0 0 0"), cause("centers", "any_difference")),
    Planted("mjcf", "ref for springref", each(JOINT, ref="0.1"), cause("centers", "any_difference", setting="ref")),
    Planted("mjcf", "limits active", both(flag("limit", "constraint"), each(JOINT, limited="true", range="-1.5 1.5")),
            "21 joints"),
    Planted("mjcf", "contacts active", both(flag("contact", "constraint"), with_geoms(mass="0")), 'contact="disable"'),
    Planted("mjcf", "gravity compensated", each(BODY, gravcomp="1"), "10 bodies"),
    Planted("mjcf", "air", each(OPTION, density="1.2", viscosity="1e-5"), "density"),
    Planted("mjcf", "damping implicit", each(OPTION, integrator="Euler"), "Euler"),
    Planted("mjcf", "damping implicit, always", each(OPTION, integrator="implicitfast"), "Implicitfast"),
    Planted("mjcf", "discrete integrator", each(OPTION, integrator="discrete"), "Discrete"),
    Planted("mjcf", "autoreset", flag("autoreset"), "autoreset"),
    Planted("mjcf", "a servo holds a joint", servo, cause("servo_stiffness", "none_expected")),
    Planted("mjcf", "step of 10 ms", each(OPTION, timestep="0.01"), "0.01 s > "),
    Planted("mjcf", "a joint is missing", first_joint_gone, "20 joints"),
    Planted("urdf", "armature left out", each(OWN, armature="0"), "3 joints"),
    Planted("urdf", "springs left out", each(OWN, stiffness="0"), "18 joints"),
    Planted("urdf", "rest angles left out", each(OWN, rest="0"), "18 joints"),
    Planted("urdf", "rest angles in degrees", scaled(OWN, "rest", 1 / PER_DEGREE), DEGREES),
    Planted("urdf", "gravity the other way", each("flexlink", gravity="0 0 -9.81"), cause("gravity", "scaled_by", -1)),
    Planted("urdf", "damping left out", each("joint/dynamics", damping="0"), "21 joints"),
    Planted("urdf", "inertial rotation added", each(".//inertial/origin", rpy="0 0 0.3"),
            cause("inertias", "axes_rotated")),
    Planted("urdf", "axis flipped", scaled("joint/axis", "xyz", -1, only=4), cause("axes", "any_difference")),
    Planted("urdf", "rotations in degrees", scaled("joint/origin", "rpy", 1 / PER_DEGREE), "joint 'waist'"),
    Planted("urdf", "6 digits", written_with(".6g"), "%.17g"),
    Planted("urdf", "frame displaced", frame_moved("joint/origin", "xyz", 3, (0.0, 0.0, 0.01)), "0.01 m"),
    Planted("urdf", "inertia about the joint", urdf_about_joint, cause("inertias", "about_joint")),
    Planted("urdf", "mass left out", scaled(".//mass", "value", 0, only=2), cause("masses", "all_zero")),
    Planted("urdf", "pounds", scaled(".//mass", "value", 1 / 0.45359237), cause("masses", "proportional")),
    Planted("sdf", "rotors left out", text_set(ROTOR, None), "3 joints"),
    Planted("sdf", "no actuator, no rotor", effort_0, "joint 'waist'"),
    Planted("sdf", "springs left out", text_set(SPRING, "0"), "18 joints"),
    Planted("sdf", "stiffness per degree", text_scaled(SPRING, PER_DEGREE), DEGREES),
    Planted("sdf", "rest angles left out", text_set(".//spring_reference", None), "18 joints"),
    Planted("sdf", "damping left out", text_set(".//damping", "0"), "21 joints"),
    Planted("sdf", "Coulomb torque left out", text_set(".//friction", "0"), "3 joints"),
    Planted("sdf", "gravity the other way", text_set("world/gravity", "0 0 -9.81"), cause("gravity", "scaled_by", -1)),
    Planted("sdf", "axis flipped", text_scaled(".//xyz", -1, -1, -1, only=4), cause("axes", "any_difference")),
    Planted("sdf", "axes of another frame", expressed_in_model, "(0.920651, "),
    Planted("sdf", "6 digits", written_with(".6g"), "%.17g"),
    Planted("sdf", "rotations in degrees", text_scaled("world/model/link/pose", 1, 1, 1, *[1 / PER_DEGREE] * 3),
            "joint 'waist'"),
    Planted("sdf", "inertial left out weighs 1 kg", text_set(".//inertial", None, only=1), " kg"),
    Planted("sdf", "an inertia that no body can have",
            impossible_without_a_world, cause("inertias", "water_sphere")),
    Planted("sdf", "inertial rotated", inertial_turned, cause("inertias", "axes_rotated")),
    Planted("sdf", "inertia about the joint", sdf_about_joint, cause("inertias", "about_joint")),
    Planted("sdf", "payload left out", text_scaled(".//mass", 0.5, only=-1), cause("masses", "one_too_light")),
    Planted("sdf", "grams", both(text_scaled(".//mass", 1e3), *(text_scaled(f".//{i}", 1e3) for i in INERTIAS)),
            cause("masses", "scaled_by", 1000)),
)  # fmt: skip
