"""A chain as Pinocchio models built in code, with one joint per hinge or per hinge group, for each suitable joint type.

SphericalZYX rotates about Z, Y, X, but a hinge group about X, Y, Z. In axes turned by S about Y (x' = −z, z' = x), the
rotation of the group is
Rx(a) Ry(b) Rz(c) = S Rz(a) Ry(b) Rx(−c) Sᵀ.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from flexlink.chain.chain import Chain
from flexlink.common.types import Array

REVOLUTE = {0: pin.JointModelRX, 1: pin.JointModelRY, 2: pin.JointModelRZ}
S = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def build_all(chain: Chain) -> dict[str, tuple[Any, Array]]:
    """Models by joint type, each with the sign of every coordinate, shape (n,)."""
    sizes = set((chain.bodies["stop"] - chain.bodies["first"]).tolist())
    kinds = ["revolute joints"]
    kinds += ["universal joints"] if 2 in sizes else []
    kinds += ["spherical ZYX joints"] if 3 in sizes else []
    return {kind: build(chain, kind) for kind in kinds}


def build(chain: Chain, kind: str) -> tuple[Any, Array]:
    """The chain with joints of one type for hinge groups with more than one axis."""
    model, parent, place, sign = pin.Model(), 0, pin.SE3.Identity(), np.ones(chain.n)
    for i, body in enumerate(chain.bodies):
        place = place * pin.SE3(body["rotation"].copy(), body["translation"].copy())
        after = pin.SE3.Identity()
        axes = chain.hinges["axis"][body["first"] : body["stop"]].tolist()
        if kind == "spherical ZYX joints" and axes == [0, 1, 2]:
            turned = pin.SE3(S, np.zeros(3))
            place, after = place * turned, turned.inverse()
            sign[body["first"] + 2] = -1.0
        for k, joint in enumerate(_joints(axes, kind)):
            parent, place = model.addJoint(parent, joint, place, f"{i}.{k}"), pin.SE3.Identity()
        place = place * after
        if parent:
            inertia = pin.Inertia(float(body["mass"]), body["center"].copy(), body["inertia"].copy())
            model.appendBodyToJoint(parent, inertia, place)
    model.gravity.linear = chain.gravity.copy()
    model.armature = chain.hinges["armature"].copy()
    return model, sign


def _joints(axes: list[int], kind: str) -> list[Any]:
    if kind == "universal joints" and len(axes) == 2:
        return [pin.JointModelUniversal(*np.eye(3)[axes])]
    if kind == "spherical ZYX joints" and axes == [0, 1, 2]:
        return [pin.JointModelSphericalZYX()]
    return [REVOLUTE[axis]() for axis in axes]
