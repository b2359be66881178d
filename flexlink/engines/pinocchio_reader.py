"""Record of a Pinocchio model; springs and other values that URDF cannot store come from flexlink's custom elements."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Indices
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates
from flexlink.engines.read_back import Parts, ReadBack, merge_bodies, no_actuators, require_joints
from flexlink.formats.urdf import LIMIT

FREE_FLYER = "JointModelFreeFlyer"


def require_joints_of(model: Any) -> None:
    """Refuse a model with joints other than hinges, slides and a floating base; see `require_joints`."""
    kinds = []
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        kind = joint.shortname()
        known = (kind.startswith(("JointModelR", "JointModelP")) and joint.nq == joint.nv == 1) or kind == FREE_FLYER
        kinds.append((name, "" if known else kind))
    require_joints(kinds)


def degrees_of_freedom(model: Any) -> dict[str, int]:
    """Map joint names to the model's numbers; a floating base has six, under flexlink's names."""
    found = dict[str, int]()
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        names = BASE_JOINTS if joint.shortname() == FREE_FLYER else (name,)
        found |= {each: joint.idx_v + k for k, each in enumerate(names)}
    return dict(sorted(found.items(), key=lambda pair: pair[1]))


def transmissions(robot: ET.Element, names: Sequence[str]) -> Array:
    """Return the reduction of every joint's <transmission>, 0 if it has none, shape (n,).

    Raises
    ------
    ArgumentError
        A reduction is not a number.
    """
    gear = dict.fromkeys(names, 0.0)
    for element in robot.findall("transmission"):
        reduction = element.findtext(".//mechanicalReduction") or "1"
        for joint in element.findall("joint"):
            name = joint.get("name", "")
            try:
                gear[name] = float(reduction)
            except ValueError:
                raise ArgumentError(
                    f"joint {name!r}: mechanicalReduction = {reduction!r} is not a number", id="number-in-file"
                ) from None
    return np.array([gear[name] for name in names])


def read(
    model: Any, theirs: Coordinates, names: Sequence[str], own: Mapping[str, Any], unspecified: frozenset[str]
) -> ReadBack:
    """Return the record of a model with joints in the order of `names`; `own` contains fields stored by the adapter."""
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, theirs.position(np.zeros(model.nv)))
    n, moving = model.nv, list(model.joints)[1:]
    joints = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in moving])  # joint number per coordinate
    last = np.array([-1, *(joint.idx_v + joint.nv - 1 for joint in moving)])
    first = np.array([joint.idx_v for joint in moving])
    parents = np.arange(n) - 1
    parents[first] = last[model.parents.tolist()[1:]]
    J = data.J.reshape(6, n)
    slides = ~J[3:].any(axis=0)
    axes = np.where(slides, J[:3], J[3:]).T
    if theirs.reference is not None:
        axes[:3] = np.eye(3)  # along the axes of frame 0, as in flexlink
    places = [np.array([getattr(place, part) for place in data.oMi]) for part in ("translation", "rotation")]
    inertias = [np.array([getattr(link, part) for link in model.inertias]) for part in ("mass", "lever", "inertia")]
    (p, R), (masses, levers, I) = places, inertias
    points = p[joints]
    bodies = merge_bodies(last, masses, p + np.einsum("bij,bj->bi", R, levers), R @ I @ R.mT, points)
    most = np.array(model.upperEffortLimit)
    most[(most <= 0) | (most >= float(LIMIT["effort"]))] = (
        np.inf
    )  # URDF requires a number; 0 or a huge value means no limit
    nothing: dict[str, Any] = {name: np.zeros_like(values) for name, values in own.items()}
    record = ReadBack(
        names=("",) * n, parents=parents, axes=axes, points=points, frames=R[joints], slides=slides,
        **bodies | {"parts": _parts(model, R, last)},
        **nothing | no_actuators(n) | {"effort": np.stack([-most, most], axis=1)},
        damping=np.array(model.damping), coulomb=np.array(model.friction), armature=np.array(model.armature),
        gravity=np.array(model.gravity.linear), tip=_tip(model, data), unspecified=unspecified,
        bodies=tuple(_bodies(model)[k] for k in joints),
    )  # fmt: skip
    return dataclasses.replace(record.in_order(theirs.order), names=tuple(names), **own)


def _bodies(model: Any) -> dict[int, str]:
    """Return the name of the link that each joint moves, by the joint's number; other links are fixed to it."""
    bodies = {frame.parentJoint: frame.name for frame in reversed(model.frames) if frame.type == pin.FrameType.BODY}
    return dict.fromkeys(range(model.njoints), "") | bodies


def _parts(model: Any, R: Array, last: Indices) -> Parts:
    """Return inertias of the links welded to each joint's link (stored in fixed frames), and of that link alone."""
    parts, rest = list[tuple[int, Any]](), list(model.inertias)
    for frame in model.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass and frame.parentJoint:
            part = frame.placement.act(frame.inertia)
            rest[frame.parentJoint] = rest[frame.parentJoint] - part
            parts.append((frame.parentJoint, part))
    parts += [(k, part) for k, part in enumerate(rest) if k]
    joints = np.array([k for k, _ in parts], dtype=np.intp)
    return Parts(last[joints], R[joints] @ np.array([part.inertia for _, part in parts]) @ R[joints].mT)


def _tip(model: Any, data: Any) -> Array | None:
    if not model.existFrame("tip", pin.FrameType.BODY):
        return None
    frame = model.frames[model.getFrameId("tip", pin.FrameType.BODY)]
    return np.array((data.oMi[frame.parentJoint] * frame.placement).translation)
