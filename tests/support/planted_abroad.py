"""Mistakes planted into files of `handwritten`; each has its styles (hands), an edit, and a part of the finding."""

from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from tests.support.handwritten import SIX
from tests.support.planted import (
    BODY,
    COMPILER,
    DEGREES,
    INERTIAL,
    OPTION,
    PER_DEGREE,
    SPRING,
    Edit,
    both,
    cause,
    each,
    frame_moved,
    numbers,
    scaled,
    text_scaled,
    text_set,
    vector,
)


class Abroad(NamedTuple):
    """A mistake in files of the styles `hands`; the first finding contains `named`: a name, a value or its cause."""

    hands: tuple[str, ...]
    mistake: str
    edit: Edit
    named: str = ""


def one(path: str, k: int, **attributes: str) -> Edit:
    """Set attributes of one element."""
    return lambda root: root.findall(path)[k].attrib.update(attributes)


def axis_exchanged(path: str, k: int, attribute: str) -> Edit:
    """Exchange axes cyclically: X for Y, Y for Z, Z for X."""
    return lambda root: (e := root.findall(path)[k]).set(attribute, numbers(np.roll(vector(e, attribute), 1)))


def axis_permuted(root: ET.Element) -> None:
    xyz = root.findall(".//axis/xyz")[1]
    xyz.text = numbers(np.roll(np.array(xyz.text.split(), float), 1))


def products_negated(path: str, only: int | None = None) -> Edit:
    """Negate the products of inertia of fullinertia, or of URDF's attributes."""

    def edit(root: ET.Element) -> None:
        found = root.findall(path)
        for element in found if only is None else [found[only]]:
            if "fullinertia" in element.attrib:
                element.set("fullinertia", numbers(vector(element, "fullinertia") * [1, 1, 1, -1, -1, -1]))
            for name in set(OFF) & element.attrib.keys():
                element.set(name, numbers(-vector(element, name)))

    return edit


def inertia_times(factor: float, only: int | None = None) -> Edit:
    """Multiply an inertia of URDF."""
    return both(*(scaled(".//inertia", name, factor, only=only) for name in SIX))


def in_place_of_motors(kind: str, **attributes: str) -> Edit:
    def edit(root: ET.Element) -> None:
        for motor in root.findall(MOTOR):
            motor.tag, motor.attrib = kind, {"joint": motor.attrib["joint"]} | attributes

    return edit


def motor_at_a_spring(root: ET.Element) -> None:
    spring = next(joint for joint in root.findall(HINGE) if "stiffness" in joint.attrib)
    root.findall(MOTOR)[2].set("joint", spring.attrib["name"])


def motor_gone(root: ET.Element) -> None:
    actuators = root.find("actuator")
    actuators.remove(actuators[1])


def transmission_at_a_spring(root: ET.Element) -> None:
    names = {joint.get("name") for joint in root.findall("joint[@type='revolute']")}
    driven = {joint.get("name") for joint in root.findall("transmission/joint")}
    root.findall("transmission/joint")[1].set("name", min(names - driven))


OFF = ("ixy", "ixz", "iyz")
HINGE, MOTOR, SERVO, LINKS = ".//worldbody//joint", "actuator/motor", "actuator/position", "joint/origin"
MJCF, ALL_MJCF, FULL = ("degrees", "welded"), ("degrees", "welded", "servos"), ("degrees", "servos")
URDF, LIMITED, TURNED = ("turned", "aligned", "parts"), ("aligned", "shuffled"), ("turned", "parts")
MM, INCH = 1e3, 1 / 0.0254

