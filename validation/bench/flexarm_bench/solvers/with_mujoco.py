"""MuJoCo: hinges by its joints; motions by its own integrators, the implicit one if the links have damping."""

from __future__ import annotations

import math
from collections.abc import Iterable

import mujoco
import numpy as np

from flexarm_bench.case import Answer, Array, Cannot, Case, Settings
from flexarm_bench.solvers.hinges import Body, HingeChain, chain_of, hinges_of, solve, springs

OF_STABLE = 0.25  # of the largest stable step of RK4, 2.8 / ω of the fastest mode
STABLE = 2.8
FINER = 16  # the implicit method has order 1
LEAST = 1e-12  # mass and inertia of bodies without any: MuJoCo asks for a positive number


class Model:
    """The chain as a model of MuJoCo; its springs and dampers act in `mj_step` only."""

    def __init__(self, case: Case, chain: HingeChain, step: float = 1e-3, method: str = "RK4") -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(case, chain, step, method))
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.site = self.model.site("tip").id
        self.body = self.model.nbody - 1

    def mass(self, q: Array) -> Array:
        """Mass matrix."""
        self._set(q)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def bias(self, q: Array, v: Array) -> Array:
        """Torques of gravity and rates."""
        self._set(q, v)
        return np.array(self.data.qfrc_bias)

    def tip(self, q: Array) -> Array:
        """Place of the tip."""
        self._set(q)
        return np.array(self.data.site_xpos[self.site])

    def turn(self, q: Array) -> Array:
        """Rotation of the last body."""
        self._set(q)
        return np.array(self.data.xmat[self.body]).reshape(3, 3)

    def jacobian(self, q: Array) -> Array:
        """Jacobian of the tip."""
        self._set(q)
        J = np.zeros((6, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, J[:3], J[3:], self.site)
        return J

    def _set(self, q: Array, v: Array | None = None) -> None:
        v = np.zeros(self.model.nv) if v is None else v
        if not (np.array_equal(self.data.qpos, q) and np.array_equal(self.data.qvel, v)):
            self.data.qpos[:], self.data.qvel[:] = q, v
            mujoco.mj_fwdPosition(self.model, self.data)
            mujoco.mj_fwdVelocity(self.model, self.data)


def mjcf(case: Case, chain: HingeChain, step: float, method: str) -> str:
    """The chain as an MJCF file."""
    inner = f'<site name="tip" pos="{_row(chain.tip)}"/>'
    for body in reversed(chain.bodies):
        inner = f"<body {_pose(body)}>{_joints(body)}{_inertial(body)}{inner}</body>"
    return (
        f'<mujoco><compiler angle="radian" boundmass="{LEAST}" boundinertia="{LEAST}"/>'
        f'<option gravity="{_row(case.gravity)}" timestep="{step!r}" integrator="{method}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{inner}</worldbody></mujoco>"
    )


def _pose(body: Body) -> str:
    half = body.angle / 2
    return f'pos="{_row(body.place)}" quat="{math.cos(half)!r} 0 0 {math.sin(half)!r}"'


def _joints(body: Body) -> str:
    return "".join(
        f'<joint type="hinge" axis="{_row(each.axis)}" stiffness="{each.stiffness!r}" damping="{each.damping!r}" '
        f'armature="{each.armature!r}"/>'
        for each in body.joints
    )


def _inertial(body: Body) -> str:
    I = body.central_inertia
    if not body.mass or not body.joints:
        return f'<inertial pos="0 0 0" mass="{LEAST}" diaginertia="{LEAST} {LEAST} {LEAST}"/>'
    bare = max(I.trace() * 1e-9, LEAST)  # a slender rod has no inertia about its axis
    full = [I[0, 0] + bare, I[1, 1] + bare, I[2, 2] + bare, I[0, 1], I[0, 2], I[1, 2]]
    return f'<inertial pos="{_row(body.centre)}" mass="{body.mass!r}" fullinertia="{_row(full)}"/>'


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def run(case: Case, settings: Settings) -> Answer:
    """Compute a case; settings: `hinges` of a link, `of_stable`, the step in parts of the largest stable one."""
    if case.motion:
        raise Cannot("it prescribes no joint angle")
    hinges = hinges_of(case, settings)
    chain = chain_of(case, hinges)
    model = Model(case, chain)
    note = f"{hinges} hinges a link"
    if case.ask != "motion":
        return Answer(solve(case, chain, model), note)
    interval = case.times[1] - case.times[0]
    M = model.mass(np.zeros(len(chain.joints)))
    fastest = math.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(M, np.diag(springs(chain))))).max())
    steps = math.ceil(interval * fastest / STABLE / float(settings.get("of_stable", OF_STABLE)))
    damped = any(link.loss_time for link in case.links)
    method, steps = ("implicitfast", FINER * steps) if damped else ("RK4", steps)
    return Answer(_motion(case, chain, method, interval / steps, steps), f"{note}, {method}, {steps} steps a sample")


def _motion(case: Case, chain: HingeChain, method: str, step: float, steps: int) -> Array:
    model = Model(case, chain, step, method)
    data, found = model.data, []
    mujoco.mj_forward(model.model, data)
    for k in range(len(case.times)):
        for i in range(steps if k else 0):
            if case.torque:
                data.qfrc_applied[0] = case.torque.torque(((k - 1) * steps + i + 0.5) * step)
            mujoco.mj_step(model.model, data)
        mujoco.mj_kinematics(model.model, data)
        found.append(np.array(data.site_xpos[model.site][:2]))
    return np.array(found)
