"""The table of mistakes: which field differs, how, what was probably done, and what to change.

The first row that fits is taken, so that rows with a special shape, or with a setting of the engine as evidence, stand
before general ones. `{tag}` is what the file calls the field.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexlink.engines.read_back import OF_JOINTS
from flexlink.engines.shapes import (
    Shape,
    about_the_joint,
    alike,
    anything,
    ball_of_water,
    extra,
    larger,
    less_in_one,
    missing,
    moved,
    proportional,
    same_length,
    times,
    turned,
)


class Field(NamedTuple):
    """A field of the record in words: what is counted (joints, bodies), unit, and its place in each format."""

    label: str
    unit: str
    mjcf: str
    urdf: str
    sdf: str


FIELDS = {
    "gravity": Field("gravity", "m/s²", "option gravity", "<flexlink gravity> of the robot", "<gravity> of the world"),
    "axes": Field("axis", "", "joint axis", "<axis xyz>", "<axis><xyz>"),
    "lines": Field("axis", "m", "body pos, quat, euler or joint pos", "<origin xyz rpy> of the joint", "<pose>"),
    "tip": Field("tip frame", "m", 'pos of body "tip"', "<origin> of the joint of link tip", "<pose> of frame tip"),
    "masses": Field("mass", "kg", "inertial mass", "<mass>", "<mass>"),
    "centers": Field("centre of mass", "m", "inertial pos", "<inertial><origin xyz>", "<inertial><pose>"),
    "inertias": Field(
        "inertia", "kg m²", "inertial diaginertia, fullinertia, quat", "<inertia> and <inertial><origin rpy>",
        "<inertia> and <inertial><pose>",
    ),
    "stiffness": Field("spring stiffness", "N m/rad", "joint stiffness", "<flexlink stiffness>", "<spring_stiffness>"),
    "rest": Field("rest angle", "rad", "joint springref", "<flexlink rest>", "<spring_reference>"),
    "damping": Field("damping", "N m s/rad", "joint damping", "<dynamics damping>", "<damping>"),
    "coulomb": Field("Coulomb torque", "N m", "joint frictionloss", "<dynamics friction>", "<friction>"),
    "coulomb_width": Field(
        "width of the Coulomb torque", "rad/s", "joint user", "<flexlink coulomb_width>", "<flexlink:coulomb_width>"
    ),
    "armature": Field("armature", "kg m²", "joint armature", "<flexlink armature>", "<drake:rotor_inertia>"),
}  # fmt: skip


class Setting(NamedTuple):
    """What the engine was told beside numbers; `counts` unless it leaves right runs as they are."""

    what: str
    change: str
    counts: bool = True


SETTINGS = {
    "integrator": Setting("the integrator is {value}", 'option integrator="RK4"'),
    "contacts": Setting("contacts are active: {value}", 'flag contact="disable", or geoms without contype'),
    "limits": Setting("limits are active: {value}", 'flag limit="disable", or limited="false"'),
    "frictionloss": Setting(
        "frictionloss acts as a constraint, where the scene has c tanh(q̇/w): {value}", 'flag frictionloss="disable"'
    ),
    "equality": Setting("equality constraints are active: {value}", 'flag equality="disable"'),
    "gravcomp": Setting("gravcomp takes gravity off: {value}", "no gravcomp"),
    "fluid": Setting("a fluid drags: {value}", "option density and viscosity 0"),
    "actuators": Setting("actuators push without a command: {value}", "motors instead of position or velocity servos"),
    "tendons": Setting("tendons pull: {value}", "no stiffness, damping or friction of tendons"),
    "step": Setting("the time step is beyond the largest stable one: {value}", "option timestep"),
    "autoreset": Setting(
        "a run that diverges restarts silently (autoreset)", 'flag autoreset="disable"', counts=False
    ),
}  # fmt: skip


class Mistake(NamedTuple):
    """If `field` differs in this `shape`, and the engine was told `setting`, then `likely`; `change` puts it right."""

    field: str
    shape: Shape
    likely: str
    change: str
    setting: str = ""


DEGREE, GRAM = math.pi / 180, 1e-3
IN_UNITS = "{tag}, in {unit}"
ZERO, NO_REF = "the joint's zero is shifted", "joint ref: leave it out, or add it to every angle"
BALANCED = "balanceinertia makes the three moments equal"
SHAPES = "the engine takes masses from the shapes of geoms"
FROM_INERTIAL = 'compiler inertiafromgeom="false", and an <inertial> in every body'
RULE = "{tag}: none negative, none larger than the other two together"
QUATERNION = "order of the quaternion (w x y z in MJCF), order of roll, pitch and yaw, or degrees for radians"

MISTAKES: tuple[Mistake, ...] = (
    Mistake("gravity", missing, "gravity is off", "{tag}, and no flag that disables it"),
    Mistake("gravity", times(-1), "gravity has the wrong sign", "{tag}: frame 0 of the scene may have Z downward"),
    Mistake("gravity", proportional, "another value of g", "{tag}"),
    Mistake("gravity", same_length, "gravity along another axis", "{tag}, or turn the base"),
    Mistake("gravity", anything, "another gravity", "{tag}"),
    Mistake("axes", anything, "the axis is flipped", "the sign of {tag}, or the signs of angle, rest and torque"),
    Mistake("lines", anything, ZERO, NO_REF, "ref"),
    Mistake("centers", anything, ZERO, NO_REF, "ref"),
    Mistake("inertias", anything, ZERO, NO_REF, "ref"),
    Mistake("lines", anything, "the frame is placed elsewhere", "{tag}: offset, " + QUATERNION),
    Mistake("tip", anything, "the tip frame is placed elsewhere", "{tag}"),
    Mistake("masses", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    Mistake("masses", larger, "small masses are raised to a floor", 'compiler boundmass="0"', "boundmass"),
    Mistake("masses", anything, "masses are scaled to a total", "compiler without settotalmass", "settotalmass"),
    Mistake("masses", missing, "the mass is left out, or is no number to the engine", "{tag}"),
    Mistake("masses", times(1 / GRAM), "grams for kilograms", IN_UNITS),
    Mistake("masses", proportional, "another density", "density, or {tag}"),
    Mistake("masses", less_in_one, "a part is left out (payload, hub, motor)", "{tag}"),
    Mistake("masses", anything, "another mass", "{tag}"),
    Mistake("centers", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    Mistake("centers", anything, "the centre is given in another frame, or left out", "{tag}, in the body's frame"),
    Mistake("inertias", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    Mistake("inertias", larger, "small moments are raised to a floor", 'compiler boundinertia="0"', "boundinertia"),
    Mistake("inertias", alike, BALANCED, 'compiler balanceinertia="false"', "balanceinertia"),
    Mistake("inertias", missing, "the inertia is left out", "{tag}"),
    Mistake("inertias", ball_of_water, "no body can have what the file says, and Drake takes a ball of water", RULE),
    Mistake("inertias", turned, "the rotation of the principal axes is lost or another one", "{tag}: " + QUATERNION),
    Mistake("inertias", about_the_joint, "taken about the joint, not the centre of mass", "{tag}, about the centre"),
    Mistake("inertias", proportional, "another unit or density", IN_UNITS),
    Mistake("inertias", anything, "another inertia", "{tag}: about the centre, products with their signs"),
    Mistake("rest", times(DEGREE), "radians written where degrees are read", 'compiler angle="radian"', "degree"),
    Mistake("damping", missing, "the engine is told to leave dampers out", 'no flag damper="disable"', "no dampers"),
    Mistake("stiffness", missing, "the engine is told to leave springs out", 'no flag spring="disable"', "no springs"),
)  # fmt: skip

DIGITS_LOST = ("digits were lost in writing", "how numbers are written: all 17 digits (repr, %.17g)")
ORDER = ("hinges at one point turn one after another, and order matters", "the order of joints in a body, or of links")

OF_ANY_JOINT = (
    ("left out", missing, "{tag} at every such joint"),
    ("degrees taken for radians", times(DEGREE, 1 / DEGREE), IN_UNITS),
    ("the wrong sign", times(-1), IN_UNITS),
    ("doubled or halved (½ k θ², two sides of a joint)", times(2, 0.5), IN_UNITS),
    ("at another joint", moved, "{tag}: which joint it belongs to"),
    ("added where there is none", extra, "take {tag} out"),
    ("another unit or material", proportional, IN_UNITS),
    ("another value", anything, IN_UNITS),
)
MISTAKES += tuple(
    Mistake(field, shape, likely, change) for field in OF_JOINTS for likely, shape, change in OF_ANY_JOINT
)
