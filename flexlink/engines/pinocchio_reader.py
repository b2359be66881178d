"""The record of a Pinocchio model; springs and what else URDF cannot express come from our own elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.engines.read_back import Parts, ReadBack, merge_bodies, no_actuators, require_hinges
from flexlink.formats.urdf import LIMIT


def require_hinges_of(model: Any) -> None:
    """Refuse a model with other joints than hinges; see `require_hinges`."""
    joints = list(zip(model.names, model.joints, strict=True))[1:]
    kinds = [(name, joint.shortname(), joint.nq) for name, joint in joints]
    require_hinges([(name, "" if kind.startswith("JointModelR") and nq == 1 else kind) for name, kind, nq in kinds])


def transmissions(robot: ET.Element, names: Sequence[str]) -> Array:
    """Reduction of the <transmission> of every joint, 0 where there is none, shape (n,).

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
                raise ArgumentError(f"joint {name!r}: mechanicalReduction = {reduction!r} is not a number") from None
    return np.array([gear[name] for name in names])


def read(model: Any, own: Mapping[str, Any], unspecified: frozenset[str]) -> ReadBack:
    """The record of a model of hinges, with the fields `own` that the adapter keeps: springs, transmissions."""
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, np.zeros(model.nq))
    n = model.nv
    order = [model.joints[k].idx_v for k in range(1, n + 1)]
    if order != list(range(n)):
        raise ArgumentError(f"Pinocchio numbers the joints {order}; expected 0 … {n - 1}")
    axes = np.array(data.J.reshape(6, n)[3:].T)
    places, links = list(data.oMi)[1:], list(model.inertias)[1:]
    points, R = (np.array([getattr(place, part) for place in places]) for part in ("translation", "rotation"))
    masses, levers, inertias = (
        np.array([getattr(link, part) for link in links]) for part in ("mass", "lever", "inertia")
    )
    centers = points + np.einsum("bij,bj->bi", R, levers)
    bodies = merge_bodies(np.arange(n), masses, centers, R @ inertias @ R.mT, points) | {"parts": _parts(model, R)}
    most = np.array(model.upperEffortLimit)
    most[(most <= 0) | (most >= float(LIMIT["effort"]))] = (
        np.inf
    )  # URDF requires a number: 0 and huge values mean no limit
    return ReadBack(
        tuple(model.names[1:]), np.array(model.parents.tolist()[1:]) - 1, axes, points, R, **bodies,
        **no_actuators(n) | {"effort": np.stack([-most, most], axis=1)} | dict(own),
        damping=np.array(model.damping), coulomb=np.array(model.friction), armature=np.array(model.armature),
        gravity=np.array(model.gravity.linear), tip=_tip(model, data), unspecified=unspecified,
    )  # fmt: skip


def _parts(model: Any, R: Array) -> Parts:
    """Inertias of the links welded to each joint's link, which fixed frames keep, and of that link without them."""
    parts, rest = list[tuple[int, Any]](), list(model.inertias)
    for frame in model.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass and frame.parentJoint:
            part = frame.placement.act(frame.inertia)
            rest[frame.parentJoint] = rest[frame.parentJoint] - part
            parts.append((frame.parentJoint - 1, part))
    parts += [(k - 1, part) for k, part in enumerate(rest) if k]
    owner = np.array([k for k, _ in parts], dtype=np.intp)
    return Parts(owner, R[owner] @ np.array([part.inertia for _, part in parts]) @ R[owner].mT)


def _tip(model: Any, data: Any) -> Array | None:
    if not model.existFrame("tip", pin.FrameType.BODY):
        return None
    frame = model.frames[model.getFrameId("tip", pin.FrameType.BODY)]
    return np.array((data.oMi[frame.parentJoint] * frame.placement).translation)
