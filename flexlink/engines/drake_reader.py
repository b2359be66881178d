"""The record of a finalized Drake plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.multibody.tree import BodyIndex, ForceElementIndex, RevoluteJoint, RevoluteSpring

from flexlink.common.types import Array, Indices
from flexlink.engines.read_back import ReadBack, merge_bodies, no_actuators, require_hinges


def hinges(plant: Any) -> list[Any]:
    """The joints that move, in Drake's order.

    Raises
    ------
    ArgumentError
        A joint is not a hinge, for instance the floating base of a model without a fixed joint.
    """
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    moving = sorted((joint for joint in joints if joint.num_velocities()), key=lambda joint: joint.velocity_start())
    kinds = ["" if isinstance(joint, RevoluteJoint) else joint.type_name() for joint in moving]
    require_hinges([(joint.name(), kind) for joint, kind in zip(moving, kinds, strict=True)])
    return moving


def read(plant: Any, context: Any, own: Mapping[str, Array], unspecified: frozenset[str]) -> ReadBack:
    """The record of a plant of hinges, with the fields `own` that the adapter keeps: coulomb, coulomb_width."""
    joints = hinges(plant)
    n = len(joints)
    plant.SetPositions(context, np.zeros(n))
    frames = [joint.frame_on_child().CalcPoseInWorld(context) for joint in joints]
    points = np.array([frame.translation() for frame in frames])
    R = np.array([frame.rotation().matrix() for frame in frames])
    axes = np.array([turned @ joint.revolute_axis() for turned, joint in zip(R, joints, strict=True)])
    behind = _behind(plant, joints)
    springs = {spring.joint().name(): spring for spring in _springs(plant)}
    limits = {actuator.joint().name(): actuator.effort_limit() for actuator in _actuators(plant)}
    most = np.array([limits.get(joint.name(), np.inf) for joint in joints])
    driven = np.array(
        [float(joint.name() in limits) for joint in joints]
    )  # the input of an actuator is the joint's torque
    rotors = {actuator.joint().name(): actuator.default_reflected_inertia() for actuator in _actuators(plant)}
    values: dict[str, Any] = {
        "stiffness": [springs[j.name()].default_stiffness() if j.name() in springs else 0.0 for j in joints],
        "rest": [springs[j.name()].default_nominal_angle() if j.name() in springs else 0.0 for j in joints],
        "damping": [joint.default_damping() for joint in joints],
        "armature": [rotors.get(joint.name(), 0.0) for joint in joints],
    }
    fields: dict[str, Any] = {field: np.array(numbers, float) for field, numbers in values.items()} | dict(own)
    parents = np.array([behind[int(joint.parent_body().index())] for joint in joints])
    fields |= _bodies(plant, context, behind, points)
    return ReadBack(
        tuple(joint.name() for joint in joints), parents, axes, points, R,
        **no_actuators(n) | {"gear": driven, "effort": np.stack([-most, most], axis=1)}, **fields,
        gravity=np.array(plant.gravity_field().gravity_vector()), tip=_tip(plant, context), unspecified=unspecified,
    )  # fmt: skip


def _behind(plant: Any, joints: list[Any]) -> Indices:
    """The hinge that moves each body, −1 for fixed bodies."""
    carrier = {int(joint.child_body().index()): k for k, joint in enumerate(joints)}
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
    return [element for element in elements if isinstance(element, RevoluteSpring)]


def _actuators(plant: Any) -> list[Any]:
    return [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]


def _tip(plant: Any, context: Any) -> Array | None:
    if not plant.HasFrameNamed("tip"):
        return None
    return np.array(plant.GetFrameByName("tip").CalcPoseInWorld(context).translation())
