"""Chain → MJCF: one body per rigid segment with its hinges, ordered from the base outwards.

MuJoCo rejects moving bodies without mass. The hinges of a massless body (a free waist of length zero) are written in
the next body with mass, with their position and axis at zero angles. The motion is the same, because every hinge moves
all bodies after it; but no branch may begin at a massless body. MuJoCo also rejects bodies without inertia. Bodies that
slide and never rotate therefore get an inertia, which has no effect.

MuJoCo models dry friction as a constraint, which the file disables. `frictionloss` only stores the Coulomb torque c,
and a joint's first `user` number stores the width w of c tanh(q̇/w). A program that runs the file must add that torque.

Springs and dampers between hinges are fixed tendons.

Values that MJCF rounds or cannot represent are stored in `user` numbers of the joints (listed in the text
`flexlink.user`) and in custom numbers: rotated or merged placements, non-diagonal inertias, K_ii and D_ii of coupled
springs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import positive, require_bool, require_type, state
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Coordinate, unique
from flexlink.chain.forces import refuse_states
from flexlink.chain.rigid import HERE, Pose, quaternion_from_matrix, rates_matrices, rotations_of
from flexlink.common.errors import ArgumentError
from flexlink.common.products import dot, product
from flexlink.common.types import Array, Indices, Mask
from flexlink.describe.arm import BASE
from flexlink.describe.rigid_body import ROUNDING
from flexlink.describe.scene import Scene
from flexlink.formats import document
from flexlink.formats.document import UPPER_TRIANGLE, WIDE, Tip, decimals, valid
from flexlink.formats.tied import add_ties, spring_gains
from flexlink.kernels.layout import BODY, HINGE, SLIDES

JOINT_ATTRIBUTES = {
    "stiffness": "stiffness", "springref": "rest", "damping": "damping", "armature": "armature",
    "frictionloss": "coulomb",
}  # fmt: skip
"""Maps attributes of <joint> to fields of the hinge."""
USER_FIELDS = sorted(
    {*(HINGE.names or ())} - {*JOINT_ATTRIBUTES.values(), "lower", "upper"},
    key=lambda name: (name != "coulomb_width", name),
)
"""Fields of the hinge in `user`, starting with the width of dry friction; the coordinate is appended."""


def to_mjcf(
    chain: Chain, *, shapes: bool = True, initial: tuple[ArrayLike, ArrayLike] | None = None,
    timestep: float | None = None, ties: Scene | None = None,
) -> str:  # fmt: skip
    """Write a chain as MJCF.

    Parameters
    ----------
    chain, shapes
        The chain, and whether to write capsules for viewers, without mass and contact.
    initial
        q and q̇ of the keyframe `initial`, shape (n,) each [rad, rad/s; m, m/s]; None: no keyframe.
    timestep
        Time step of MuJoCo [s]; None: half the largest stable step of RK4 of a slightly bent arm, at most 2 ms.
    ties
        The scene of the chain, whose ties are written, by equalities and tendons; None: the arm is open.

    Returns
    -------
    str
        The document. Joints are in sequential order, branch by branch in a tree, with the names of
        `Chain.joint_names`. Each driven joint has a motor of the same name. A floating base is a body with
        `freejoint`. Body and site `tip` are the tip frame; tips of other branches are named after the links that end
        there. MuJoCo reads back all numbers exactly, except quaternions, which it normalizes.

    Raises
    ------
    ArgumentError
        The chain nests more bodies than MuJoCo's parser accepts, its last joints move no mass, branches begin at a
        moving point without mass, MuJoCo refuses the mass or inertia of a segment, a joint's springs to other joints of
        its cell are together stiffer than its own spring, or `initial` has the wrong shape.
    SceneError
        MJCF has no element for a tie.
    SingularMassError
        A coordinate has no inertia attached, and `timestep` is None.

    Examples
    --------
    >>> text = fl.to_mjcf(chain, initial=(q, qd))
    >>> print(text.count("<joint"), "joints")
    6 joints
    """
    most_bodies = 490  # MuJoCo's XML parser stops at 500 nested elements
    refuse_states(require_type("chain", chain, Chain), "no file represents it")
    depth = [0]
    for parent in chain.bodies["parent"].tolist():
        depth.append(1 + depth[parent])
    if (nested := max(depth)) > most_bodies:
        text = f"{nested} bodies: MuJoCo reads at most {most_bodies}; use fewer segments, or URDF"
        raise ArgumentError(f"{chain.name}: {text}", id="too-many-joints")
    root = ET.Element("mujoco", model=valid(chain.name))
    compiler = {
        "angle": "radian", "autolimits": "false", "inertiafromgeom": "false", "balanceinertia": "false",
        "boundmass": "0", "boundinertia": "0", "fusestatic": "false",
    }  # fmt: skip
    ET.SubElement(root, "compiler", compiler)
    option = ET.SubElement(root, "option", integrator="RK4", gravity=decimals(chain.gravity))
    # only gravity, springs and dampers may act, and a diverging run must not restart by itself
    disabled = ("constraint", "contact", "limit", "frictionloss", "equality", "autoreset")
    ET.SubElement(option, "flag", dict.fromkeys(disabled, "disable"))
    ET.SubElement(root, "size", nuser_jnt=str(len(USER_FIELDS) + len(Coordinate._fields)))
    own = ET.SubElement(root, "custom")
    ET.SubElement(own, "text", name="flexlink.links", data=document.names_text(chain.link_names))
    ET.SubElement(own, "text", name="flexlink.user", data=" ".join([*USER_FIELDS, "coordinate"]))
    for key, value in (document.rotation_springs(chain) | document.tree_attributes(chain)).items():
        ET.SubElement(own, "text", name=f"flexlink.{key}", data=value)
    if require_bool("shapes", shapes):
        asset = ET.SubElement(root, "asset")
        for name, rgba in document.colours(chain):
            ET.SubElement(asset, "material", name=name, rgba=rgba)
    _bodies(ET.SubElement(root, "worldbody"), chain, own, shapes)
    joints = document.xml_joint_names(chain)
    add_tendons(root, chain, joints)
    motors = ET.SubElement(root, "actuator")
    for k in chain.active:
        ET.SubElement(motors, "motor", name=joints[k], joint=joints[k])
    if initial is not None:
        _keyframe(ET.SubElement(root, "keyframe"), chain, initial)
    step = _safe_step(chain, ties, initial) if timestep is None else positive("timestep", timestep)
    option.set("timestep", decimals([step]))
    if ties is not None:
        add_ties(root, chain, ties, timestep=step)
    return document.text(root)


def depth_first(chain: Chain) -> Indices:
    """Return the joints branch by branch, as MuJoCo numbers them; branches at one body keep their order."""
    branches: dict[int, list[int]] = {}
    for number, parent in enumerate(chain.bodies["parent"].tolist(), 1):
        branches.setdefault(parent, []).append(number)
    order, waiting = list[int](), [0]
    while waiting:
        number = waiting.pop()
        if number:
            order += range(chain.bodies["first"][number - 1], chain.bodies["stop"][number - 1])
        waiting += reversed(branches.get(number, []))
    return np.array(order, dtype=np.intp)


def _bodies(world: ET.Element, chain: Chain, own: ET.Element, shapes: bool) -> None:
    """Write nested bodies and tips; exact values of numbers that MJCF rounds are added to `own`."""
    joints, links = document.xml_joint_names(chain), document.xml_link_names(chain)
    shown = document.capsules_behind(chain) if shapes else {}
    hinges, ends = _without_tendons(chain), dict(zip(chain.tips.values(), document.tips(chain), strict=True))
    for k in sorted({*chain.couplings["inner"].tolist(), *chain.couplings["outer"].tolist()}):
        _exact(own, f"springs.{joints[k]}", *(chain.hinges[k][field] for field in SHARED))
    opened, floats, axes = [(world, HERE, list[_Hinge]())], document.base_joints(chain), chain.hinges["axis"] % SLIDES
    turns = _turning(chain)
    for b, body in enumerate(chain.bodies):
        parent, frame, waiting = opened[body["parent"]]
        place, heavy = Pose(body["rotation"], body["translation"]), bool(body["mass"] or body["inertia"].any())
        _require_one_way(chain, body, waiting)
        if b in ends:
            _tip(parent, own, ends[b], of_arm=b == len(chain.bodies) - 1)
            opened.append(opened[0])
            continue
        if body["stop"] < floats:  # slides of a floating base: `freejoint` replaces the joints of both its bodies
            opened.append(opened[0])
            continue
        is_base = 0 < floats == body["stop"]
        last = BASE if is_base else joints[body["stop"] - 1]
        if not is_base:
            if body["turned"] or waiting or not heavy:
                _exact(own, f"placement.{joints[body['first']]}", *place.p, *place.R.flat)
            B = place.R.T  # into the axes of the next body
            waiting = [_Hinge(each.k, product(B, each.axis), product(B, each.pos - place.p)) for each in waiting]
            waiting += [_Hinge(k, np.eye(3)[axes[k]]) for k in range(body["first"], body["stop"])]
        frame = frame.then(place)
        if heavy:
            parent = _body(parent, links[body["stop"]], frame)
            moments, principal = _principal(body)
            if not turns[b] and moments.min() < SMALLEST:
                moments, principal = np.full(3, 0.01 * float(body["mass"])), np.eye(3)  # arbitrary, as it never turns
            _require_loadable(chain, body, moments)
            moments = np.minimum(moments, _largest_possible(moments))  # removes the rounding error of a disc's moments
            _inertial(parent, body, moments, principal)
            if not np.array_equal(I := body["inertia"], np.diag(moments)):
                _exact(own, f"inertia.{last}", *(I[place] for place in UPPER_TRIANGLE.values()))
            if is_base:
                ET.SubElement(parent, "freejoint", name=BASE, align="false")
            for hinge in waiting:
                hinge.write(parent, joints[hinge.k], hinges[hinge.k], chain.coordinates[hinge.k])
            for capsule in shown.get(int(body["stop"]) - 1, []):
                ET.SubElement(
                    parent, "geom", type="capsule", fromto=decimals([0, 0, 0, *capsule.end]),
                    size=decimals([capsule.radius]), contype="0", conaffinity="0", mass="0", group="1",
                    material=capsule.colour[0],
                )  # fmt: skip
            frame, waiting = HERE, []
        opened.append((parent, frame, waiting))


def _turning(chain: Chain) -> list[bool]:
    """Return which bodies can rotate, not only slide."""
    turns, slides = [False], chain.slides
    for body in chain.bodies:
        turns.append(bool(turns[body["parent"]] or not slides[body["first"] : body["stop"]].all()))
    return turns[1:]


def _require_one_way(chain: Chain, body: np.void, waiting: list[_Hinge]) -> None:
    """Refuse hinges at a massless point unless exactly one body follows, because they are written in this body."""
    if not waiting:
        return
    name, text = document.xml_joint_names(chain)[waiting[0].k], "which MuJoCo refuses; add mass, or use URDF"
    if body["first"] == body["stop"]:
        raise ArgumentError(f"joint {name!r} moves no mass, {text}", id="joint-without-inertia")
    if chain.bodies["fork"][body["parent"] - 1]:
        text = f"links branch off joint {name!r} at a point without mass, {text}"
        raise ArgumentError(text, id="joint-without-inertia")


def _tip(parent: ET.Element, own: ET.Element, tip: Tip, *, of_arm: bool) -> None:
    """Write a tip frame; tips other than the arm's also store the number of their link."""
    if not of_arm:
        _exact(own, f"tip.{tip.name}", tip.link, *tip.translation, *tip.rotation.flat)
    elif not np.array_equal(tip.rotation, np.eye(3)):
        _exact(own, "tip", *tip.translation, *tip.rotation.flat)
    body = _body(parent, tip.name, Pose(tip.rotation, tip.translation))
    # zero mass and inertia; without this element MuJoCo would move the centre, where forces act
    _inertial(body, np.zeros(1, BODY)[0], np.zeros(3), np.eye(3))
    ET.SubElement(body, "site", name=tip.name)


