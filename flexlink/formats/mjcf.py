"""Chain → MJCF: one body per rigid segment with its hinges, the first listed nearest the base.

MuJoCo rejects moving bodies without mass. The hinges of a massless body (a free waist of length zero) hang in the
next body that has mass, with position and axis as they stand there at zero angles: every hinge turns all that
follows it, so the motion is the same.

MuJoCo's own dry friction is a constraint. It is switched off; `frictionloss` only carries the Coulomb torque c, and
the joint's first `user` number the width w of c tanh(q̇/w), which whoever runs the file adds.

What MJCF cannot hold, or only rounded, stands in `user` numbers of the joints, which the text `flexlink.user` names,
and in custom numbers: placements that turn or are merged, inertias that are not diagonal.
"""

from __future__ import annotations

import dataclasses
import math
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_bool, require_type, sequence, vector
from flexlink.chain.chain import Chain, Coordinate
from flexlink.chain.rigid import HERE, Pose
from flexlink.chain.rotation import quaternion_from_matrix
from flexlink.common.errors import ArgumentError
from flexlink.common.products import product
from flexlink.describe.rigid_body import ROUNDING
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.formats.capsules import Capsule, capsules, colours
from flexlink.formats.document import (
    UPPER_TRIANGLE,
    WIDE,
    Array,
    decimals,
    limits,
    links_text,
    text,
    valid,
    xml_joint_names,
    xml_link_names,
)
from flexlink.formats.principal import principal_axes
from flexlink.kernels.layout import HINGE

SMALLEST = 1e-15  # kg, kg m²: MuJoCo's mjMINVAL, the least that it takes for a moving body
MAX_BODIES = 490  # MuJoCo's XML parser stops at 500 nested elements

COMPILER = {
    "angle": "radian", "autolimits": "false", "inertiafromgeom": "false", "balanceinertia": "false",
    "boundmass": "0", "boundinertia": "0", "fusestatic": "false",
}  # fmt: skip
# Nothing may act but gravity, springs and dampers; and a run that diverges must not restart by itself.
DISABLED = ("constraint", "contact", "limit", "frictionloss", "equality", "autoreset")
JOINT = {
    "stiffness": "stiffness", "springref": "rest", "damping": "damping", "armature": "armature",
    "frictionloss": "coulomb",
}  # fmt: skip
"""Attribute of <joint>: field of the hinge."""
USER = sorted(
    {*(HINGE.names or ())} - {*JOINT.values(), "lower", "upper"}, key=lambda name: (name != "coulomb_width", name)
)
"""Fields of the hinge that stand in `user`, the width of dry friction first; after them the coordinate."""


def to_mjcf(chain: Chain, *, shapes: bool = True, initial: tuple[ArrayLike, ArrayLike] | None = None) -> str:
    """Write a chain as MJCF.

    Parameters
    ----------
    chain
        The chain.
    shapes
        Whether to write capsules to look at, without mass and without contact.
    initial
        q and q̇ of the keyframe `initial`, shape (n,) each [rad, rad/s]; without it there is none.

    Returns
    -------
    str
        The document; joints in sequential order, named as `Chain.joint_name` does, driven ones with a motor of that
        name. Body and site `tip` are the tip frame. Numbers read back exactly, except that rotations are quaternions,
        which MuJoCo normalizes.

    Raises
    ------
    ArgumentError
        The chain is longer than MuJoCo's parser can nest, its last joints move no mass, or a segment has a mass or
        inertia that MuJoCo refuses; `initial` has the wrong shape.
    SingularMassError
        A coordinate moves no inertia of its own.
    """
    if len(require_type("chain", chain, Chain).bodies) > MAX_BODIES:
        raise ArgumentError(f"chain has {len(chain.bodies)} bodies: MuJoCo reads at most {MAX_BODIES}, nested")
    root = ET.Element("mujoco", model=valid(chain.name))
    ET.SubElement(root, "compiler", COMPILER)
    option = ET.SubElement(root, "option", integrator="RK4", gravity=decimals(chain.gravity))
    ET.SubElement(option, "flag", dict.fromkeys(DISABLED, "disable"))
    ET.SubElement(root, "size", nuser_jnt=str(len(USER) + len(Coordinate._fields)))
    own = ET.SubElement(root, "custom")
    ET.SubElement(own, "text", name="flexlink.links", data=links_text(chain))
    ET.SubElement(own, "text", name="flexlink.user", data=" ".join([*USER, "coordinate"]))
    if require_bool("shapes", shapes):
        asset = ET.SubElement(root, "asset")
        for name, rgba in colours(chain):
            ET.SubElement(asset, "material", name=name, rgba=rgba)
    _bodies(ET.SubElement(root, "worldbody"), chain, own, shapes)
    joints = xml_joint_names(chain)
    motors = ET.SubElement(root, "actuator")
    for k in chain.active:
        ET.SubElement(motors, "motor", name=joints[k], joint=joints[k])
    if initial is not None:
        _keyframe(ET.SubElement(root, "keyframe"), chain, initial)
    option.set("timestep", decimals([_safe_step(chain)]))
    return text(root)


