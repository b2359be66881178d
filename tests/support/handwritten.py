"""Files of one arm in the style of third parties: various frames, names, units and conventions.

The numbers come from `of_chain`: joint lines, masses, centres, inertias in frame 0. Every link frame may have
any Z axis and any origin on the joint's line, unlike flexlink's frames. flexlink's writers are not used.
"""

from collections.abc import Callable
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.engines.read_back import ReadBack, of_chain, parallel_axis

Array = np.ndarray


class Habit(NamedTuple):
    """Style of a third-party file."""

    turned: float = 0.0  # rotation between frames and frame 0, a rotation vector that grows from link to link [rad]
    slid: float = 0.0  # offset of origins along the axis from flexlink's origins [m]
    split: float = 0.0  # fraction of each link's mass that is in a separate link, fixed to the first
    degrees: bool = False
    names: str = "joint_{}"
    principal: bool = False  # inertias as principal moments and axes instead of six numbers
    servos: bool = False  # position servos with the gains of the drive, instead of motors
    shuffled: bool = False  # links and joints in another order than in the chain
    tools: bool = False  # additional links without joint or mass: pedestal, flange, tool
    effort: float = 0.0  # torque limit of every joint [N m]; 0: none
    model_frame: bool = False  # SDF: axes in the model frame, no world


class Part(NamedTuple):
    """Mass properties of a part rigidly attached to a link, in the link's frame."""

    mass: float
    center: Array
    inertia: Array


class Piece(NamedTuple):
    """A link with its joint, in the frame of the parent link."""

    name: str
    k: int
    R: Array
    p: Array
    axis: Array
    parts: list[Part]


def pieces(read: ReadBack, habit: Habit) -> tuple[list[Piece], tuple[Array, Array]]:
    """Return the links from base to tip, and the last link's frame in frame 0."""
    made, R, p = [], np.eye(3), np.zeros(3)
    for k in range(read.n):
        Q = Rotation.from_rotvec(habit.turned * (k + 1) * np.array([0.3, -0.5, 0.2])).as_matrix()
        o = read.points[k] + habit.slid * read.axes[k]
        parts = _parts(read, k, Q, o, habit.split)
        made.append(Piece(habit.names.format(k + 1), k, R.T @ Q, R.T @ (o - p), Q.T @ read.axes[k], parts))
        R, p = Q, o
    return made, (R, p)


def _parts(read: ReadBack, k: int, Q: Array, o: Array, split: float) -> list[Part]:
    m, c, I = read.masses[k], Q.T @ (read.centers[k] - o), Q.T @ read.inertias[k] @ Q
    if not m:
        return []
    if not split:
        return [Part(m, c, I)]
    d = 0.002 * np.array([1.0, -2.0, 1.5])  # offset of the second part; the first part has the opposite offset
    one, other = split * m, (1 - split) * m
    near = -other / one * d
    left = I - parallel_axis(np.array([one, other]), np.array([near, d])).sum(axis=0)
    return [Part(one, c + near, 0.75 * left), Part(other, c + d, 0.25 * left)]


def text(values: Array | list[float]) -> str:
    return " ".join(repr(float(x) + 0.0) for x in np.ravel(values))


def angle(habit: Habit, values: Array) -> Array:
    return np.degrees(values) if habit.degrees else values


def mjcf(chain: fl.Chain, habit: Habit, scene: fl.Scene) -> ET.Element:
    """Write MJCF: joints at one point in one body, settings in default classes, visual geoms without mass."""
    read = of_chain(chain)
    root = ET.Element("mujoco", model="arm")
    how = {"angle": "degree"} if habit.degrees else {"angle": "radian", "autolimits": "true"}
    ET.SubElement(root, "compiler", how | ({"eulerseq": "XYZ"} if habit.degrees else {}))
    option = ET.SubElement(root, "option", gravity=text(read.gravity), integrator="implicitfast", timestep="2e-5")
    ET.SubElement(option, "flag", contact="disable", frictionloss="disable")
    default = ET.SubElement(root, "default")
    ET.SubElement(default, "geom", contype="0", conaffinity="0", mass="0")
    arm = ET.SubElement(default, "default", {"class": "beam"})
    common = repr(float(np.median(read.damping)))
    ET.SubElement(arm, "joint", type="hinge", damping=common)
    parent = ET.SubElement(root, "worldbody")
    new, R, p = True, np.eye(3), np.zeros(3)  # pose of the link in the body
    for piece in pieces(read, habit)[0]:
        p, R = p + R @ piece.p, R @ piece.R
        if new:
            body = parent = _body(parent, piece.name, R, p, habit)
            new, R, p = False, np.eye(3), np.zeros(3)
        k = piece.k
        joint = {"name": piece.name, "class": "beam", "axis": text(R @ piece.axis), "pos": text(p)}
        numbers = {"stiffness": read.stiffness[k], "armature": read.armature[k], "frictionloss": read.coulomb[k]}
        joint |= {name: repr(float(value)) for name, value in numbers.items() if value}
        joint |= {"springref": text(angle(habit, read.rest[k]))} if read.rest[k] else {}
        joint |= {"damping": repr(float(read.damping[k]))} if read.damping[k] != float(common) else {}
        ET.SubElement(body, "joint", joint)
        if piece.parts:
            for number, part in enumerate(piece.parts):
                target = body if not number else ET.SubElement(body, "body", name=f"{piece.name}_part{number}")
                _mjcf_inertial(target, part, habit, R, p)
            ET.SubElement(body, "geom", type="capsule", size="0.01 0.05")
            new = True
    _actuators(root, chain, habit, scene)
    return root