def _keyframe(parent: ET.Element, chain: Chain, initial: tuple[ArrayLike, ArrayLike]) -> None:
    q, qd = state("initial", initial, chain.n)
    order, own = depth_first(chain), document.base_joints(chain)
    q, qd, place, rates = q[order], qd[order], q[:own], qd[:own]
    if own:  # position and quaternion; velocity in axes of frame 0 and spin in axes of the base
        R = product(chain.bodies["rotation"][1], rotations_of(place[3:]))
        place = np.array([*place[:3], *quaternion_from_matrix(R)])
        rates = np.append(rates[:3], rates_matrices(q[3:6]) @ rates[3:])
    qpos, qvel = np.append(place, q[own:]), np.append(rates, qd[own:])
    ET.SubElement(parent, "key", name="initial", qpos=decimals(qpos), qvel=decimals(qvel))


def _exact(own: ET.Element, name: str, *values: float) -> None:
    ET.SubElement(own, "numeric", name=f"flexlink.{name}", data=decimals(values))


def _safe_step(chain: Chain, ties: Scene | None, initial: tuple[ArrayLike, ArrayLike] | None) -> float:
    """Return half the largest stable RK4 step, rounded down to one digit, at most MuJoCo's default of 2 ms.

    It is computed for a slightly bent arm, with ties for the initial state. Most flexible links diverge with 2 ms.
    """
    from flexlink.dynamics.vibration.stability import stable_step  # noqa: PLC0415  only if no step is given

    q, gains = chain.slightly_bent, None
    if ties is not None and require_type("ties", ties, Scene).ties:
        q = q if initial is None else np.asarray(initial[0])
        gains = spring_gains(ties, q)
    step = min(2e-3, stable_step(chain, q, gains=gains, method="RK4") / 2)
    digit = 10.0 ** math.floor(math.log10(step))
    return float(f"{math.floor(step / digit) * digit:.0e}")


