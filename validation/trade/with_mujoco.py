"""MuJoCo's integrators on the exported MJCF at fixed steps, without Python.

What the file does not contain is added in the way that is fastest in MuJoCo: PD gains as MuJoCo's springs and dampers,
which its implicit integrators treat implicitly; a constant drive as an applied force; dry friction and a table of
torques by a compiled callback, without the interpreter.
"""

from __future__ import annotations

import contextlib
import ctypes
import time
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

import flexlink as fl
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.engines.mujoco import MujocoEngine, quiet
from flexlink.formats.mjcf import to_mjcf
from flexlink.kernels.inputs.laws import PD, TABLE
from flexlink.kernels.inputs.record import Drive
from flexlink.motion.inputs.drives import drive_arrays
from flexlink.motion.inputs.initial_state import initial_state
from validation.trade.contestants import stepped
from validation.trade.work_precision import Point, Run

INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
}
EVALUATIONS_OF_A_STEP = {"RK4": 4}  # all other integrators take one
ORDER = {"Euler": 1.0, "implicit": 1.0, "implicitfast": 1.0, "discrete": 1.0, "RK4": 4.0}
TIME_WITHIN, TIME_BLOCK = 1 << 19, 512  # bytes of mjData that are searched for its time, and bytes per block


def points(name: str, scene: Scene, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators with finer and finer steps; RK4 starts at flexlink's stability limit."""
    return stepped(name, Mujoco(scene), INTEGRATORS, budget, smallest)


def loading(chain: fl.Chain) -> Callable[[], object]:
    """A call that reads and compiles a chain's MJCF and creates its data."""
    text = to_mjcf(chain, shapes=False)
    return lambda: mujoco.MjData(mujoco.MjModel.from_xml_string(text))


class Mujoco:
    """One scene in MuJoCo, loaded once, with any integrator and step.

    Raises
    ------
    ArgumentError
        MuJoCo cannot represent the scene, for example a prescribed motion.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.chain = scene, fl.lump(scene)
        engine = MujocoEngine(self.chain)
        self.model, self.data, self.tip = engine.model, engine.data, engine.tip
        self.start = initial_state(scene, self.chain)
        drive, table, self.constant = drive_arrays(scene, self.chain), None, np.zeros(self.chain.n)
        moves = drive.law == PD and len(drive.reference.knots) > 1
        if drive.law not in {TABLE, PD} or drive.rate or moves or np.isfinite(drive.effort).any():
            raise ArgumentError(
                f"drive.kind = {scene.drive.kind!r}: MuJoCo supports only torques over time and PD gains"
            )
        if drive.law == PD:
            self._add_gains(drive)
        elif len(drive.feedforward.knots) > 1:
            table = drive
        else:
            self.constant[drive.joints] = drive.feedforward.coefficients[0, 0]
        self.callback = None
        if engine.coulomb.any() or table is not None:
            self.callback = _callback(self.model, self.data, engine.coulomb, engine.coulomb_width, table)

    def _add_gains(self, drive: Drive) -> None:
        """T = kp (target − q) − kd q̇ + g is a spring with a rest angle, a damper and a constant torque."""
        k = drive.joints
        self.constant[k] = drive.feedforward.coefficients[0, 0]
        if drive.kp.any() or drive.kd.any():
            self.model.jnt_stiffness[k] = drive.kp
            self.model.qpos_spring[k] = drive.reference.coefficients[0, 0]
            self.model.dof_damping[k] += drive.kd

    def run(self, integrator: str, steps: float) -> Run:
        """Run with `steps` steps between samples, to the end or a failure; only `mj_step` is timed."""
        run, data, steps = self.scene.run, self.data, round(steps)
        q = np.full((run.samples, self.chain.n), np.nan)
        q[0], seconds = self.start[0], 0.0
        with self._prepared(integrator, run.spacing / steps):
            for row in range(1, run.samples):
                seconds += _seconds_of(self.model, data, steps)
                if data.warning.number.any() or not np.isfinite([data.qpos, data.qvel]).all():
                    break
                q[row] = data.qpos
        return Run(q, seconds, EVALUATIONS_OF_A_STEP.get(integrator, 1) * (run.samples - 1) * steps)

    def seconds_a_step(self, integrator: str, steps_per_sample: int) -> float:
        """CPU seconds per step, from the first steps of a run."""
        steps = min(steps_per_sample, 5000)  # long enough for the resolution of the clock
        with self._prepared(integrator, self.scene.run.spacing / steps_per_sample):
            return _seconds_of(self.model, self.data, steps) / steps

    @contextlib.contextmanager
    def _prepared(self, integrator: str, step: float) -> Iterator[None]:
        """Set up the initial state of a run."""
        model, data = self.model, self.data
        model.opt.integrator, model.opt.timestep = INTEGRATORS[integrator], step
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = self.start
        data.qfrc_applied[:], data.xfrc_applied[self.tip] = self.constant, self.scene.tip_wrench
        with quiet(), _passive(self.callback):
            yield


def _seconds_of(model: Any, data: Any, steps: int) -> float:
    begun = time.thread_time()
    mujoco.mj_step(model, data, steps)
    return time.thread_time() - begun


@contextlib.contextmanager
def _passive(callback: Any) -> Iterator[None]:
    """Set MuJoCo's callback for passive forces to machine code, which runs without the interpreter and its lock."""
    mujoco.set_mjcb_passive(callback)
    try:
        yield
    finally:
        mujoco.set_mjcb_passive(None)


def _callback(model: Any, data: Any, coulomb: Array, width: Array, table: Drive | None) -> Any:
    """Compile the callback qfrc_passive += table(t) − c tanh(q̇/w), with friction torque c and width w as constants."""
    forces, rates = data.qfrc_passive.ctypes.data, data.qvel.ctypes.data
    n, offset = len(coulomb), _offset_of_time(model, data)
    rubbing = np.flatnonzero(coulomb)
    c, w = coulomb[rubbing], width[rubbing]
    knots, coefficients, joints = (
        (np.zeros(1), np.zeros((1, 1, 0)), np.zeros(0, np.int64))
        if table is None
        else (*table.feedforward, table.joints)
    )

    @numba.cfunc(types.void(types.voidptr, types.uintp))
    def passive(_model, mjdata):  # type: ignore[no-untyped-def]
        force = numba.carray(_pointer(forces), n)
        rate = numba.carray(_pointer(rates), n)
        t = numba.carray(_pointer(mjdata + offset), 1)[0]
        for i in range(len(rubbing)):
            force[rubbing[i]] -= c[i] * np.tanh(rate[rubbing[i]] / w[i])
        piece = max(0, np.searchsorted(knots, t, side="right") - 1)
        x = max(0.0, t - knots[piece])
        for d in range(len(joints)):
            torque = 0.0
            for j in range(coefficients.shape[1] - 1, -1, -1):
                torque = torque * x + coefficients[piece, j, d]
            force[joints[d]] += torque

    pointer = passive.ctypes
    pointer.code = passive  # must live as long as the pointer
    return pointer


@intrinsic  # type: ignore[untyped-decorator]
def _pointer(_context: Any, address: Any) -> Any:
    """Convert an address to a pointer to float64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(address), generate


def _offset_of_time(model: Any, data: Any) -> int:
    """Offset of the time in mjData [bytes], found by setting the time twice."""
    seen: list[int] = []
    look = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda _, mjdata: seen.append(mjdata))
    with _passive(look), quiet():
        mujoco.mj_forward(model, data)
    marks = 0.123456789, 0.987654321
    for start in range(0, TIME_WITHIN, TIME_BLOCK):
        words = np.ctypeslib.as_array((ctypes.c_double * (TIME_BLOCK // 8)).from_address(seen[0] + start))
        found = set(range(len(words)))
        for mark in marks:
            data.time = mark
            found &= set(np.flatnonzero(words == mark).tolist())
        if found:
            data.time = 0.0
            return start + 8 * int(found.pop())
    raise FlexlinkError("MuJoCo's mjData: its time was not found in the searched bytes")