ABROAD = (
    Abroad(MJCF, "gear 50", each(MOTOR, gear="50"), "3 joints ('slew', 'boom', 'jib')"),
    Abroad(MJCF, "gear -1", one(MOTOR, 1, gear="-1"), cause("gear", "scaled_by", -1)),
    Abroad(MJCF, "motor at the wrong joint", motor_at_a_spring, cause("gear", "permuted")),
    Abroad(MJCF, "motor left out", motor_gone, "joint 'boom'"),
    Abroad(MJCF, "forcerange", each(MOTOR, forcerange="-1 1", forcelimited="true"), "±1 N m"),
    Abroad(MJCF, "ctrlrange", each(MOTOR, ctrlrange="-1 1", ctrllimited="true"), "±1 N m"),
    Abroad(MJCF, "actuatorfrcrange", one(HINGE, 1, actuatorfrcrange="-1 1", actuatorfrclimited="true"),
           "joint 'boom': ±1 N m"),
    Abroad(MJCF, "one-sided forcerange", each(MOTOR, forcerange="0 500", forcelimited="true"),
           cause("effort", "one_sided")),
    Abroad(MJCF, "servos for motors", in_place_of_motors("position", kp="1000"),
           cause("servo_stiffness", "none_expected")),
    Abroad(MJCF, "velocity servos for motors", in_place_of_motors("velocity", kv="10"), "3 joints"),
    Abroad(("servos",), "kp doubled", scaled(SERVO, "kp", 2), "3 joints"),
    Abroad(("servos",), "kp per degree", scaled(SERVO, "kp", PER_DEGREE), DEGREES),
    Abroad(("servos",), "kv left out", each(SERVO, kv=None), "3 joints"),
    Abroad(("servos",), "geared servos", each(SERVO, gear="2"), "3 joints"),
    Abroad(("servos",), "servos of 1 N m", each(SERVO, forcerange="-1 1", forcelimited="true"), "±1 N m"),
    Abroad(ALL_MJCF, "one pos in mm", scaled(BODY, "pos", MM, only=2), "1000 times"),
    Abroad(("welded",), "the base's pos in mm", scaled(BODY, "pos", MM, only=0), cause("far")),
    Abroad(ALL_MJCF, "all pos in mm", scaled(BODY, "pos", MM), cause("millimetres")),
    Abroad(ALL_MJCF, "two pos in mm", both(*(scaled(BODY, "pos", MM, only=k) for k in (2, 4))), "1000 times"),
    Abroad(ALL_MJCF, "pos in cm", scaled(BODY, "pos", 100, only=1), cause("centimetres")),
    Abroad(ALL_MJCF, "pos in inches", scaled(BODY, "pos", INCH, only=3), cause("inches")),
    Abroad(FULL, "centre in mm", scaled(INERTIAL, "pos", MM, only=2), cause("centers", "lever_scaled", 1000)),
    Abroad(FULL, "pos and centres in mm", both(scaled(BODY, "pos", MM), scaled(INERTIAL, "pos", MM)),
           cause("millimetres")),
    Abroad(ALL_MJCF, "wrong axis", axis_exchanged(HINGE, 1, "axis"), "joint 'boom'"),
    Abroad(ALL_MJCF, "wrong axis at the end", axis_exchanged(HINGE, -1, "axis"), "joint 'jib.2.y'"),
    Abroad(ALL_MJCF, "wrong axes of two springs", both(*(axis_exchanged(HINGE, k, "axis") for k in (2, 3))),
           "joint 'boom.1.z'"),
    Abroad(ALL_MJCF, "axis flipped", scaled(HINGE, "axis", -1, only=1), cause("axes", "any_difference")),
    Abroad(ALL_MJCF, "joint placed elsewhere in its body", frame_moved(HINGE, "pos", 2, (0.1, 0.05, -0.1)),
           cause("position")),
    Abroad(ALL_MJCF, "frame displaced", frame_moved(BODY, "pos", 2, (0.0, 0.07, 0.02)), cause("frame")),
    Abroad(("degrees",), "euler in another order", each(COMPILER, eulerseq="zyx"), cause("frame")),
    Abroad(("degrees",), "euler in radians", each(COMPILER, angle="radian"), cause("frame")),
    Abroad(ALL_MJCF, "springdamper", one(HINGE, 2, springdamper="0.05 1"), "springdamper"),
    Abroad(FULL, "sign of the products", products_negated(INERTIAL, only=0), cause("inertias", "products_negated")),
    Abroad(("servos",), "signs of all products", products_negated(INERTIAL), cause("inertias", "products_negated")),
    Abroad(FULL, "inertia times 4", scaled(INERTIAL, "fullinertia", 4, only=2), "factor 4"),
    Abroad(("welded",), "inertia times 4", scaled(INERTIAL, "diaginertia", 4, only=2), "factor 4"),
    Abroad(FULL, "inertias in kg mm²", scaled(INERTIAL, "fullinertia", 1e6), "kg mm²"),
    Abroad(("welded",), "order of the inertial quaternion", one(INERTIAL, 2, quat="0 1 0 0"), " kg m²"),
    Abroad(ALL_MJCF, "springref of one joint", one(HINGE, 2, springref="0.1"), "springref"),
    Abroad(ALL_MJCF, "stiffness per degree", scaled(HINGE, "stiffness", PER_DEGREE), DEGREES),
    Abroad(ALL_MJCF, "one spring doubled", scaled(HINGE, "stiffness", 2, only=0), cause("stiffness", "scaled_by", 2)),
    Abroad(ALL_MJCF, "rotors left out", each(HINGE, armature=None), "3 joints ('slew', 'boom', 'jib')"),
    Abroad(ALL_MJCF, "rotors everywhere", each(HINGE, armature="0.01"), "10 joints"),
    Abroad(ALL_MJCF, "damping left out", each("default/default/joint", damping=None), " N m s/rad"),
    Abroad(ALL_MJCF, "payload forgotten", one(INERTIAL, -1, mass="0.5"), cause("masses", "one_too_light")),
    Abroad(ALL_MJCF, "gravity compensated", one(BODY, 2, gravcomp="1"), "1 body"),
    Abroad(ALL_MJCF, "gravity the other way", each(OPTION, gravity="0 0 -9.81"), cause("gravity", "scaled_by", -1)),
    Abroad(ALL_MJCF, "limits active", each(HINGE, limited="true", range="-1 1"), "10 joints"),
    Abroad(ALL_MJCF, "step of 2 ms", each(OPTION, timestep="0.002"), "0.002 s > 0.00"),
    Abroad(ALL_MJCF, "step of 2 ms, RK4", each(OPTION, timestep="0.002", integrator="RK4"), "0.002 s > 0.00"),
    Abroad(("turned", "aligned"), "one xyz in mm", scaled(LINKS, "xyz", MM, only=4), "1000 times"),
    Abroad(URDF, "all xyz in cm", scaled("joint[@type='revolute']/origin", "xyz", 100), cause("centimetres")),
    Abroad(TURNED, "rpy in degrees", scaled(LINKS, "rpy", 1 / PER_DEGREE), cause("frame")),
    Abroad(URDF, "wrong axis", axis_exchanged("joint/axis", 1, "xyz"), "joint 'boom'"),
    Abroad(URDF, "axis flipped", scaled("joint/axis", "xyz", -1, only=1), cause("axes", "any_difference")),
    Abroad(("turned", "aligned"), "sign of the products", products_negated(".//inertia", only=0),
           cause("inertias", "products_negated")),
    Abroad(("turned", "aligned"), "inertia times 4", inertia_times(4, only=2), "factor 4"),
    Abroad(("parts",), "inertia of a part times 4", inertia_times(4, only=2), "factor 4"),
    Abroad(("turned", "aligned"), "inertias in g mm²", inertia_times(1e9), "g mm²"),
    Abroad(("principal",), "rotation of inertials left out", each(".//inertial/origin", rpy=None),
           cause("inertias", "axes_rotated")),
    Abroad(("turned", "aligned"), "centre in mm", scaled(".//inertial/origin", "xyz", MM, only=2),
           cause("centers", "lever_scaled", 1000)),
    Abroad(URDF, "pounds", scaled(".//mass", "value", 1 / 0.45359237), cause("masses", "proportional")),
    Abroad(URDF, "damping left out", each("joint/dynamics", damping="0"), " N m s/rad"),
    Abroad(URDF, "effort of 1 N m", each("joint/limit", effort="1"), "3 joints ('slew', 'boom', 'jib'): ±1 N m"),
    Abroad(LIMITED, "transmission at the wrong joint", transmission_at_a_spring, cause("gear", "permuted")),
    Abroad(LIMITED, "reduction 50", text_set(".//mechanicalReduction", "50"), "factor 50"),
    Abroad(("relative",), "effort of 1 N m", text_set(".//limit/effort", "1"), "±1 N m"),
    Abroad(("relative", "model"), "wrong axis", axis_permuted, "joint 'boom'"),
    Abroad(("relative",), "one pose in mm", text_scaled(".//link/pose", MM, MM, MM, 1, 1, 1, only=4), "1000 times"),
    Abroad(("relative",), "sign of the products", both(*(text_scaled(f".//{i}", -1, only=0) for i in OFF)),
           cause("inertias", "products_negated")),
    Abroad(("relative", "model"), "stiffness per degree", text_scaled(SPRING, PER_DEGREE), DEGREES),
)  # fmt: skip