@dataclasses.dataclass(frozen=True)
class _Hinge:
    """Hinge `k`, with its axis and position in the frame of the current body at zero angles."""

    k: int
    axis: Array
    pos: Array = dataclasses.field(default_factory=lambda: np.zeros(3))

    def write(self, body: ET.Element, name: str, hinge: np.void, coordinate: Coordinate) -> None:
        placed = {"axis": decimals(self.axis), "pos": decimals(self.pos)}
        numbers = {key: decimals([hinge[field]]) for key, field in JOINT_ATTRIBUTES.items()}
        own = {"user": decimals([*(hinge[field] for field in USER_FIELDS), *coordinate])}
        if ends := document.limits(hinge):  # MuJoCo does not enforce them
            own |= {"range": " ".join((WIDE | ends).values()), "limited": "false"}
        kind = "slide" if hinge["axis"] >= SLIDES else "hinge"
        ET.SubElement(body, "joint", {"name": name, "type": kind} | placed | numbers | own)


def _without_tendons(chain: Chain) -> NDArray[np.void]:
    """Return the hinges with their springs and dampers reduced by the tendons' shares."""
    if not len(chain.couplings):
        return chain.hinges
    hinges = chain.hinges.copy()
    for field in SHARED:
        hinges[field] = diagonal_remainder(chain, field)
    return hinges