def _body(parent: ET.Element, name: str, R: Array, p: Array, habit: Habit) -> ET.Element:
    turn = Rotation.from_matrix(R)
    place = {"pos": text(p)} if p.any() else {}
    if habit.degrees:
        place["euler"] = text(turn.as_euler("xyz", degrees=True))  # fixed axes: MuJoCo's XYZ
    elif habit.principal:
        place["xyaxes"] = text(R[:, :2].T)
    else:
        place["quat"] = text(turn.as_quat(scalar_first=True))
    return ET.SubElement(parent, "body", {"name": f"{name}_link"} | place)


def _mjcf_inertial(body: ET.Element, part: Part, habit: Habit, R: Array, p: Array) -> None:
    inertial = ET.SubElement(body, "inertial", mass=repr(float(part.mass)), pos=text(p + R @ part.center))
    I = R @ part.inertia @ R.T
    if habit.principal:
        moments, axes = np.linalg.eigh(I)
        axes *= np.sign(np.linalg.det(axes))
        inertial.set("quat", text(Rotation.from_matrix(axes).as_quat(scalar_first=True)))
        inertial.set("diaginertia", text(moments))
    else:
        inertial.set("fullinertia", text([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]))
    body.remove(inertial)
    body.insert(0, inertial)


def _actuators(root: ET.Element, chain: fl.Chain, habit: Habit, scene: fl.Scene) -> None:
    actuators = ET.SubElement(root, "actuator")
    for k in chain.active:
        link, name = chain.coordinates[k].link - 1, habit.names.format(k + 1)
        limit = {"forcelimited": "true", "forcerange": text([-habit.effort, habit.effort])} if habit.effort else {}
        if habit.servos:
            gains = {"kp": repr(scene.drive.kp[link]), "kv": repr(scene.drive.kd[link])}
            ET.SubElement(actuators, "position", {"joint": name} | gains | limit)
        else:
            ET.SubElement(actuators, "motor", {"name": f"{name}_motor", "joint": name, "gear": "1"} | limit)


def urdf(chain: fl.Chain, habit: Habit, scene: fl.Scene) -> ET.Element:
    """Write a plain URDF without flexlink elements: no springs, rotors or gravity."""
    read, joints, links = of_chain(chain), list[ET.Element](), [ET.Element("link", name="base")]
    made, (R, p) = pieces(read, habit)
    parent = "base"
    if habit.tools:
        links.append(ET.Element("link", name="stand"))
        joints.append(_urdf_joint("base_to_stand", "fixed", ("base", "stand"), np.eye(3), np.zeros(3)))
        parent = "stand"
    for piece in made:
        k, child = piece.k, f"{piece.name}_link"
        joint = _urdf_joint(piece.name, "revolute", (parent, child), piece.R, piece.p)
        ET.SubElement(joint, "axis", xyz=text(piece.axis))
        if habit.tools:
            joint.set("type", "continuous")
        else:
            ET.SubElement(joint, "limit", lower="-9", upper="9", velocity="100", effort=repr(habit.effort))
        dynamics = {"damping": repr(float(read.damping[k])), "friction": repr(float(read.coulomb[k]))}
        ET.SubElement(joint, "dynamics", dynamics)
        joints.append(joint)
        links.append(ET.Element("link", name=child))
        for number, part in enumerate(piece.parts):
            target = links[-1]
            if number:
                target = ET.Element("link", name=f"{piece.name}_part{number}")
                links.insert(-1, target)
                fixed = _urdf_joint(f"{piece.name}_weld{number}", "fixed", (child, target.get("name")), *_aside())
                joints.append(fixed)
            _urdf_inertial(target, part, habit, *(_aside() if number else (np.eye(3), np.zeros(3))))
        parent = child
    tip = read.tip if read.tip is not None else p
    joints.append(_urdf_joint("flange", "fixed", (parent, "tip"), R.T, R.T @ (tip - p)))
    links.append(ET.Element("link", name="tip"))
    robot = ET.Element("robot", name="arm")
    order = [*joints, *links] if not habit.shuffled else [*reversed(links), *reversed(joints)]
    robot.extend(order)
    if habit.effort:
        for k in chain.active:
            _transmission(robot, habit.names.format(k + 1))
    return robot