def _bodies(parent: ET.Element, chain: Chain, own: ET.Element, shapes: bool) -> None:
    """Bodies and tip, one in the other; `own` takes what they hold only rounded."""
    joints, links, shown = xml_joint_names(chain), xml_link_names(chain), list(capsules(chain))
    frame, waiting = HERE, list[_Hinge]()
    for b, body in enumerate(chain.bodies[:-1]):
        place, name = Pose(body["rotation"], body["translation"]), links[body["stop"]]
        heavy = bool(body["mass"] or body["inertia"].any())
        if body["turned"] or waiting or not heavy:
            _exact(own, f"placement.{joints[body['first']]}", *place.p, *place.R.flat)
        frame = frame.then(place)
        waiting = [hinge.seen_from(place) for hinge in waiting]
        waiting += [_Hinge(k, np.eye(3)[chain.hinges["axis"][k]]) for k in range(body["first"], body["stop"])]
        if heavy:
            parent = _body(parent, name, frame)
            moments, axes = _principal(body)
            _require_loadable(chain, body, moments)
            moments = np.minimum(moments, _largest_possible(moments))  # of a disc, what rounding has put on top
            _inertial(parent, body, moments, axes)
            if not np.array_equal(I := body["inertia"], np.diag(moments)):
                _exact(own, f"inertia.{joints[body['stop'] - 1]}", *(I[place] for place in UPPER_TRIANGLE.values()))
            for hinge in waiting:
                hinge.write(parent, joints[hinge.k], chain)
            _shape(parent, shown[b] if shapes else None)
            frame, waiting = HERE, []
    if waiting:
        raise ArgumentError(f"joint {joints[waiting[0].k]!r} moves no mass: MuJoCo cannot hold such a chain")
    end = chain.bodies[-1]
    if end["turned"]:
        _exact(own, "tip", *end["translation"], *end["rotation"].flat)
    tip = _body(parent, links[-1], Pose(end["rotation"], end["translation"]))
    _inertial(
        tip, end, np.zeros(3), np.eye(3)
    )  # all zero; left out, MuJoCo would put the centre, where forces act, somewhere else
    ET.SubElement(tip, "site", name=links[-1])


def _keyframe(parent: ET.Element, chain: Chain, initial: tuple[ArrayLike, ArrayLike]) -> None:
    state = sequence("initial", initial, "vector")
    if len(state) != 2:
        raise ArgumentError(f"initial has {len(state)} items: expected q and qd")
    q, qd = (vector(f"initial[{k}]", value, chain.n) for k, value in enumerate(state))
    ET.SubElement(parent, "key", name="initial", qpos=decimals(q), qvel=decimals(qd))


def _exact(own: ET.Element, name: str, *values: float) -> None:
    ET.SubElement(own, "numeric", name=f"flexlink.{name}", data=decimals(values))


