"""SDF → elements of URDF: links have the frames of their first joints, as in URDF; their other joints close loops."""

from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.rigid import HERE, Pose, matrix_from_rpy_deg, rpy_from_matrix
from flexlink.common.errors import DataFileError
from flexlink.common.safe_xml import numbers_in
from flexlink.common.types import Array
from flexlink.common.wording import plural, truncated
from flexlink.robots.kinematic_tree import Closure


def as_urdf(sdf: ET.Element) -> tuple[ET.Element, list[Closure]]:
    """The model of an SDF document as elements of URDF, a tree from the link `world`, and what closes its loops."""
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if len(models) != 1 or sdf.findall(".//include") + sdf.findall(".//model/model") or not models[0].findall("link"):
        why = f"{plural(len(models), 'model')}, included or nested ones: expected one with all its links and joints"
        raise DataFileError(f"<sdf>: {why}", id="element-twice")
    model = models[0]
    robot, closures, above = ET.Element("robot", name=model.get("name", "")), list[Closure](), dict[str, str]()
    links, joints = ({each.get("name", ""): each for each in model.findall(tag)} for tag in ("link", "joint"))
    for name, joint in joints.items():
        above.setdefault(_text(joint, "child"), name)
    frames = {name: _place(model, above.get(name, name)) for name in links} | {"world": HERE}
    ET.SubElement(robot, "link", name="world")
    for name, link in links.items():
        _add_link(robot, name, link, frames[name].inverse.then(_place(model, name)))
    root = next((name for name in links if name not in above), "world")
    if not any(_text(joints[name], "parent") == "world" for name in above.values()):
        _add_joint(robot, f"world to {root}", ET.Element("joint", type="fixed"), ("world", root), frames[root])
    ties = {"revolute": "hinge", "continuous": "hinge", "ball": "point", "fixed": "weld"}
    for name, joint in joints.items():
        parent, child, kind = _text(joint, "parent"), _text(joint, "child"), joint.get("type", "")
        here = _place(model, name)
        if not {parent, child} <= frames.keys():
            why = f"parent = {truncated(parent)}, child = {truncated(child)}: expected links of the model, or world"
            raise DataFileError(f"joint {truncated(name)}: {why}", id="link-missing-in-file")
        axis = here.R.T @ _axis(model, joint, name, here)
        if above[child] == name:
            made = _add_joint(robot, name, joint, (parent, child), frames[parent].inverse.then(here))
            ET.SubElement(made, "axis", xyz=_words(axis))
            continue
        lacks = "" if kind in ties else f"no tie is like a joint of type {truncated(kind)}"
        acts = joint.find("axis/limit") is not None or joint.find("axis/dynamics") is not None
        lost = "; its limits, damping and friction are left out" * acts
        one, other = ((link, frames[link].inverse.then(here)) for link in (child, parent))
        closures.append(Closure(name, ties.get(kind, kind), (one, other), lacks=lacks, lost=lost, axis=axis.tolist()))
    return robot, closures


def _place(model: ET.Element, name: str) -> Pose:
    """Pose of a link, joint or frame of a model in the world."""
    named = {each.get("name"): each for each in model if each.tag in {"link", "joint", "frame"}}
    place, seen = HERE, set[str]()
    while name not in {"", "__model__"}:
        if name not in named or name in seen:
            why = "goes round in a circle" if name in seen else "is no link, joint or frame of the model"
            raise DataFileError(f"<pose>: frame {truncated(name)} {why}", id="link-missing-in-file")
        seen.add(name)
        element = named[name]
        place = _pose(element).then(place)
        pose, default = element.find("pose"), _text(element, "child") or element.get("attached_to", "")
        name = default if pose is None else pose.get("relative_to", default)
    return _pose(model).then(place)


def _pose(element: ET.Element) -> Pose:
    """The pose that an element states, in the frame to which it refers."""
    pose, text = element.find("pose"), _text(element, "pose", "0 0 0 0 0 0")
    x, y, z, *turns = numbers_in(text, f"{element.tag} {truncated(element.get('name', ''))}: <pose>", 6)
    in_degrees = pose is not None and pose.get("degrees") in {"true", "1"}
    roll, pitch, yaw = turns if in_degrees else np.degrees(turns).tolist()
    return Pose(matrix_from_rpy_deg((roll, pitch, yaw)), np.array([x, y, z]))


def _axis(model: ET.Element, joint: ET.Element, name: str, here: Pose) -> Array:
    """Direction of a joint's axis in the world, which need not be normalized."""
    element, xyz = joint.find("axis/xyz"), _text(joint, "axis/xyz", "0 0 1")
    frame = "" if element is None else element.get("expressed_in", "")
    if _text(joint, "axis/use_parent_model_frame") in {"true", "1"}:  # before SDFormat 1.7
        frame = "__model__"
    R = _place(model, frame).R if frame else here.R
    return np.asarray(R @ numbers_in(xyz, f"joint {truncated(name)}: <axis xyz>", 3))


def _add_link(robot: ET.Element, name: str, link: ET.Element, place: Pose) -> None:
    """Add a link, whose frame in SDF has this place in its frame; by default SDF gives it 1 kg and 1 kg m²."""
    inertial, stated = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial"), link.find("inertial")
    if stated is not None and stated.get("auto") in {"true", "1"}:
        why = "<inertial auto> is not read; give mass and inertia"
        raise DataFileError(f"link {truncated(name)}: {why}", id="missing-in-file")
    _add_origin(inertial, place if stated is None else place.then(_pose(stated)))
    ET.SubElement(inertial, "mass", value=_text(link, "inertial/mass", "1"))
    moments = {f"i{ab}": str(int(ab[0] == ab[1])) for ab in ("xx", "yy", "zz", "xy", "xz", "yz")}
    ET.SubElement(inertial, "inertia", {key: _text(link, f"inertial/inertia/{key}", moments[key]) for key in moments})


def _add_joint(robot: ET.Element, name: str, joint: ET.Element, ends: tuple[str, str], origin: Pose) -> ET.Element:
    """Add a joint between a parent and a child, with limits and friction of a joint of SDF."""
    made = ET.SubElement(robot, "joint", name=name, type=joint.get("type", ""))
    for tag, link in zip(("parent", "child"), ends, strict=True):
        ET.SubElement(made, tag, link=link)
    _add_origin(made, origin)
    # SDF writes inf for no limit, URDF 1e16
    limits = {key: _text(joint, f"axis/limit/{key}", "inf").replace("inf", "1e16") for key in ("lower", "upper")}
    ET.SubElement(made, "limit", limits)
    ET.SubElement(made, "dynamics", {key: _text(joint, f"axis/dynamics/{key}", "0") for key in ("damping", "friction")})
    return made


def _add_origin(parent: ET.Element, pose: Pose) -> None:
    ET.SubElement(parent, "origin", xyz=_words(pose.p), rpy=_words(np.array(rpy_from_matrix(pose.R))))


def _words(vector: Array) -> str:
    return " ".join(map(repr, vector.tolist()))


def _text(element: ET.Element, path: str, default: str = "") -> str:
    return (element.findtext(path) or "").strip() or default
