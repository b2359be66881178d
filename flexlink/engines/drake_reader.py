"""Read the record (`ReadBack`) of a finalized Drake plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.multibody.tree import (
    BodyIndex,
    ForceElementIndex,
    PrismaticJoint,
    PrismaticSpring,
    QuaternionFloatingJoint,
    RevoluteJoint,
    RevoluteSpring,
)

from flexlink.common.types import Array, Indices
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates
from flexlink.engines.read_back import ReadBack, merge_bodies, no_actuators, require_joints

ONE_AXIS = (RevoluteJoint, PrismaticJoint)


def moving_joints(plant: Any) -> list[Any]:
    """Return the joints that can move, in Drake's order.

    Raises
    ------
    ArgumentError
        A joint is of a type that `require_joints` does not allow.
    """
    known = (*ONE_AXIS, QuaternionFloatingJoint)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    moving = sorted((joint for joint in joints if joint.num_velocities()), key=lambda joint: joint.velocity_start())
    require_joints([(joint.name(), "" if isinstance(joint, known) else joint.type_name()) for joint in moving])
    return moving


def degrees_of_freedom(plant: Any) -> dict[str, int]:
    """Map joint names to Drake's numbers; a floating base has six, rotation first, under flexlink's names."""
    found = dict[str, int]()
    for joint in moving_joints(plant):
        floats = isinstance(joint, QuaternionFloatingJoint)
        names = (*BASE_JOINTS[3:], *BASE_JOINTS[:3]) if floats else (joint.name(),)
        found |= {name: joint.velocity_start() + k for k, name in enumerate(names)}
    return {name: found[name] for name in (*(name for name in BASE_JOINTS if name in found), *found)}


def read(
    plant: Any, context: Any, theirs: Coordinates, names: Sequence[str], own: Mapping[str, Any],
    unspecified: frozenset[str],
) -> ReadBack:  # fmt: skip
    """Return the record of a plant with joints in the order of `names`; `own` contains fields stored by the adapter."""
    joints = [joint for joint in moving_joints(plant) for _ in range(joint.num_velocities())]
    n = len(joints)
    plant.SetPositions(context, theirs.position(np.zeros(n)))
    frames = [joint.frame_on_child().CalcPoseInWorld(context) for joint in joints]
    points = np.array([frame.translation() for frame in frames])
    R = np.array([frame.rotation().matrix() for frame in frames])
    slides = np.array([isinstance(joint, PrismaticJoint) for joint in joints])
    floats = theirs.reference is not None
    axes = np.array([turned @ _axis(joint) for turned, joint in zip(R, joints, strict=True)])
    if floats:  # flexlink's three slides and three rotations, in Drake's order
        slides[3:6], axes[:3], axes[3:6] = True, R[0].T, np.eye(3)
    behind = _behind(plant, joints)
    springs = {spring.joint().name(): spring for spring in _springs(plant)}
    limits = {actuator.joint().name(): actuator.effort_limit() for actuator in _actuators(plant)}
    most = np.array([limits.get(joint.name(), np.inf) for joint in joints])
    driven = np.array(
        [float(joint.name() in limits) for joint in joints]
    )  # the input of an actuator is the joint torque
    rotors = {actuator.joint().name(): actuator.default_reflected_inertia() for actuator in _actuators(plant)}
    values: dict[str, Any] = {
        "stiffness": [_stiffness(springs[j.name()]) if j.name() in springs else 0.0 for j in joints],
        "rest": [_rest(springs[j.name()]) if j.name() in springs else 0.0 for j in joints],
        "damping": [joint.default_damping() if isinstance(joint, ONE_AXIS) else 0.0 for joint in joints],
        "armature": [rotors.get(joint.name(), 0.0) for joint in joints],
    }
    fields: dict[str, Any] = {field: np.array(numbers, float) for field, numbers in values.items()}
    fields |= {name: np.zeros_like(given) for name, given in own.items()}
    before = np.array([behind[int(joint.parent_body().index())] for joint in joints])
    first = np.array([k == 0 or joint is not joints[k - 1] for k, joint in enumerate(joints)])
    parents = np.where(first, before, np.arange(n) - 1)
    if floats:  # in flexlink the rotations of a base follow its slides
        parents[3:6], parents[:3] = [-1, 3, 4], [5, 0, 1]
    fields |= _bodies(plant, context, behind, points)
    record = ReadBack(
        names=("",) * n, parents=parents, axes=axes, points=points, frames=R, slides=slides,
        **no_actuators(n) | {"gear": driven, "effort": np.stack([-most, most], axis=1)}, **fields,
        gravity=np.array(plant.gravity_field().gravity_vector()), tip=_tip(plant, context), unspecified=unspecified,
        bodies=tuple(joint.child_body().name() for joint in joints),
    )  # fmt: skip
    return dataclasses.replace(record.in_order(theirs.order), names=tuple(names), **own)


def _axis(joint: Any) -> Array:
    """Return the axis in the joint's frame; zero for a floating base."""
    if isinstance(joint, RevoluteJoint):
        return np.asarray(joint.revolute_axis())
    return np.asarray(joint.translation_axis()) if isinstance(joint, PrismaticJoint) else np.zeros(3)


def _stiffness(spring: Any) -> float:
    return float(spring.stiffness() if isinstance(spring, PrismaticSpring) else spring.default_stiffness())


def _rest(spring: Any) -> float:
    slides = isinstance(spring, PrismaticSpring)
    return float(spring.nominal_position() if slides else spring.default_nominal_angle())


def _behind(plant: Any, joints: list[Any]) -> Indices:
    """Return the last degree of freedom that moves each body: −1 if it is fixed, the last rotation if it floats."""
    carrier = {int(joint.child_body().index()): k for k, joint in enumerate(joints)}
    carrier |= {int(joint.child_body().index()): 2 for joint in joints if isinstance(joint, QuaternionFloatingJoint)}
    every = [plant.get_joint(index) for index in plant.GetJointIndices()]
    parent = {int(joint.child_body().index()): int(joint.parent_body().index()) for joint in every}
    behind = np.full(plant.num_bodies(), -1, dtype=np.intp)
    for body in range(plant.num_bodies()):
        at = body
        while at not in carrier and at in parent:
            at = parent[at]
        behind[body] = carrier.get(at, -1)
    return behind


def _bodies(plant: Any, context: Any, behind: Indices, points: Array) -> dict[str, Any]:
    bodies = [plant.get_body(BodyIndex(k)) for k in range(plant.num_bodies())]
    masses, centers, inertias = np.zeros(len(bodies)), np.zeros((len(bodies), 3)), np.zeros((len(bodies), 3, 3))
    for k, body in enumerate(bodies[1:], 1):  # the first is the world
        X, M = plant.EvalBodyPoseInWorld(context, body), body.default_spatial_inertia()
        R, c = X.rotation().matrix(), M.get_com()
        masses[k], centers[k] = M.get_mass(), X.translation() + R @ c
        inertias[k] = R @ M.Shift(c).CalcRotationalInertia().CopyToFullMatrix3() @ R.T
    return merge_bodies(behind, masses, centers, inertias, points)


def _springs(plant: Any) -> list[Any]:
    elements = [plant.get_force_element(ForceElementIndex(k)) for k in range(plant.num_force_elements())]
    return [element for element in elements if isinstance(element, RevoluteSpring | PrismaticSpring)]


def _actuators(plant: Any) -> list[Any]:
    return [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]


def _tip(plant: Any, context: Any) -> Array | None:
    if not plant.HasFrameNamed("tip"):
        return None
    return np.array(plant.GetFrameByName("tip").CalcPoseInWorld(context).translation())