def _aside() -> tuple[Array, Array]:
    """Pose of the frame of a welded part."""
    return Rotation.from_euler("xyz", [0.4, -0.2, 0.7]).as_matrix(), np.array([0.02, 0.01, -0.03])


def _urdf_joint(name: str, kind: str, ends: tuple[str, str], R: Array, p: Array) -> ET.Element:
    joint = ET.Element("joint", name=name, type=kind)
    ET.SubElement(joint, "origin", xyz=text(p), rpy=text(Rotation.from_matrix(R).as_euler("xyz")))
    for tag, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(joint, tag, link=link)
    return joint


def _urdf_inertial(link: ET.Element, part: Part, habit: Habit, R: Array, p: Array) -> None:
    inertial = ET.SubElement(link, "inertial")
    c, I = R.T @ (part.center - p), R.T @ part.inertia @ R
    origin = ET.SubElement(inertial, "origin", xyz=text(c))
    if habit.principal:
        moments, axes = np.linalg.eigh(I)
        axes *= np.sign(np.linalg.det(axes))
        origin.set("rpy", text(Rotation.from_matrix(axes).as_euler("xyz")))
        I = np.diag(moments)
    ET.SubElement(inertial, "mass", value=repr(float(part.mass)))
    ET.SubElement(inertial, "inertia", {name: repr(float(I[at])) for name, at in SIX.items()})


SIX = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def _transmission(robot: ET.Element, joint: str) -> None:
    transmission = ET.SubElement(robot, "transmission", name=f"{joint}_trans")
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    ET.SubElement(transmission, "joint", name=joint)
    ET.SubElement(ET.SubElement(transmission, "actuator", name=f"{joint}_motor"), "mechanicalReduction").text = "1"


def sdf(chain: fl.Chain, habit: Habit, scene: fl.Scene) -> ET.Element:
    """Write SDF: springs as SDFormat elements, link poses in the model frame or relative to the parent link."""
    read = of_chain(chain)
    root = ET.Element("sdf", {"version": "1.10", "xmlns:drake": "http://drake.mit.edu"})
    holder = root
    if not habit.model_frame:
        holder = ET.SubElement(root, "world", name="lab")
        ET.SubElement(holder, "gravity").text = text(read.gravity)
    model = ET.SubElement(holder, "model", name="arm")
    made, R, p = pieces(read, habit)[0], np.eye(3), np.zeros(3)
    parent = "world"
    for piece in made:
        k, child = piece.k, f"{piece.name}_link"
        p, R = p + R @ piece.p, R @ piece.R
        link = ET.SubElement(model, "link", name=child)
        after = {} if habit.model_frame or parent == "world" else {"relative_to": parent}
        _pose(link, (R, p) if habit.model_frame else (piece.R, piece.p), after, degrees=habit.degrees)
        (part,) = piece.parts or [Part(0.0, np.zeros(3), np.zeros((3, 3)))]
        inertial = ET.SubElement(link, "inertial")
        axes, I = np.eye(3), part.inertia
        if habit.principal and part.mass:
            moments, axes = np.linalg.eigh(I)
            axes, I = axes * np.sign(np.linalg.det(axes)), np.diag(moments)
        _pose(inertial, (axes, part.center), {}, degrees=habit.degrees)
        ET.SubElement(inertial, "mass").text = repr(float(part.mass))
        inertia = ET.SubElement(inertial, "inertia")
        for name, at in SIX.items():
            ET.SubElement(inertia, name).text = repr(float(I[at]))
        joint = ET.SubElement(model, "joint", name=piece.name, type="revolute")
        ET.SubElement(joint, "parent").text, ET.SubElement(joint, "child").text = parent, child
        axis = ET.SubElement(joint, "axis")
        in_model = {"expressed_in": "__model__"} if habit.model_frame else {}
        ET.SubElement(axis, "xyz", in_model).text = text(R @ piece.axis if habit.model_frame else piece.axis)
        dynamics = ET.SubElement(axis, "dynamics")
        numbers = {"damping": read.damping[k], "friction": read.coulomb[k], "spring_stiffness": read.stiffness[k],
                   "spring_reference": read.rest[k]}  # fmt: skip
        for name, value in numbers.items():
            ET.SubElement(dynamics, name).text = repr(float(value))
        if habit.effort:
            ET.SubElement(ET.SubElement(axis, "limit"), "effort").text = repr(habit.effort)
        if read.armature[k]:
            ET.SubElement(joint, "drake:rotor_inertia").text = repr(float(read.armature[k]))
            ET.SubElement(joint, "drake:gear_ratio").text = "1"
        parent = child
    return root


