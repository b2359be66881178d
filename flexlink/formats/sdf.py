"""Chain ↔ SDFormat 1.10, with one link and one joint per coordinate, springs and dampers; read without rounding errors.

All links at a point except the last are massless. Zero mass must be written; links without `<inertial>` weigh 1 kg.
Joints with several axes (`universal`, `ball`) are not used, because Drake drops their springs without a warning. A
floating base is a link without a joint.

Drake reads rotor inertia from `drake:rotor_inertia`, but only if the joint has an actuator. Driven joints and joints
with a rotor have an actuator; all others have effort 0. Drake ignores the world's gravity and dry friction. Values that
SDFormat cannot represent are in attributes `flexlink:…`. Springs and dampers between two joints are elements
`<flexlink:coupling>` of the tip frame, the only place in a model where Drake ignores them without a warning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import require_bool, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.chain.forces import refuse_states
from flexlink.chain.rigid import rpy_from_matrix
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.formats import document, reading
from flexlink.formats.document import UPPER_TRIANGLE, Capsule, decimals, valid
from flexlink.formats.reading import End, Hinge, Mass, Node
from flexlink.kernels.layout import BODY, HINGE

NAMESPACES = {"xmlns:drake": "http://drake.mit.edu", "xmlns:flexlink": "urn:flexlink"}
DYNAMICS = {"damping": "damping", "friction": "coulomb", "spring_reference": "rest", "spring_stiffness": "stiffness"}
"""Maps elements of <dynamics> to fields of the hinge."""
STANDARD_FIELDS = {*DYNAMICS.values(), "armature", "axis", "lower", "upper"}


def to_sdf(chain: Chain, *, shapes: bool = True) -> str:
    """Write a chain as SDFormat 1.10.

    Parameters
    ----------
    chain, shapes
        The chain, and whether to write capsules for viewers, without mass and contact.

    Returns
    -------
    str
        The document: a world with gravity and one model. Joints are in sequential order, with the names of
        `Chain.joint_names` if SDFormat allows them. Frame `tip` is the tip frame; other tips are named
        after the links that end there. Numbers read back exactly; rotations are written as roll, pitch and yaw.

    Raises
    ------
    ArgumentError
        `chain` is not a Chain, or a tip frame cannot move.

    Examples
    --------
    >>> text = fl.to_sdf(chain, shapes=False)
    >>> print("<spring_stiffness>" in text)
    True
    """
    refuse_states(require_type("chain", chain, Chain), "no file represents it")
    name, *names = sdf_names(chain)
    joints, links, frames = names[: chain.n], names[chain.n : 2 * chain.n], names[2 * chain.n :]
    sdf = ET.Element("sdf", {"version": "1.10", **NAMESPACES})
    world = ET.SubElement(sdf, "world", name=name)
    _values(world, {"gravity": decimals(chain.gravity)})
    attributes = {"name": valid(chain.name), "links": document.names_text(chain.link_names)}
    attributes |= document.rotation_springs(chain) | document.tree_attributes(chain)
    model = ET.SubElement(world, "model", name=name)
    model.attrib.update({f"flexlink:{key}": value for key, value in attributes.items()})
    shown = document.capsules_behind(chain) if require_bool("shapes", shapes) else {}
    if own := document.base_joints(chain):
        base = ET.SubElement(model, "link", name=links[own - 1])
        _pose(base, np.zeros(3), chain.bodies["rotation"][1], {})
        _contents(base, chain.bodies[1], shown.get(own - 1, []))
    for k, before, translation, rotation, body in document.joint_places(chain):
        link, parent = ET.SubElement(model, "link", name=links[k]), links[before] if before >= 0 else "world"
        _pose(link, translation, rotation, {} if parent == "world" else {"relative_to": parent})
        _contents(link, np.zeros(1, BODY)[0] if body is None else body, shown.get(k, []))
        _joint(model, chain, k, joints[k], (parent, links[k]))
    for tip, called in zip(document.tips(chain), frames, strict=True):
        if tip.parent < 0:
            text = "does not move; SDFormat attaches frames to moving links only"
            raise ArgumentError(f"link {chain.link_names[tip.link - 1]!r} {text}", id="sdf-fixed-link")
        number = {"flexlink:link": str(tip.link)} if called != frames[-1] else {}
        frame = ET.SubElement(model, "frame", {"name": called, "attached_to": links[tip.parent], **number})
        _pose(frame, tip.translation, tip.rotation, {})
    for coupling in document.couplings(chain, joints):
        ET.SubElement(frame, "flexlink:coupling", coupling)
    return document.text(sdf)


def sdf_names(chain: Chain) -> list[str]:
    """Unique names of model, joints, links and tips, without "::", reserved words and Drake's frames `…_child`."""
    plain = [_allowed(valid(name)) for name in (chain.name, *chain.joint_names)]
    joints, own = unique(["world", "", *plain[1:]])[2:], document.base_joints(chain)
    children = [f"{name}_child" for name in joints]
    moved = [_allowed(name) for name in document.moved_links(chain, joints)]
    ends = [_allowed(name) for name in document.other_ends(chain, moved)]
    others = unique([*joints, *children, "tip", *moved, "base_link", *ends])[2 * chain.n :]
    tip, links, (base, *ends) = others[0], others[1 : chain.n - own + 1], others[chain.n - own + 1 :]
    return [f"{plain[0]}_" if plain[0] == "world" else plain[0], *joints, *[base] * own, *links, *ends, tip]


def _allowed(name: str) -> str:
    name = name.replace("::", ".")
    return f"{name}." if name.startswith("__") and name.endswith("__") else name


def _values(parent: ET.Element, values: Mapping[str, str]) -> None:
    """Write one element per value, as SDFormat requires."""
    for name, value in values.items():
        ET.SubElement(parent, name).text = value


