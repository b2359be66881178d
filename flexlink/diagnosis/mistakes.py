"""The table of mistakes: which field differs and how, the likely mistake, and the remedy.

The first row that fits is taken, so that special shapes, and rows with a setting of the engine as evidence, come before
general ones. In a remedy `{tag}` is the name of the field in the file, `{where}` the joints, `{unit}` the field's unit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexlink.diagnosis import shapes
from flexlink.diagnosis.shapes import Shape, all_zero, any_difference, none_expected, permuted, proportional, scaled_by
from flexlink.engines.couplings import COUPLED_FIELDS
from flexlink.engines.read_back import JOINT_FIELDS


class Field(NamedTuple):
    """A field of the record in words: label, unit, and its name in each format."""

    label: str
    unit: str
    mjcf: str
    urdf: str
    sdf: str


FIELDS = {
    "gravity": Field("gravity", "m/s²", "option gravity", "gravity", "<gravity>"),
    "slides": Field("type", "", "joint type", "<joint type>", "<joint type>"),
    "axes": Field("axis", "", "axis", "<axis>", "<axis><xyz>"),
    "lines": Field(
        "joint axis", "", "body pos, quat, euler or joint pos", "<joint><origin>", "<pose> of link or joint"
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
    "coupled_stiffness": Field(
        "spring stiffness between joints", "N m/rad", "stiffness of the fixed tendon", "<coupling stiffness>",
        "<flexlink:coupling stiffness>",
    ),
    "coupled_damping": Field(
        "damping between joints", "N m s/rad", "damping of the fixed tendon", "<coupling damping>",
        "<flexlink:coupling damping>",
    ),
    "gear": Field("motor gear", "", "actuator gear", "<mechanicalReduction>", "<drake:gear_ratio>"),
    "servo_stiffness": Field("servo stiffness", "N m/rad", "actuator kp", "kp", "kp"),
    "servo_damping": Field("servo damping", "N m s/rad", "actuator kv", "kd", "kd"),
    "constant_torque": Field("torque without a command", "N m", "actuator biasprm", "", ""),
    "effort": Field(
        "torque limit", "", "actuator forcerange, ctrlrange or joint actuatorfrcrange", "<limit effort>",
        "<limit><effort>",
    ),
}  # fmt: skip
SLIDING_UNITS = {
    "N m/rad": "N/m", "N m s/rad": "N s/m", "rad": "m", "rad/s": "m/s", "N m": "N", "kg m²": "kg",
}  # fmt: skip
"""Units of numbers of joints that slide in place of those that turn."""
ORIENTATION = "order of the quaternion (w x y z in MJCF), order of roll, pitch and yaw, or degrees for radians"
LENGTH_UNITS = {1e3: "millimetres", 1e2: "centimetres", 1 / 0.0254: "inches", 1 / 0.3048: "feet"}
"""Units of length that a file may have in place of metres, by the factor of its numbers."""

SETTINGS = {
    "contacts": ("contacts are active: {value}", 'set flag contact="disable", or contype="0" of the geoms', True),
    "limits": ("joint limits are active: {value}", 'set flag limit="disable", or limited="false"', True),
    "frictionloss": (
        "frictionloss acts as a constraint, in place of c tanh(q̇/w): {value}", 'set flag frictionloss="disable"', True
    ),
    "equality": ("equality constraints are active: {value}", 'set flag equality="disable"', True),
    "gravcomp": ("gravcomp cancels gravity on {value}", "remove it", True),
    "fluid": ("fluid forces are active: {value}", "set option density and viscosity to 0", True),
    "tendons": (
        "tendons that are not linear springs between two joints apply forces: {value}",
        "remove their stiffness, damping and friction", True,
    ),
    "step": ("the time step exceeds the stability limit: {value}", "set a smaller option timestep", True),
    "integrator": ("the integrator is {value}, not RK4", 'set option integrator="RK4" to compare simulations', False),
    "other actuators": (
        "actuators that are neither motors nor servos at joints are not compared: {value}",
        "check their joint torques by hand", False,
    ),
    "autoreset": ("autoreset: a simulation that diverges restarts silently", 'set flag autoreset="disable"', False),
}  # fmt: skip
"""Settings of an engine: what to say, the remedy, and whether correct simulations change (else it is only noted)."""


class Mistake(NamedTuple):
    """If `field` differs in this `shape` while `setting` is active: the likely mistake, and the remedy."""

    field: str
    shape: Shape
    likely: str
    remedy: str
    setting: str = ""


def _mistakes() -> list[Mistake]:
    correct, in_unit = "correct {tag} of {where}", "give {tag} of {where} in {unit}"
    degree, inertia_units = math.pi / 180, {1e3: "g m²", 1e4: "kg cm²", 1e6: "kg mm²", 1e7: "g cm²", 1e9: "g mm²"}
    servo_fields = ("servo_stiffness", "servo_damping", "constant_torque")
    rows: list[tuple[str, Shape, str, str] | tuple[str, Shape, str, str, str]] = [
        ("gravity", all_zero, "gravity is off", "set {tag}, and remove flags that disable it"),
        ("gravity", scaled_by(-1), "gravity has the wrong sign", "change its sign: the scene may have Z downward"),
        ("gravity", proportional, "another value of g", "correct {tag}"),
        ("gravity", shapes.same_length, "gravity along another axis", "correct {tag}, or rotate the base"),
        ("gravity", any_difference, "another gravity", "correct {tag}"),
        ("slides", any_difference, "the joint is of another type", correct),
        ("axes", any_difference, "the axis is flipped", "change the sign of {tag}, or of angle, rest and torque"),
        ("tip", any_difference, "the tip frame is misplaced", "correct {tag}"),
        *(
            (field, any_difference, "the joint's zero is shifted", "remove joint ref, or add it to every angle", "ref")
            for field in ("centers", "inertias")
        ),
        *(
            (
                field, any_difference, "the engine computes masses from the shapes of geoms",
                'set compiler inertiafromgeom="false", and give every body an <inertial>', "inertiafromgeom",
            )
            for field in ("masses", "centers", "inertias")
        ),
        ("masses", shapes.all_larger, "boundmass raises small masses", 'set compiler boundmass="0"', "boundmass"),
        ("masses", any_difference, "masses are scaled to a total", "remove compiler settotalmass", "settotalmass"),
        ("masses", all_zero, "the mass is missing, or not a number for the engine", correct),
        ("masses", scaled_by(1e3), "grams for kilograms", in_unit),
        ("masses", proportional, "another density", "correct density, or {tag}"),
        ("masses", shapes.one_too_light, "a part is missing (payload, hub, motor)", correct),
        ("masses", any_difference, "another mass", correct),
        *(("centers", shapes.lever_scaled(f), f"given in {unit}", in_unit) for f, unit in LENGTH_UNITS.items()),
        (
            "centers", any_difference, "the centre of mass is given in another frame, or missing",
            correct + ", in the body's frame",
        ),
        (
            "inertias", shapes.all_larger, "boundinertia raises small moments", 'set compiler boundinertia="0"',
            "boundinertia",
        ),
        (
            "inertias", shapes.equal_moments, "balanceinertia makes the three moments equal",
            'set compiler balanceinertia="false"', "balanceinertia",
        ),
        ("inertias", all_zero, "the inertia is missing", correct),
        (
            "inertias", shapes.water_sphere, "the file's inertia is impossible, and Drake takes a sphere of water",
            "correct {tag}: no moment may be negative, or larger than the other two together",
        ),
        (
            "inertias", shapes.products_negated, "the products of inertia have the opposite sign",
            "change the signs of ixy, ixz and iyz of {where}",
        ),
        (
            "inertias", shapes.axes_rotated, "the rotation of the principal axes is missing or wrong",
            "check {tag}: " + ORIENTATION,
        ),
        (
            "inertias", shapes.about_joint, "given about the joint, not the centre of mass",
            "give {tag} about the centre of mass",
        ),
        *(("inertias", scaled_by(f), f"given in {unit}", in_unit) for f, unit in inertia_units.items()),
        ("inertias", proportional, "another unit or density", in_unit),
        ("inertias", shapes.part_scaled, "all moments of one part scaled by one factor", correct),
        ("inertias", any_difference, "another inertia", correct + ": about the centre of mass, products with signs"),
        *(
            (
                field, any_difference, "springdamper overwrites stiffness and damping", "remove springdamper",
                "springdamper",
            )
            for field in ("stiffness", "damping")
        ),
        ("rest", scaled_by(degree), "radians in a file read in degrees", 'set compiler angle="radian"', "degree"),
        (
            "rest", any_difference, "tendons are slack elsewhere than the springs of their joints",
            "remove springlength of the tendons, or correct {tag} of {where}", "springlength",
        ),
        *(
            (field, all_zero, "a flag disables dampers", 'remove flag damper="disable"', "no dampers")
            for field in ("damping", "coupled_damping")
        ),
        *(
            (field, all_zero, "a flag disables springs", 'remove flag spring="disable"', "no springs")
            for field in ("stiffness", "coupled_stiffness")
        ),
        ("gear", permuted, "the motor is at another joint", "name the right joint in the actuator"),
        ("gear", all_zero, "the scene's drive has no motor here", "add a motor at {where}"),
        ("gear", scaled_by(-1), "it acts in the opposite direction", "change the sign of {tag}"),
        ("gear", any_difference, "a command of 1 does not give 1 N m (servo: 1 rad) at the joint", "set {tag} to 1"),
        *(
            (field, none_expected, "actuators act without a command", "use motors, or give the scene a PD drive")
            for field in servo_fields
        ),
        ("effort", shapes.one_sided, "the limit allows torque in one direction only", correct),
        ("effort", shapes.narrower, "below the largest torque of the scene's drive", correct + ", or drive.effort"),
        ("effort", any_difference, "another limit", correct + ", or drive.effort"),
    ]  # fmt: skip
    any_joint = (
        (all_zero, "missing", "add {tag} to {where}"),
        (scaled_by(degree, 1 / degree), "degrees taken for radians", in_unit),
        (scaled_by(-1), "the wrong sign", "change the sign of {tag} of {where}"),
        (scaled_by(2, 0.5), "doubled or halved (½ k θ², two sides of a joint)", in_unit),
        (permuted, "at another joint", "check which joint {tag} belongs to"),
        (none_expected, "added where there is none", "remove {tag} from {where}"),
        (proportional, "another unit or material", in_unit),
        (any_difference, "another value", correct),
    )
    between_joints = (
        (all_zero, "missing", "add it between {where}, in MJCF as a <fixed> tendon"),
        (scaled_by(-1), "the wrong sign", "change its sign between {where}, of a tendon that of one coef"),
        (none_expected, "added where there is none", "remove it between {where}"),
        (scaled_by(degree, 1 / degree), "degrees taken for radians", "give {tag} between {where} in {unit}"),
        (permuted, "between other joints", "check which joints {tag} belongs to"),
        (proportional, "another unit or material", "give {tag} between {where} in {unit}"),
        (any_difference, "another value", "correct {tag} between {where}"),
    )
    millimetres = {"rest": 1e3, "stiffness": 1e-3, "damping": 1e-3, "coulomb_width": 1e3, "servo_stiffness": 1e-3}
    rows += [
        (field, shapes.sliding(scaled_by(factor)), "millimetres for metres", in_unit)
        for field, factor in millimetres.items()
    ]
    rows += [(field, *row) for field in (*JOINT_FIELDS, *servo_fields) for row in any_joint]
    rows += [(field, *row) for field in COUPLED_FIELDS for row in between_joints]
    return [Mistake(*row) for row in rows]


MISTAKES = _mistakes()
OFFSET = Field("offset", "m", "pos", "<joint><origin xyz>", "<pose>")
MISPLACED = {
    "axis": (FIELDS["axes"], "another axis", "correct {tag} of {where}"),
    "position": (
        Field("position", "m", "joint pos", "<joint><origin>", "<joint><pose>"), "the joint is misplaced in its body",
        "correct {tag} of {where}",
    ),
    **{
        unit: (OFFSET, f"written in {unit}, read in metres", "give {tag} of {where} in m")
        for unit in LENGTH_UNITS.values()
    },
    "far": (OFFSET, "far outside the arm: millimetres for metres?", "give {tag} of {where} in m"),
    "frame": (FIELDS["lines"], "the frame is misplaced", "check {tag}: offset, " + ORIENTATION),
}  # fmt: skip
"""Displaced joint axes by the kind of displacement: the field to correct, the likely mistake, and the remedy."""
