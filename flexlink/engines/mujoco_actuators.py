"""Actuators of a compiled MuJoCo model as `ACTUATOR_FIELDS` of its joints.

An actuator at a joint with gear r, gain g and bias b₀ + b₁ l + b₂ l̇, where l = r q is its length, exerts

    T = r (g u + b₀) + r² b₁ q + r² b₂ q̇        limited to r · forcerange and to the joint's actuatorfrcrange

A motor has no bias; its command u is a torque if r g = 1. A servo's command u is an angle if r g = −r² b₁, or a rate
if r g = −r² b₂.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from flexlink.common.types import Array
from flexlink.engines.read_back import ACTUATOR_FIELDS, no_limits

AT_JOINTS = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}


def at_joints(model: Any) -> dict[str, Any]:
    """Return `ACTUATOR_FIELDS`: motors and servos summed per joint, except those at a floating base."""
    fields: dict[str, Array] = {name: np.zeros(model.nv) for name in ACTUATOR_FIELDS if name != "effort"}
    fields["effort"] = no_limits(model.nv)
    limits = [list[Array]() for _ in range(model.nv)]
    servos = np.ones(model.nv)
    for number in _acting(model):
        if _kind(model, number):
            continue
        k, r = int(model.jnt_dofadr[model.actuator_trnid[number, 0]]), float(model.actuator_gear[number, 0])
        gain, (b0, b1, b2) = r * float(model.actuator_gainprm[number, 0]), _bias(model, number)
        fields["constant_torque"][k] += r * b0
        fields["servo_stiffness"][k] -= r**2 * b1
        fields["servo_damping"][k] -= r**2 * b2
        if b1 or b2:
            servos[k] *= gain / (-(r**2) * (b1 or b2))
        else:
            fields["gear"][k] += gain
        limits[k].append(_limit(model, number, r, None if b1 or b2 else gain))
    for k, some in enumerate(limits):
        if some:
            fields["gear"][k] = (fields["gear"][k] or 1.0) * servos[k]
            fields["effort"][k] = np.sum(some, axis=0)
        if model.jnt_actfrclimited[joint := model.dof_jntid[k]]:
            fields["effort"][k] = _narrower(fields["effort"][k], model.jnt_actfrcrange[joint])
    return fields


def added(model: Any, name: str) -> Array:
    """Return r² times the armature or damping of actuators, summed per joint; zero before MuJoCo 3.5."""
    total, own = np.zeros(model.nv), getattr(model, f"actuator_{name}", ())
    for number in range(len(own)):
        if mujoco.mjtTrn(model.actuator_trntype[number]) in AT_JOINTS:
            joint = model.actuator_trnid[number, 0]
            total[model.jnt_dofadr[joint]] += model.actuator_gear[number, 0] ** 2 * np.ravel(own[number])[0]
    return total


def others(model: Any) -> Iterator[str]:
    """Yield a description of each actuator that is not a motor or servo at a joint."""
    for number in _acting(model):
        if kind := _kind(model, number):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number) or f"actuator {number}"
            yield f"{name!r} ({kind})"


def _acting(model: Any) -> Iterator[int]:
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        return
    for number, group in enumerate(model.actuator_group):  # groups >= 31 cannot be disabled
        if not (0 <= group < 31 and model.opt.disableactuator >> int(group) & 1):
            yield number


def _kind(model: Any, number: int) -> str:
    """Return MuJoCo's keyword that excludes an actuator from comparison; "" for a motor or servo at a joint."""
    named = (
        ("trntype", mujoco.mjtTrn, AT_JOINTS), ("dyntype", mujoco.mjtDyn, {mujoco.mjtDyn.mjDYN_NONE}),
        ("gaintype", mujoco.mjtGain, {mujoco.mjtGain.mjGAIN_FIXED}),
        ("biastype", mujoco.mjtBias, {mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE}),
    )  # fmt: skip
    for field, kinds, plain in named:
        value = kinds(getattr(model, f"actuator_{field}")[number])
        if value not in plain:
            return f"{field} {value.name.rpartition('_')[2].lower()}"
    free = model.jnt_type[model.actuator_trnid[number, 0]] == mujoco.mjtJoint.mjJNT_FREE
    return "at a floating base" if free else ""


def _bias(model: Any, number: int) -> tuple[float, float, float]:
    affine = model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
    b0, b1, b2 = model.actuator_biasprm[number, :3].tolist() if affine else (0.0, 0.0, 0.0)
    return b0, b1, b2


def _limit(model: Any, number: int, r: float, gain: float | None) -> Array:
    """Return the smallest and largest torque of an actuator; a motor is also limited by its control range."""
    limit: Array = no_limits(1)[0]
    if model.actuator_forcelimited[number]:
        limit = _narrower(limit, np.sort(r * model.actuator_forcerange[number]))
    if gain is not None and model.actuator_ctrllimited[number]:
        limit = _narrower(limit, np.sort(gain * model.actuator_ctrlrange[number]))
    return limit


def _narrower(one: Array, other: Array) -> Array:
    """Return the intersection of two ranges; nan stays nan."""
    return np.array([np.maximum(one[0], other[0]), np.minimum(one[1], other[1])])
