"""Pinocchio: hinges by its joints; motions by SciPy's integrators on its M and torques."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from flexarm_bench.case import Answer, Array, Case, Settings
from flexarm_bench.solvers.hinges import HingeChain, chain_of, hinges_of, solve, springs

TOLERANCE = 1e-6


class Model:
    """The chain as a model of Pinocchio."""

    def __init__(self, case: Case, chain: HingeChain) -> None:
        self.model = pin.Model()
        self.model.gravity.linear = np.array(case.gravity)
        parent, offset = 0, pin.SE3.Identity()
        for body in chain.bodies:
            offset = offset * pin.SE3(pin.utils.rotate("z", body.angle), body.place)
            for joint in body.joints:
                kind = pin.JointModelRevoluteUnaligned(np.array(joint.axis))
                parent = self.model.addJoint(parent, kind, offset, f"joint{self.model.njoints}")
                offset = pin.SE3.Identity()
            if body.mass and parent:
                inertia = pin.Inertia(body.mass, body.centre, body.central_inertia)
                self.model.appendBodyToJoint(parent, inertia, offset)
        frame = pin.Frame("tip", parent, offset * pin.SE3(np.eye(3), chain.tip), pin.FrameType.OP_FRAME)
        self.end = self.model.addFrame(frame)
        self.model.armature = np.array([joint.armature for joint in chain.joints])
        self.data = self.model.createData()

    def mass(self, q: Array) -> Array:
        """Mass matrix."""
        upper = np.triu(pin.crba(self.model, self.data, q))
        return np.array(upper + np.triu(upper, 1).T)

    def bias(self, q: Array, v: Array) -> Array:
        """Torques of gravity and rates."""
        return np.array(pin.nonLinearEffects(self.model, self.data, q, v))

    def tip(self, q: Array) -> Array:
        """Place of the tip."""
        return np.array(self._frame(q).translation)

    def turn(self, q: Array) -> Array:
        """Rotation of the last body."""
        return np.array(self._frame(q).rotation)

    def jacobian(self, q: Array) -> Array:
        """Jacobian of the tip."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.array(pin.computeFrameJacobian(self.model, self.data, q, self.end, axes))

    def _frame(self, q: Array) -> pin.SE3:
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.end]


def run(case: Case, settings: Settings) -> Answer:
    """Compute a case; settings: `hinges` of a link, relative `tolerance` of a motion."""
    hinges = hinges_of(case, settings)
    chain = chain_of(case, hinges)
    model = Model(case, chain)
    note = f"{hinges} hinges a link"
    if case.ask != "motion":
        return Answer(solve(case, chain, model), note)
    tolerance = float(settings.get("tolerance", TOLERANCE))
    method = "DOP853" if len(case.links) > 1 else "Radau"  # links that fall together vibrate: no use of large steps
    return Answer(_motion(case, chain, model, method, tolerance), f"{note}, {method}, tolerance {tolerance:g}")


def _motion(case: Case, chain: HingeChain, model: Model, method: str, tolerance: float) -> Array:
    k, d, n = springs(chain), np.array([joint.damping for joint in chain.joints]), len(chain.joints)
    free, held = chain.free, list(chain.held)
    block = np.ix_(free, free)

    def complete(t: float, y: Array) -> tuple[Array, Array, Array]:
        q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
        q[free], v[free] = y[: len(free)], y[len(free) :]
        if case.motion:
            q[held], v[held], a[held] = case.motion.motion(t)
        return q, v, a

    def rate(t: float, y: Array) -> Array:
        q, v, a = complete(t, y)
        torque = -k * q - d * v - model.bias(q, v)
        if case.torque:
            torque[0] += case.torque.torque(t)
        M = model.mass(q)
        a[free] = np.linalg.solve(M[block], (torque - M @ a)[free])
        return np.concatenate([v[free], a[free]])

    def slope(t: float, y: Array) -> Array:
        q, v, a = complete(t, y)
        a[free] = rate(t, y)[len(free) :]
        by_q, by_v, _ = pin.computeRNEADerivatives(model.model, model.data, q, v, a)
        by_q, by_v = (by_q + np.diag(k))[block], (by_v + np.diag(d))[block]
        lower = -np.linalg.solve(model.mass(q)[block], np.hstack([by_q, by_v]))
        return np.vstack([np.hstack([np.zeros_like(by_q), np.eye(len(free))]), lower])

    run = solve_ivp(
        rate, (0.0, case.times[-1]), np.zeros(2 * len(free)), method=method, t_eval=case.times,
        rtol=tolerance, atol=tolerance * 1e-2, **({"jac": slope} if method == "Radau" else {}),
    )  # fmt: skip
    return np.array([model.tip(complete(t, y)[0])[:2] for t, y in zip(run.t, run.y.T, strict=True)])