def _body(parent: ET.Element, name: str, frame: Pose) -> ET.Element:
    quaternion = decimals(quaternion_from_matrix(frame.R))
    return ET.SubElement(parent, "body", name=name, pos=decimals(frame.p), quat=quaternion)


# Write springs and dampers between two joints as fixed tendons of MJCF.
#
# A tendon of length θ_i ± θ_j with stiffness |K_ij| adds |K_ij| to both joint stiffnesses and ±|K_ij| to their
# coupling, with the sign of K_ij. Dampers are treated in the same way. The joints keep
#
#     K_ii − Σ_j |K_ij|        D_ii − Σ_j |D_ij|
#
# which must not be negative. For joints about or along two axes the length is θ_i ± c θ_j with a power of two c near
# √(K_jj / K_ii), and the joints keep K_ii − |K_ij|/c and K_jj − c |K_ij|. Without `springlength` a tendon is slack at
# the joints' `springref`, like their springs. If K_ij and D_ij have different signs, the damper gets a separate tendon.


SHARED = {"stiffness": ("springs", "N m/rad"), "damping": ("dampers", "N m s/rad")}
"""Fields of a hinge to which tendons contribute, each with its name in messages and its unit."""


def add_tendons(root: ET.Element, chain: Chain, joints: Sequence[str]) -> None:
    """Add the tendons of a chain, named "inner:outer" after their joints, in the order of its couplings."""
    if not len(chain.couplings):
        return
    parent, found = ET.SubElement(root, "tendon"), list(_tendons(chain))
    names = unique(f"{joints[inner]}:{joints[outer]}" for inner, outer, *_ in found)
    for name, (inner, outer, sign, stiffness, damping) in zip(names, found, strict=True):
        numbers = {"stiffness": decimals([stiffness]), "damping": decimals([damping])}
        tendon = ET.SubElement(parent, "fixed", {"name": name} | numbers)
        ET.SubElement(tendon, "joint", joint=joints[inner], coef="1")
        ET.SubElement(tendon, "joint", joint=joints[outer], coef=f"{sign:g}")