def _pose(parent: ET.Element, place: tuple[Array, Array], attributes: dict[str, str], *, degrees: bool) -> None:
    how = {"degrees": "true"} if degrees else {}
    pose = ET.SubElement(parent, "pose", attributes | how)
    pose.text = text([*place[1], *Rotation.from_matrix(place[0]).as_euler("xyz", degrees=degrees)])


class Hand(NamedTuple):
    """A file format written in the style of a third party."""

    form: str
    write: Callable[[fl.Chain, Habit, fl.Scene], ET.Element]
    habit: Habit


HANDS = {
    "degrees": Hand("mjcf", mjcf, Habit(turned=0.7, degrees=True, names="axis{}", effort=500.0)),
    "welded": Hand("mjcf", mjcf, Habit(turned=-0.4, slid=0.05, split=0.3, principal=True, names="q{}")),
    "servos": Hand("mjcf", mjcf, Habit(servos=True)),
    "turned": Hand("urdf", urdf, Habit(turned=0.7, slid=-0.03)),
    "aligned": Hand("urdf", urdf, Habit(effort=500.0, names="j{}")),
    "parts": Hand("urdf", urdf, Habit(turned=0.2, split=0.4)),
    "principal": Hand("urdf", urdf, Habit(turned=-1.1, principal=True)),
    "tools": Hand("urdf", urdf, Habit(turned=0.5, tools=True)),
    "shuffled": Hand("urdf", urdf, Habit(turned=0.9, split=0.6, shuffled=True, effort=500.0)),
    "relative": Hand("sdf", sdf, Habit(turned=0.7, degrees=True, effort=500.0)),
    "model": Hand("sdf", sdf, Habit(turned=-0.5, slid=0.02, principal=True, model_frame=True)),
}


CRANE = """
name = "crane"

[material.steel]
young     = 210e9
poisson   = 0.3
density   = 7850.0
loss_time = 2e-4

[section.tube]
shape = "tube"
outer = 0.08
inner = 0.07

[[link]]
name   = "slew"
length = 0.4
flex   = "rigid"
joint  = { viscous = 2.0, armature = 0.3 }
hub    = { mass = 3.0, center = [0.05, 0.02, -0.1], inertia = [0.05, 0.06, 0.04, 0.004, -0.006, 0.003] }

[[link]]
name     = "boom"
mount    = { rpy_deg = [-90.0, 0.0, 10.0] }
length   = 1.7
material = "steel"
section  = "tube"
segments = 3
flex     = "z"
joint    = { viscous = 1.0, armature = 0.2 }

[[link]]
name     = "jib"
mount    = { rpy_deg = [20.0, 0.0, 0.0] }
length   = 1.1
material = "steel"
section  = "tube"
segments = 3
flex     = "yz"
joint    = { viscous = 0.5, armature = 0.1, gear_stiffness = 4e4, gear_damping = 3.0 }

[tip]
mass    = 5.0
center  = [0.1, 0.0, 0.05]
inertia = [0.02, 0.03, 0.025, 0.002, 0.004, -0.003]

[initial]
joint_deg = [0.0, -40.0, 30.0]

[drive]
kind   = "constant"
torque = [20.0, -150.0, -60.0]
"""
SERVED = {
    "drive.kind": "pd", "drive.torque": None, "drive.kp": (4e3, 9e3, 2e3), "drive.kd": (200.0, 500.0, 80.0),
    "drive.target_deg": (0.0, -40.0, 30.0),
}  # fmt: skip
"""Scene variants of the crane: with a PD drive."""
