"""A robot's original URDF in Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from flexlink.common.types import Array


class Original:
    """The joints `names` of a URDF, in this order; all other joints are fixed at their positions [rad, m].

    Pinocchio describes a `continuous` joint by two numbers, cosine and sine. With a free base, six coordinates come
    first. The base is at frame 0; if it does not spin, its rates and accelerations equal those of Pinocchio's free
    flyer.
    """

    def __init__(
        self, path: Path, names: list[str], positions: Mapping[str, float], gravity: Array, *, free_base: bool = False
    ) -> None:
        whole = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free_base else []))
        floats = 6 * free_base
        for frame in whole.frames:
            if frame.type == pin.FrameType.BODY:  # `buildReducedModel` refuses a link with the name of a joint
                frame.name += " link"
        held = [number for number in range(1 + free_base, whole.njoints) if whole.names[number] not in names]
        posture = pin.neutral(whole)
        for number in held:
            _put(posture, whole.joints[number], positions.get(whole.names[number], 0.0))
        self.model = pin.buildReducedModel(whole, held, posture)
        self.model.gravity.linear = gravity
        self.data = self.model.createData()
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in names]
        self.order = [*range(floats), *(joint.idx_v for joint in self.joints)]

    def mass_matrix(self, q: Array) -> Array:
        """M by composite rigid bodies."""
        M = pin.crba(self.model, self.data, self._posture(q))
        full = np.triu(M) + np.triu(M, 1).T
        return np.asarray(full[np.ix_(self.order, self.order)])

    def sizes(self, q: Array) -> Array:
        """√ of the inertia that each joint moves: the largest moment about its origin, or the mass for a sliding joint.

        |M_ij| ≤ s_i s_j. Unlike √(M_ii M_jj), this bound is not reduced by cancellation about some axis.
        """
        pin.crba(self.model, self.data, self._posture(q), pin.Convention.LOCAL)
        bodies = [self.data.Ycrb[joint.id] for joint in self.joints]
        slides = [joint.shortname().removeprefix("JointModel").startswith("P") for joint in self.joints]
        moved = [
            body.mass if slid else np.linalg.eigvalsh(body.matrix()[3:, 3:])[-1]
            for body, slid in zip(bodies, slides, strict=True)
        ]
        return np.sqrt(moved)

    def bias_torque(self, q: Array, qd: Array) -> Array:
        """T_GC by recursive Newton-Euler."""
        return np.asarray(pin.nle(self.model, self.data, self._posture(q), self._sorted(qd))[self.order])

    def acceleration(self, q: Array, qd: Array, tau: Array) -> Array:
        """q̈ from joint torques only: Pinocchio's `aba` ignores friction."""
        found = pin.aba(self.model, self.data, self._posture(q), self._sorted(qd), self._sorted(tau))
        return np.asarray(found[self.order])

    def _posture(self, q: Array) -> Array:
        posture = pin.neutral(self.model)
        for joint, angle in zip(self.joints, q[len(q) - len(self.joints) :], strict=True):
            _put(posture, joint, angle)
        return np.asarray(posture)

    def _sorted(self, values: Array) -> Array:
        found = np.zeros(self.model.nv)
        found[self.order] = values
        return found


def _put(posture: Array, joint: pin.JointModel, value: float) -> None:
    at = joint.idx_q
    posture[at : at + joint.nq] = value if joint.nq == 1 else (math.cos(value), math.sin(value))