def diagonal_remainder(chain: Chain, field: str) -> Array:
    """Return K_ii − Σ_j |K_ij| for `field` "stiffness", or D_ii − Σ_j |D_ij| for "damping", shape (n,)."""
    own, taken, value = chain.hinges[field], np.zeros(chain.n), np.abs(chain.couplings[field])
    inner, outer = chain.couplings["inner"], chain.couplings["outer"]
    levers = _levers(chain)
    np.add.at(taken, inner, value / levers)
    np.add.at(taken, outer, value * levers)
    left = own - taken
    if (left < 0).any():
        k, (name, unit) = int(np.argmin(left)), SHARED[field]
        text = f"joint {chain.joint_name(k)!r}: {name} to other joints of its cell total {taken[k]:.6g} {unit}, more "
        text += f"than its own {own[k]:.6g} {unit}: MuJoCo's tendons cannot represent that; {_instead(chain, k, field)}"
        raise ArgumentError(text, id="tendon-stiffness")
    return left


def levers_of(own: Array, other: Array, apart: Mask) -> Array:
    """Coefficients c of joints j in tendons of joints i and j, from K_ii and K_jj; 1 if not `apart`, about one axis."""
    able = apart & (own > 0) & (other > 0)
    return np.asarray(2.0 ** np.round(np.log2(np.where(able, other, 1.0) / np.where(able, own, 1.0)) / 2))


def _levers(chain: Chain) -> Array:
    pairs = [chain.hinges[chain.couplings[end]] for end in ("inner", "outer")]
    (own, other), axes = (each["stiffness"] for each in pairs), [each["axis"] for each in pairs]
    return levers_of(own, other, axes[0] != axes[1])


def _instead(chain: Chain, k: int, field: str) -> str:
    """Return the remedy; only damping with `law = "constant"` couples joints without a spring."""
    if field == "damping" and (chain.couplings["stiffness"] == 0).any():
        return "use damping of law = 'proportional', or URDF or SDF"
    link, axis = chain.link_names[chain.coordinate(k).link - 1], chain.hinges["axis"]
    if (axis[chain.couplings["inner"]] != axis[chain.couplings["outer"]]).any():
        return f"use URDF or SDF, which take sections that couple axes, as in link {link!r}"
    return f"use more segments in link {link!r}, whose section or material changes too fast, or use URDF or SDF"


def _tendons(chain: Chain) -> Iterator[tuple[int, int, float, float, float]]:
    """Yield fixed tendons over two joints with coefficients 1 and ±c: both joints, ±c, stiffness, damping."""
    for coupling, c in zip(chain.couplings, _levers(chain).tolist(), strict=True):
        i, j, k, d = coupling.item()
        if k * d < 0:
            yield i, j, math.copysign(c, k), abs(k) / c, 0.0
            yield i, j, math.copysign(c, d), 0.0, abs(d) / c
        else:
            yield i, j, -c if k < 0 or d < 0 else c, abs(k) / c, abs(d) / c