def _shape(body: ET.Element, capsule: Capsule | None) -> None:
    if capsule is not None:
        ET.SubElement(
            body, "geom", type="capsule", fromto=decimals([0, 0, 0, *capsule.end]), size=decimals([capsule.radius]),
            contype="0", conaffinity="0", mass="0", group="1", material=capsule.colour[0],
        )  # fmt: skip


def _safe_step(chain: Chain) -> float:
    """Half the largest stable step of RK4, one digit, at most MuJoCo's own 2 ms, which would blow up most links.

    About a slightly bent arm, where no two axes line up.
    """
    step = min(2e-3, stable_step(chain, np.linspace(0.1, 0.4, chain.n), method="RK4") / 2)
    digit = 10.0 ** math.floor(math.log10(step))
    return float(f"{math.floor(step / digit) * digit:.0e}")


@dataclasses.dataclass(frozen=True)
class _Hinge:
    """Hinge `k` with its axis and position in the frame of the running body, at zero angles."""

    k: int
    axis: Array
    pos: Array = dataclasses.field(default_factory=lambda: np.zeros(3))

    def seen_from(self, frame: Pose) -> _Hinge:
        """The same hinge in the axes of the next body."""
        return _Hinge(self.k, product(frame.R.T, self.axis), product(frame.R.T, self.pos - frame.p))

    def write(self, body: ET.Element, name: str, chain: Chain) -> None:
        placed = {"axis": decimals(self.axis), "pos": decimals(self.pos)}
        numbers = {key: decimals([chain.hinges[self.k][field]]) for key, field in JOINT.items()}
        own = {"user": decimals([*(chain.hinges[self.k][field] for field in USER), *chain.coordinates[self.k]])}
        if ends := limits(chain.hinges[self.k]):  # said, not enforced
            own |= {"range": " ".join((WIDE | ends).values()), "limited": "false"}
        ET.SubElement(body, "joint", {"name": name, "type": "hinge"} | placed | numbers | own)


def _body(parent: ET.Element, name: str, frame: Pose) -> ET.Element:
    quaternion = decimals(quaternion_from_matrix(frame.R))
    return ET.SubElement(parent, "body", name=name, pos=decimals(frame.p), quat=quaternion)


def _principal(body: np.void) -> tuple[Array, Array]:
    """Principal moments and axes; found here, to 2e-15, because MuJoCo's own `fullinertia` leaves 1e-14."""
    I = body["inertia"]
    if np.array_equal(I, np.diag(np.diag(I))):
        return np.diag(I), np.eye(3)
    return principal_axes(I)


def _require_loadable(chain: Chain, body: np.void, moments: Array) -> None:
    """MuJoCo has no way to hold less, and would refuse the file: there is no other form of the same body."""
    light = body["mass"] < SMALLEST or moments.min() < SMALLEST
    if not light and moments.max() * (1 - ROUNDING) <= _largest_possible(moments):
        return
    joint = int(body["stop"]) - 1
    link = chain.link_names[chain.coordinate(joint).link - 1]
    rule = f"takes neither below {SMALLEST:g}" if light else "takes no moment larger than the other two together"
    raise ArgumentError(
        f"segment behind joint {chain.joint_name(joint)!r}: mass {body['mass']:.3g} kg, principal moments of inertia "
        f"{', '.join(f'{moment:.3g}' for moment in moments)} kg m²: MuJoCo {rule}; change section, segments or hub of "
        f"link {link!r}, or the payload, or use URDF"
    )


def _largest_possible(moments: Array) -> float:
    """The sum of the two smaller moments, as MuJoCo adds them."""
    low, middle, _ = np.sort(moments)
    return float(low + middle)


def _inertial(parent: ET.Element, body: np.void, moments: Array, axes: Array) -> None:
    """Mass, centre and principal moments."""
    ET.SubElement(
        parent, "inertial", mass=decimals([body["mass"]]), pos=decimals(body["center"]),
        quat=decimals(quaternion_from_matrix(axes)), diaginertia=decimals(moments),
    )  # fmt: skip
