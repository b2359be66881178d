"""The table of mistakes: which field differs, how, what was probably done, and what to do.

The first row that fits is taken, so that rows with a special shape, or with a setting of the engine as evidence, stand
before general ones. `{tag}` is what the file calls the field, `{where}` the joints, `{unit}` the field's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexlink.diagnosis.shapes import (
    Shape,
    about_the_joint,
    alike,
    anything,
    ball_of_water,
    extra,
    larger,
    less_in_one,
    lever_times,
    missing,
    moved,
    narrower,
    one_sided,
    part_times,
    products_negated,
    proportional,
    same_length,
    times,
    turned,
)
from flexlink.engines.read_back import OF_JOINTS


class Field(NamedTuple):
    """A field of the record in words: what is counted (joints, bodies), unit, and its place in each format."""

    label: str
    unit: str
    mjcf: str
    urdf: str
    sdf: str


FIELDS = {
    "gravity": Field("gravity", "m/s²", "option gravity", "gravity", "<gravity>"),
    "axes": Field("axis", "", "axis", "<axis>", "<axis><xyz>"),
    "lines": Field(
        "line of the joint", "", "body pos, quat, euler or joint pos", "<joint><origin>", "<pose> of link or joint"
    ),
    "tip": Field("tip", "m", "pos of body or site tip", "<origin> of the tip's joint", "<pose> of frame tip"),
    "masses": Field("mass", "kg", "inertial mass", "<mass>", "<mass>"),
    "centers": Field("centre of mass", "m", "inertial pos", "<inertial><origin xyz>", "<inertial><pose>"),
    "inertias": Field(
        "inertia", "kg m²", "inertial diaginertia, fullinertia, quat", "<inertia> and <inertial><origin rpy>",
        "<inertia> and <inertial><pose>",
    ),
    "stiffness": Field("spring stiffness", "N m/rad", "stiffness", "<flexlink stiffness>", "<spring_stiffness>"),
    "rest": Field("rest angle", "rad", "springref", "<flexlink rest>", "<spring_reference>"),
    "damping": Field("damping", "N m s/rad", "damping", "<dynamics damping>", "<damping>"),
    "coulomb": Field("Coulomb torque", "N m", "frictionloss", "<dynamics friction>", "<friction>"),
    "coulomb_width": Field(
        "width of the Coulomb torque", "rad/s", "user", "<flexlink coulomb_width>", "<flexlink:coulomb_width>"
    ),
    "armature": Field("armature", "kg m²", "armature", "<flexlink armature>", "<drake:rotor_inertia>"),
    "control": Field("gear of the motor", "", "actuator gear", "<mechanicalReduction>", "<drake:gear_ratio>"),
    "servo_stiffness": Field("servo stiffness", "N m/rad", "actuator kp", "kp", "kp"),
    "servo_damping": Field("servo damping", "N m s/rad", "actuator kv", "kd", "kd"),
    "push": Field("torque without a command", "N m", "actuator biasprm", "", ""),
    "effort": Field(
        "torque limit", "", "actuator forcerange, ctrlrange or joint actuatorfrcrange", "<limit effort>",
        "<limit><effort>",
    ),
}  # fmt: skip


class Setting(NamedTuple):
    """What the engine was told beside numbers; `counts` unless it leaves right runs as they are."""

    what: str
    change: str
    counts: bool = True


SETTINGS = {
    "contacts": Setting("contacts are active: {value}", 'set flag contact="disable", or geoms without contype'),
    "limits": Setting("limits are active: {value}", 'set flag limit="disable", or limited="false"'),
    "frictionloss": Setting(
        "frictionloss acts as a constraint, where the scene has c tanh(q̇/w): {value}", 'set flag frictionloss="disable"'
    ),
    "equality": Setting("equality constraints are active: {value}", 'set flag equality="disable"'),
    "gravcomp": Setting("gravcomp cancels gravity on {value}", "remove it"),
    "fluid": Setting("a fluid drags: {value}", "set option density and viscosity to 0"),
    "tendons": Setting("tendons pull: {value}", "remove their stiffness, damping and friction"),
    "step": Setting("the time step is beyond the largest stable one: {value}", "set option timestep"),
    "integrator": Setting(
        "runs of the file step by {value}, the scene's by RK4", 'set option integrator="RK4" to compare runs',
        counts=False,
    ),
    "other actuators": Setting(
        "actuators other than motors and servos at joints, which are not compared: {value}",
        "compare what they do at a joint by hand", counts=False,
    ),
    "autoreset": Setting(
        "a run that diverges restarts silently (autoreset)", 'set flag autoreset="disable"', counts=False
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
LENGTHS = {1e3: "millimetres", 1e2: "centimetres", 1 / 0.0254: "inches", 1 / 0.3048: "feet"}
"""Units in which lengths are written by mistake, by how much too large they are then."""
INERTIAS = {1e3: "g m²", 1e4: "kg cm²", 1e6: "kg mm²", 1e7: "g cm²", 1e9: "g mm²"}
IN_UNITS = "give {tag} of {where} in {unit}"
CORRECT = "correct {tag} of {where}"
ZERO, NO_REF = "the joint's zero is shifted", "remove joint ref, or add it to every angle"
BALANCED = "balanceinertia makes the three moments equal"
SHAPES = "the engine takes masses from the shapes of geoms"
FROM_INERTIAL = 'set compiler inertiafromgeom="false", and give every body an <inertial>'
SPRINGDAMPER = "springdamper overwrites stiffness and damping by a time constant and a ratio"
RULE = "correct {tag}: none negative, none larger than the other two together"
LEFT_OUT = "the engine is told to leave {} out"
QUATERNION = "order of the quaternion (w x y z in MJCF), order of roll, pitch and yaw, or degrees for radians"
IN_BODY = CORRECT + ", in the body's frame"
TURNED = "the rotation of the principal axes is lost or another one"
PRODUCTS = "the products of inertia have the opposite sign"

MISTAKES: tuple[Mistake, ...] = (
    Mistake("gravity", missing, "gravity is off", "set {tag}, and no flag that disables it"),
    Mistake("gravity", times(-1), "gravity has the wrong sign", "change its sign: the scene may have Z downward"),
    Mistake("gravity", proportional, "another value of g", "correct {tag}"),
    Mistake("gravity", same_length, "gravity along another axis", "correct {tag}, or turn the base"),
    Mistake("gravity", anything, "another gravity", "correct {tag}"),
    Mistake("axes", anything, "the axis is flipped", "change the sign of {tag}, or of angle, rest and torque"),
    Mistake("centers", anything, ZERO, NO_REF, "ref"),
    Mistake("inertias", anything, ZERO, NO_REF, "ref"),
    Mistake("tip", anything, "the tip frame is placed elsewhere", "correct {tag}"),
    Mistake("masses", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    Mistake("masses", larger, "small masses are raised to a floor", 'set compiler boundmass="0"', "boundmass"),
    Mistake("masses", anything, "masses are scaled to a total", "remove compiler settotalmass", "settotalmass"),
    Mistake("masses", missing, "the mass is left out, or is no number to the engine", CORRECT),
    Mistake("masses", times(1 / GRAM), "grams for kilograms", IN_UNITS),
    Mistake("masses", proportional, "another density", "correct density, or {tag}"),
    Mistake("masses", less_in_one, "a part is left out (payload, hub, motor)", CORRECT),
    Mistake("masses", anything, "another mass", CORRECT),
    Mistake("centers", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    *(Mistake("centers", lever_times(f), f"given in {unit}", IN_UNITS) for f, unit in LENGTHS.items()),
    Mistake("centers", anything, "the centre is given in another frame, or left out", IN_BODY),
    Mistake("inertias", anything, SHAPES, FROM_INERTIAL, "inertiafromgeom"),
    Mistake("inertias", larger, "small moments are raised to a floor", 'set compiler boundinertia="0"', "boundinertia"),
    Mistake("inertias", alike, BALANCED, 'set compiler balanceinertia="false"', "balanceinertia"),
    Mistake("inertias", missing, "the inertia is left out", CORRECT),
    Mistake("inertias", ball_of_water, "no body can have what the file says, and Drake takes a ball of water", RULE),
    Mistake("inertias", products_negated, PRODUCTS, "change the signs of ixy, ixz and iyz of {where}"),
    Mistake("inertias", turned, TURNED, "check {tag}: " + QUATERNION),
    Mistake("inertias", about_the_joint, "taken about the joint, not the centre", "give {tag} about the centre"),
    *(Mistake("inertias", times(f), f"given in {unit}", IN_UNITS) for f, unit in INERTIAS.items()),
    Mistake("inertias", proportional, "another unit or density", IN_UNITS),
    Mistake("inertias", part_times, "all moments of one part by one factor", CORRECT),
    Mistake("inertias", anything, "another inertia", CORRECT + ": about the centre, products with their signs"),
    Mistake("stiffness", anything, SPRINGDAMPER, "remove springdamper", "springdamper"),
    Mistake("damping", anything, SPRINGDAMPER, "remove springdamper", "springdamper"),
    Mistake("rest", times(DEGREE), "radians written where degrees are read", 'set compiler angle="radian"', "degree"),
    Mistake("damping", missing, LEFT_OUT.format("dampers"), 'remove flag damper="disable"', "no dampers"),
    Mistake("stiffness", missing, LEFT_OUT.format("springs"), 'remove flag spring="disable"', "no springs"),
    Mistake("control", moved, "the motor is at another joint", "name the right joint in the actuator"),
    Mistake("control", missing, "the scene's drive has no motor here", "add a motor at {where}"),
    Mistake("control", times(-1), "it pushes the other way", "change the sign of {tag}"),
    Mistake("control", anything, "a command of 1 is not 1 N m (of a servo: 1 rad) at the joint", "set {tag} to 1"),
    *(
        Mistake(field, extra, "actuators push without a command", "use motors, or give the scene a PD drive")
        for field in ("servo_stiffness", "servo_damping", "push")
    ),
    Mistake("effort", one_sided, "the limit leaves one direction only", CORRECT),
    Mistake("effort", narrower, "below what the scene's drive may ask for", CORRECT + ", or drive.effort"),
    Mistake("effort", anything, "another limit", CORRECT + ", or drive.effort"),
)  # fmt: skip

DIGITS_LOST = ("digits were lost in writing", "write numbers with all 17 digits (repr, %.17g)")
ORDER = (
    "hinges at one point turn one after another, and order matters",
    "correct the order of joints in a body, or of links",
)

ZERO_SHIFTED = Mistake("lines", anything, ZERO, NO_REF)
PLACES = {
    "axis": Mistake("axes", anything, "another axis", CORRECT),
    "position": Mistake("positions", anything, "the joint is placed elsewhere in its body", CORRECT),
    **{
        unit: Mistake("offsets", anything, f"written in {unit}, read in metres", "give {tag} of {where} in m")
        for unit in LENGTHS.values()
    },
    "far": Mistake("offsets", anything, "far beyond the arm: millimetres for metres?", "give {tag} of {where} in m"),
    "frame": Mistake("lines", anything, "the frame is placed elsewhere", "check {tag}: offset, " + QUATERNION),
}
"""What is said of a line that lies elsewhere, by how it does."""
OF_PLACES = FIELDS | {
    "positions": Field("position", "m", "joint pos", "<joint><origin>", "<joint><pose>"),
    "offsets": Field("offset", "m", "pos", "<joint><origin xyz>", "<pose>"),
}

OF_ANY_JOINT = (
    ("left out", missing, "add {tag} to {where}"),
    ("degrees taken for radians", times(DEGREE, 1 / DEGREE), IN_UNITS),
    ("the wrong sign", times(-1), "change the sign of {tag} of {where}"),
    ("doubled or halved (½ k θ², two sides of a joint)", times(2, 0.5), IN_UNITS),
    ("at another joint", moved, "check which joint {tag} belongs to"),
    ("added where there is none", extra, "remove {tag} from {where}"),
    ("another unit or material", proportional, IN_UNITS),
    ("another value", anything, CORRECT),
)
MISTAKES += tuple(
    Mistake(field, shape, likely, change)
    for field in (*OF_JOINTS, "servo_stiffness", "servo_damping", "push")
    for likely, shape, change in OF_ANY_JOINT
)