def _pose(parent: ET.Element, translation: Array, rotation: Array, attributes: Mapping[str, str]) -> None:
    own = {f"flexlink:{name}": value for name, value in document.exact_rotation(rotation).items()}
    ET.SubElement(parent, "pose", {**attributes, **own}).text = decimals([*translation, *rpy_from_matrix(rotation)])


def _contents(link: ET.Element, body: np.void, shown: list[Capsule]) -> None:
    """Write the inertia of a link and its visual shapes."""
    inertial = ET.SubElement(link, "inertial")
    _values(inertial, {"pose": decimals([*body["center"], 0, 0, 0]), "mass": decimals([body["mass"]])})
    _values(ET.SubElement(inertial, "inertia"), document.moments_text(body))
    for number, capsule in enumerate(shown):
        visual = ET.SubElement(link, "visual", name=f"capsule_{number + 1}" if number else "capsule")
        _values(visual, {"pose": decimals(capsule.pose)})
        dimensions = {"radius": decimals([capsule.radius]), "length": decimals([capsule.length])}
        _values(ET.SubElement(ET.SubElement(visual, "geometry"), "capsule"), dimensions)
        _values(ET.SubElement(visual, "material"), dict.fromkeys(("ambient", "diffuse"), capsule.colour[1]))


def _joint(model: ET.Element, chain: Chain, k: int, name: str, ends: tuple[str, str]) -> None:
    hinge = chain.hinges[k]
    own = {f"flexlink:{key}": value for key, value in document.custom_values(chain, k, STANDARD_FIELDS).items()}
    joint = ET.SubElement(model, "joint", {"name": name, "type": chain.joint_kinds[k].name, **own})
    _values(joint, dict(zip(("parent", "child"), ends, strict=True)))
    axis = ET.SubElement(joint, "axis")
    _values(axis, {"xyz": document.axis_text(hinge)})
    limit = document.limits(hinge) | ({"effort": "0"} if chain.coordinates[k].axis and not hinge["armature"] else {})
    if limit:
        _values(ET.SubElement(axis, "limit"), limit)
    _values(ET.SubElement(axis, "dynamics"), {key: decimals([hinge[field]]) for key, field in DYNAMICS.items()})
    if hinge["armature"]:
        _values(joint, {"drake:rotor_inertia": decimals([hinge["armature"]]), "drake:gear_ratio": "1"})


OWN = f"{{{NAMESPACES['xmlns:flexlink']}}}"  # the namespace prefix as parsers write it


def read_sdf(text: str | bytes, *, what: str = "the SDF") -> Chain:
    """Read an SDF file written by `to_sdf` back to its chain; parameters and errors are as in `read_urdf`."""
    return reading.read(text, what, tag="sdf", to_chain=_chain, write=to_sdf, ignored=frozenset({"visual"}))


def _chain(sdf: Node) -> Chain:
    model = sdf.one("world").one("model")
    links, bodies, joints = model.names(f"{OWN}links"), model.all("link"), model.all("joint")
    floating = bodies[: max(0, len(bodies) - len(joints))]
    if len(bodies) < len(joints) or len(floating) > 1:
        raise model.error(f"{len(joints)} joints, {len(bodies)} links: not a file written by flexlink")
    behind = {_text(joint, "child"): joint.attribute("name") for joint in joints}
    hinges = [_read_hinge(*both, links, behind) for both in zip(joints, bodies[len(floating) :], strict=True)]
    ends = [
        End(frame, reading.link_of(frame, f"{OWN}link", links), behind.get(frame.attribute("attached_to"), ""),
            *_read_place(frame))
        for frame in model.all("frame")
    ]  # fmt: skip
    mass = _read_body(floating[0].one("inertial")) if floating else None
    gravity = sdf.one("world").one("gravity").numbers(3)
    return reading.chain_of(model, model, OWN, gravity, links, hinges, ends, mass, model.all(f"frame/{OWN}coupling"))


def _text(element: Node, path: str) -> str:
    return element.one(path).element.text or ""


def _read_place(element: Node) -> tuple[Array, Array]:
    pose = element.one("pose")
    return np.array(pose.numbers(6)[:3]), pose.rotation(f"{OWN}rotation")


def _read_hinge(joint: Node, link: Node, links: Sequence[str], behind: Mapping[str, str]) -> Hinge:
    numbers = {key: joint.number(f"{OWN}{key}") for key in HINGE.names or () if key not in STANDARD_FIELDS}
    dynamics, axis = joint.one("axis").one("dynamics"), joint.one("axis").one("xyz")
    numbers |= {field: dynamics.one(key).number() for key, field in DYNAMICS.items()}
    lower, upper = joint.one("axis").all("limit/lower"), joint.one("axis").all("limit/upper")
    numbers |= {"lower": lower[0].number() if lower else -np.inf, "upper": upper[0].number() if upper else np.inf}
    rotor = joint.all(f"{{{NAMESPACES['xmlns:drake']}}}rotor_inertia")
    numbers["axis"] = axis.unit_axis(axis.numbers(3), joint.attribute("type"))
    numbers["armature"] = rotor[0].number() if rotor else 0.0
    place = reading.coordinate(joint, joint.numbers(3, f"{OWN}coordinate"), links)
    parent = behind.get(_text(joint, "parent"), "")
    return Hinge(joint, parent, *_read_place(link), numbers, place, _read_body(link.one("inertial")))


def _read_body(inertial: Node) -> Mass | None:
    mass = inertial.one("mass").number()
    I = reading.inertia_matrix([inertial.one("inertia").one(key).number() for key in UPPER_TRIANGLE])
    return (mass, np.array(inertial.one("pose").numbers(6)[:3]), I) if mass or I.any() else None
