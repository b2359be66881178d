"""Mistakes planted into third-party files (`handwritten`): the styles, the edit, and the expected finding."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from handwritten import SIX
from planted import (
    BODY,
    COMPILER,
    INERTIAL,
    OPTION,
    PER_DEGREE,
    SPRING,
    Edit,
    both,
    each,
    frame_moved,
    numbers,
    said,
    said_times,
    scaled,
    vector,
)


class Abroad(NamedTuple):
    """A mistake in files of the styles `hands` of `handwritten.HANDS`; the first finding must contain `named`."""

    hands: tuple[str, ...]
    mistake: str
    edit: Edit
    named: str


def one(path: str, k: int, **attributes: str) -> Edit:
    """Set attributes of one element."""
    return lambda root: root.findall(path)[k].attrib.update(attributes)


def axis_exchanged(path: str, k: int, attribute: str) -> Edit:
    """Exchange axes cyclically: X for Y, Y for Z, Z for X."""
    return lambda root: (e := root.findall(path)[k]).set(attribute, numbers(np.roll(vector(e, attribute), 1)))


def axis_said_otherwise(root: ET.Element) -> None:
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
FAR = "is 1000 times as far from the joint before: displaced by "
NONE = "±1 N m instead of none: below the largest torque of the scene's drive"
PRODUCTS = "the products of inertia have the opposite sign"
ELSEWHERE = "the frame is misplaced"

ABROAD = (
    Abroad(MJCF, "gear 50", each(MOTOR, gear="50"), "gear of 3 joints ('slew', 'boom', 'jib'): 50 instead of 1"),
    Abroad(MJCF, "gear -1", one(MOTOR, 1, gear="-1"), "in the opposite direction; change the sign of actuator gear"),
    Abroad(MJCF, "motor at the wrong joint", motor_at_a_spring, "the motor is at another joint"),
    Abroad(MJCF, "motor left out", motor_gone, "the scene's drive has no motor here; add a motor at joint 'boom'"),
    Abroad(MJCF, "forcerange", each(MOTOR, forcerange="-1 1", forcelimited="true"), NONE),
    Abroad(MJCF, "ctrlrange", each(MOTOR, ctrlrange="-1 1", ctrllimited="true"), NONE),
    Abroad(MJCF, "actuatorfrcrange", one(HINGE, 1, actuatorfrcrange="-1 1", actuatorfrclimited="true"),
           f"torque limit of joint 'boom': {NONE}"),
    Abroad(MJCF, "one-sided forcerange", each(MOTOR, forcerange="0 500", forcelimited="true"), "one direction only"),
    Abroad(MJCF, "servos for motors", in_place_of_motors("position", kp="1000"), "actuators act without a command"),
    Abroad(MJCF, "velocity servos for motors", in_place_of_motors("velocity", kv="10"), "servo damping of 3 joints"),
    Abroad(("servos",), "kp doubled", scaled(SERVO, "kp", 2), "servo stiffness of 3 joints"),
    Abroad(("servos",), "kp per degree", scaled(SERVO, "kp", PER_DEGREE), "degrees taken for radians"),
    Abroad(("servos",), "kv left out", each(SERVO, kv=None), "servo damping of 3 joints"),
    Abroad(("servos",), "geared servos", each(SERVO, gear="2"), "motor gear of 3 joints"),
    Abroad(("servos",), "servos of 1 N m", each(SERVO, forcerange="-1 1", forcelimited="true"), NONE),
    Abroad(ALL_MJCF, "one pos in mm", scaled(BODY, "pos", MM, only=2), FAR),
    Abroad(("welded",), "the base's pos in mm", scaled(BODY, "pos", MM, only=0), "far outside the arm: millimetres"),
    Abroad(ALL_MJCF, "all pos in mm", scaled(BODY, "pos", MM), "written in millimetres, read in metres; "),
    Abroad(ALL_MJCF, "two pos in mm", both(*(scaled(BODY, "pos", MM, only=k) for k in (2, 4))), FAR),
    Abroad(ALL_MJCF, "pos in cm", scaled(BODY, "pos", 100, only=1), "written in centimetres"),
    Abroad(ALL_MJCF, "pos in inches", scaled(BODY, "pos", INCH, only=3), "written in inches"),
    Abroad(FULL, "centre in mm", scaled(INERTIAL, "pos", MM, only=2), "given in millimetres"),
    Abroad(FULL, "pos and centres in mm", both(scaled(BODY, "pos", MM), scaled(INERTIAL, "pos", MM)), "in millimetres"),
    Abroad(ALL_MJCF, "wrong axis", axis_exchanged(HINGE, 1, "axis"), "joint 'boom' rotates about ("),
    Abroad(ALL_MJCF, "wrong axis at the end", axis_exchanged(HINGE, -1, "axis"), "joint 'jib.2.y' rotates about ("),
    Abroad(ALL_MJCF, "wrong axes of two springs", both(*(axis_exchanged(HINGE, k, "axis") for k in (2, 3))),
           "joint 'boom.1.z' rotates about ("),
    Abroad(ALL_MJCF, "axis flipped", scaled(HINGE, "axis", -1, only=1), "the axis is flipped"),
    Abroad(ALL_MJCF, "joint placed elsewhere in its body", frame_moved(HINGE, "pos", 2, (0.1, 0.05, -0.1)),
           "the joint is misplaced in its body; "),
    Abroad(ALL_MJCF, "frame displaced", frame_moved(BODY, "pos", 2, (0.0, 0.07, 0.02)), ELSEWHERE),
    Abroad(("degrees",), "euler in another order", each(COMPILER, eulerseq="zyx"), ELSEWHERE),
    Abroad(("degrees",), "euler in radians", each(COMPILER, angle="radian"), ELSEWHERE),
    Abroad(ALL_MJCF, "springdamper", one(HINGE, 2, springdamper="0.05 1"), "springdamper overwrites stiffness"),
    Abroad(FULL, "sign of the products", products_negated(INERTIAL, only=0), PRODUCTS),
    Abroad(("servos",), "signs of all products", products_negated(INERTIAL), PRODUCTS),
    Abroad(FULL, "inertia times 4", scaled(INERTIAL, "fullinertia", 4, only=2), "factor 4"),
    Abroad(("welded",), "inertia times 4", scaled(INERTIAL, "diaginertia", 4, only=2), "factor 4 in the inertia of"),
    Abroad(FULL, "inertias in kg mm²", scaled(INERTIAL, "fullinertia", 1e6), "given in kg mm²"),
    Abroad(("welded",), "order of the inertial quaternion", one(INERTIAL, 2, quat="0 1 0 0"), "inertia of joint"),
    Abroad(ALL_MJCF, "springref of one joint", one(HINGE, 2, springref="0.1"), "remove springref from joint 'boom"),
    Abroad(ALL_MJCF, "stiffness per degree", scaled(HINGE, "stiffness", PER_DEGREE), "degrees taken for radians"),
    Abroad(ALL_MJCF, "one spring doubled", scaled(HINGE, "stiffness", 2, only=0), "doubled or halved"),
    Abroad(ALL_MJCF, "rotors left out", each(HINGE, armature=None), "armature of 3 joints ('slew', 'boom', 'jib')"),
    Abroad(ALL_MJCF, "rotors everywhere", each(HINGE, armature="0.01"), "armature of 10 joints"),
    Abroad(ALL_MJCF, "damping left out", each("default/default/joint", damping=None), "damping of "),
    Abroad(ALL_MJCF, "payload forgotten", one(INERTIAL, -1, mass="0.5"), "a part is missing"),
    Abroad(ALL_MJCF, "gravity compensated", one(BODY, 2, gravcomp="1"), "gravcomp cancels gravity on 1 body; "),
    Abroad(ALL_MJCF, "gravity the other way", each(OPTION, gravity="0 0 -9.81"), "gravity has the wrong sign"),
    Abroad(ALL_MJCF, "limits active", each(HINGE, limited="true", range="-1 1"), "limits are active: 10 joints"),
    Abroad(ALL_MJCF, "step of 2 ms", each(OPTION, timestep="0.002"), "0.002 s > 0.00"),
    Abroad(ALL_MJCF, "step of 2 ms, RK4", each(OPTION, timestep="0.002", integrator="RK4"), "0.002 s > 0.00"),
    Abroad(("turned", "aligned"), "one xyz in mm", scaled(LINKS, "xyz", MM, only=4), FAR),
    Abroad(URDF, "all xyz in cm", scaled("joint[@type='revolute']/origin", "xyz", 100), "written in centimetres"),
    Abroad(TURNED, "rpy in degrees", scaled(LINKS, "rpy", 1 / PER_DEGREE), ELSEWHERE),
    Abroad(URDF, "wrong axis", axis_exchanged("joint/axis", 1, "xyz"), "joint 'boom' rotates about ("),
    Abroad(URDF, "axis flipped", scaled("joint/axis", "xyz", -1, only=1), "the axis is flipped"),
    Abroad(("turned", "aligned"), "sign of the products", products_negated(".//inertia", only=0), PRODUCTS),
    Abroad(("turned", "aligned"), "inertia times 4", inertia_times(4, only=2), "factor 4"),
    Abroad(("parts",), "inertia of a part times 4", inertia_times(4, only=2), "factor 4 in the inertia of one"),
    Abroad(("turned", "aligned"), "inertias in g mm²", inertia_times(1e9), "given in g mm²"),
    Abroad(("principal",), "rotation of inertials left out", each(".//inertial/origin", rpy=None), "principal axes"),
    Abroad(("turned", "aligned"), "centre in mm", scaled(".//inertial/origin", "xyz", MM, only=2), "in millimetres"),
    Abroad(URDF, "pounds", scaled(".//mass", "value", 1 / 0.45359237), "another density"),
    Abroad(URDF, "damping left out", each("joint/dynamics", damping="0"), "damping of "),
    Abroad(URDF, "effort of 1 N m", each("joint/limit", effort="1"), f"3 joints ('slew', 'boom', 'jib'): {NONE}"),
    Abroad(LIMITED, "transmission at the wrong joint", transmission_at_a_spring, "the motor is at another joint"),
    Abroad(LIMITED, "reduction 50", said(".//mechanicalReduction", "50"), "50 instead of 1, factor 50"),
    Abroad(("relative",), "effort of 1 N m", said(".//limit/effort", "1"), NONE),
    Abroad(("relative", "model"), "wrong axis", axis_said_otherwise, "joint 'boom' rotates about ("),
    Abroad(("relative",), "one pose in mm", said_times(".//link/pose", MM, MM, MM, 1, 1, 1, only=4), FAR),
    Abroad(("relative",), "sign of the products", both(*(said_times(f".//{i}", -1, only=0) for i in OFF)), PRODUCTS),
    Abroad(("relative", "model"), "stiffness per degree", said_times(SPRING, PER_DEGREE), "degrees taken for radians"),
)  # fmt: skip