# Principal moments and axes of an inertia by Jacobi's method, whose rotations each zero one product of inertia.
#
# The order is cyclic by rows (Golub & Van Loan, Matrix Computations, 8.5.4). All sums have a fixed order, so a file is
# the same on every CPU. With LAPACK the last digits, and the axes of nearly equal moments, depend on the BLAS.


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Return the moments in ascending order, and the axes as columns of a rotation R: I = R diag(moments) Rᵀ."""
    I, R = np.array(inertia, dtype=float), np.eye(3)
    negligible = np.finfo(float).eps ** 2 * np.abs(I).max()  # a product this small does not change moments or axes
    sweeps = 5  # convergence is quadratic from sweep 2 on; more sweeps of equal moments only add rounding errors
    for _ in range(sweeps):
        rotated = False
        for j, k in ((0, 1), (0, 2), (1, 2)):
            if abs(I[j, k]) > negligible:
                rotated = True
                _rotate(I, R, j, k)
        if not rotated:
            break
    moments, order = np.diag(I), np.argsort(np.diag(I), kind="stable")
    axes = R[:, order]
    right_handed = dot(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2]) > 0
    return moments[order], axes if right_handed else -axes


def _rotate(I: Array, R: Array, j: int, k: int) -> None:
    """Update I → Jᵀ I J and R → R J in place, with the smaller of the angles that make I_jk zero."""
    τ = (I[k, k] - I[j, j]) / (2 * I[j, k])
    t = math.copysign(1.0, τ) / (abs(τ) + math.hypot(1.0, τ))  # tan(angle)
    c = 1 / math.hypot(1.0, t)
    s, change = t * c, t * I[j, k]
    ends = I[j, j] - change, I[k, k] + change
    for matrix in (I, I.T, R):  # columns of I, rows of I, columns of R
        matrix[:, j], matrix[:, k] = c * matrix[:, j] - s * matrix[:, k], s * matrix[:, j] + c * matrix[:, k]
    (I[j, j], I[k, k]), I[j, k], I[k, j] = ends, 0.0, 0.0


SMALLEST = 1e-15  # kg, kg m²: MuJoCo's mjMINVAL


def _principal(body: np.void) -> tuple[Array, Array]:
    """Return principal moments and axes, accurate to 2e-15; MuJoCo's `fullinertia` has errors of 1e-14.

    MuJoCo replaces axes within 1e-6 of the body's axes by the body's axes, and a centre within 1e-6 m of the body's
    origin by the origin. It does not do so if the axes are in the order Y, Z, X, which is used in these cases.
    """
    I, center = body["inertia"], np.abs(body["center"]).max()
    moments, axes = (np.diag(I), np.eye(3)) if np.array_equal(I, np.diag(np.diag(I))) else principal_axes(I)
    away = np.abs(axes - np.eye(3)).max()
    near = 4e-6  # rotations [rad] and offsets [m] below this are "in these cases"; MuJoCo's limit is 1e-6
    if away < near and (away or 0 < center < near):
        return moments[[1, 2, 0]], axes[:, [1, 2, 0]]
    return moments, axes


def _require_loadable(chain: Chain, body: np.void, moments: Array) -> None:
    """Raise an error for a body that MuJoCo refuses, because MJCF has no other representation of this body."""
    light = body["mass"] < SMALLEST or moments.min() < SMALLEST
    if not light and moments.max() * (1 - ROUNDING) <= _largest_possible(moments):
        return
    joint = int(body["stop"]) - 1
    number = chain.coordinate(joint).link
    link = f"link {chain.link_names[number - 1]!r}" if number else "the base"
    rule = f"requires {SMALLEST:g} or more of each" if light else "accepts no moment larger than the other two together"
    text = f"segment after joint {chain.joint_name(joint)!r}: mass {body['mass']:.3g} kg, principal moments of inertia "
    text += f"{', '.join(f'{moment:.3g}' for moment in moments)} kg m²: MuJoCo {rule}; change section, segments or hub "
    raise ArgumentError(f"{text}of {link} or the payload, or use URDF", id="inertia-impossible")


def _largest_possible(moments: Array) -> float:
    """Return the sum of the two smaller moments, which bounds the largest; it is added in MuJoCo's order."""
    low, middle, _ = np.sort(moments)
    return float(low + middle)


def _inertial(parent: ET.Element, body: np.void, moments: Array, axes: Array) -> None:
    """Write mass, centre and principal moments."""
    ET.SubElement(
        parent, "inertial", mass=decimals([body["mass"]]), pos=decimals(body["center"]),
        quat=decimals(quaternion_from_matrix(axes)), diaginertia=decimals(moments),
    )  # fmt: skip
