"""Load the exported MJCF into MuJoCo.

MuJoCo computes springs and dampers in `qfrc_passive`; between joints, they are fixed tendons. One callback adds
the smooth Coulomb law c tanh(q̇/w) and the extra torque of rotation-vector springs, which flexlink computes. A second
callback adds the drive and a variable tip wrench. MuJoCo's RK4 calls both at every stage. The tip wrench is an external
force on the massless tip body, whose centre of mass is its origin; MuJoCo also applies it at every stage.

MuJoCo numbers joints depth first, and a floating base is its `freejoint`; `coordinates` converts both. An arm with a
floating base runs in flexlink's coordinates: the scene's Runge-Kutta method integrates MuJoCo's accelerations.
"""

import contextlib
import dataclasses
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Self

import mujoco
import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.tie import refuse_ties
from flexlink.engines import base, mujoco_reader, mujoco_tendons
from flexlink.engines.read_back import COUPLED_FIELDS, ReadBack
from flexlink.formats import to_mjcf
from flexlink.formats.document import loaded_tip, xml_joint_names
from flexlink.kernels.layout import COUPLING

Callback = Callable[[Any, Any], None] | None
_callback_lock = threading.Lock()  # MuJoCo has one set of callbacks per process


class MujocoEngine(base.OtherProgram):
    """A chain in MuJoCo; `couplings` are taken from the scene if a foreign file cannot specify them."""

    name, title = "mujoco", "MuJoCo"
    version: str = mujoco.__version__

    def __init__(self, chain: Chain, ties: Scene | None = None) -> None:
        lacking = [] if ties is None else [tie for tie in ties.ties if tie.times or tie.dissipation]
        refuse_ties(lacking, "MJCF has no lengths that move and no dissipation")
        self.has_ties, step = ties is not None, None if ties is None else ties.run.fixed_step
        try:
            with quiet():
                model = mujoco.MjModel.from_xml_string(to_mjcf(chain, shapes=False, timestep=step, ties=ties))
        except ValueError as error:
            raise base.cannot_load("MuJoCo", repr(chain.name), f"{error}; use another engine") from error
        self._use(model, mujoco_reader.read(model), xml_joint_names(chain), loaded_tip(chain).name)
        self.excess = base.excess_of(chain, lambda: self._with_springs(chain))

    def _with_springs(self, chain: Chain) -> Chain:
        """Return the chain with the spring constants that MuJoCo has read."""
        hinges, couplings = chain.hinges.copy(), chain.couplings.copy()
        hinges["stiffness"], hinges["rest"] = self.record.stiffness, self.record.rest
        couplings["stiffness"] = self.record.coupled_stiffness[couplings["inner"], couplings["outer"]]
        return dataclasses.replace(chain, hinges=hinges, couplings=couplings)

    @classmethod
    def from_file(cls, file: base.ForeignFile) -> Self:
        """Load a foreign MJCF or URDF file and the files that it includes."""
        base.refuse_in_files(cls.title, file.path)
        try:
            with quiet(), warnings.catch_warnings(action="ignore"):  # ignore deprecated attributes
                spec = mujoco.MjSpec.from_file(str(file.path))
                model = spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            raise base.cannot_load("MuJoCo", "the file", error) from error
        engine = cls.__new__(cls)
        record = mujoco_reader.read(model, spec, file.base)
        if file.format == "urdf":
            lacks = {"gravity", "stiffness", "rest", "armature", "coulomb_width", "autoreset", *COUPLED_FIELDS}
            record = dataclasses.replace(record, unspecified=frozenset(lacks), integrator="", step=None)
        engine._use(model, record, reference=file.base)
        # of a foreign file only torques and accelerations are computed; actuators and steps are compared in the record
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        return engine

    def _use(
        self, model: Any, record: ReadBack, names: Sequence[str] = (), tip: str = "", reference: Array | None = None
    ) -> None:
        """Store a model and its record with joints in the order of `names`, by default in the model's order."""
        self.model, self.data, self.n = model, mujoco.MjData(model), model.nv
        order = np.array([record.names.index(name) for name in names or record.names], dtype=np.intp)
        self.record = record = record.in_order(order)
        self.coordinates = mujoco_reader.coordinates(model, order, reference)
        self.tip = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, tip) if tip else model.nbody - 1
        self.rest, self.coulomb, self.coulomb_width = record.rest, record.coulomb.copy(), record.coulomb_width.copy()
        self.couplings = np.zeros(0, COUPLING)

    def read_back(self) -> ReadBack:
        """Return the arm's properties as MuJoCo has read them."""
        return self.record

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify, most of them in the model."""
        super().fill_missing(fields)
        mujoco_reader.fill(self.model, self.coordinates, fields)

    def neutralize_settings(self) -> None:
        """Disable everything that acts in addition to gravity, springs and dampers."""
        mujoco_tendons.disable_others(self.model)  # first, because it checks for active limits and friction
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model.opt.density = self.model.opt.viscosity = 0
        self.model.body_gravcomp[:] = 0

    def mass_matrix(self, q: Array) -> Array:
        """Return M(q) by the composite-rigid-body algorithm (`mj_makeM`, `mj_fullM`)."""
        self._place(q, np.zeros(self.n))
        return self.coordinates.our_matrix(q, self._mass_matrix())

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return T_GC: `qfrc_bias` minus the joint torques of the wrench from `mj_applyFT`."""
        self._place(q, qd)
        torque, origin = np.zeros(self.n), self.data.xpos[self.tip]
        if tip_wrench is not None:
            force, moment = np.split(tip_wrench, 2)
            mujoco.mj_applyFT(self.model, self.data, force, moment, origin, self.tip, torque)
        torque = self.data.qfrc_bias - torque
        drift = self.coordinates.drift(q, qd)
        return self.coordinates.our_torques(q, torque if drift is None else torque + self._mass_matrix() @ drift)

    def elastic_torque(self, q: Array) -> Array:
        """Return T_FL: minus `qfrc_spring`, plus the extra torque of rotation-vector springs."""
        self._place(q, np.zeros(self.n))
        between = self._between("stiffness", q - self.rest) + self._beyond(q)
        return np.array(between - self.coordinates.our_torques(q, self.data.qfrc_spring))

    def friction_torque(self, qd: Array) -> Array:
        """Return T_FR: minus `qfrc_damper`, plus the Coulomb law with the file's constants."""
        q = np.zeros(self.n)
        self._place(q, qd)
        damping = self.coordinates.our_torques(q, self.data.qfrc_damper)
        return np.array(self._friction(qd) + self._between("damping", qd) - damping)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return q̈ from `mj_forward`."""
        data, theirs = self.data, self.coordinates
        data.qpos[:], data.qvel[:] = theirs.position(q), theirs.rates(q, qd)
        between = self._between("stiffness", q - self.rest) + self._between("damping", qd)
        data.qfrc_applied[:] = theirs.torques(q, tau - self._friction(qd) - between - self._beyond(q))
        data.xfrc_applied[self.tip] = 0.0 if tip_wrench is None else tip_wrench
        with quiet():
            mujoco.mj_forward(self.model, data)
        return theirs.our_accelerations(q, qd, data.qacc)

    def integrate(self, scene: Scene) -> base.Samples:
        """Run MuJoCo's RK4 (`mj_step`); with a floating base or drag, the scene's method calls `mj_forward` instead."""
        run, model, alone = scene.run, self.model, self.coordinates.reference is None and not scene.arm.has_drag
        if alone:
            base.refuse_method(self.title, run.method, ["RK4"])
        problem = base.fixed_steps_problem(scene, self.title, tied=self.has_ties)
        if not alone:
            return self.run_in_steps(problem)
        samples = t, q, qd = base.allocate_samples(problem)
        data, order = self.data, self.coordinates.order
        mujoco.mj_resetData(model, data)
        model.opt.timestep = run.fixed_step
        data.qpos[order], data.qvel[order], data.time = q[0], qd[0], scene.initial.time
        drive, wrench = base.drive_function(problem), base.wrench_function(problem)
        first_step = round(scene.initial.time / run.fixed_step)
        if wrench is not None and wrench.constant and not wrench.follows:
            data.xfrc_applied[self.tip], wrench = wrench(0.0), None
        callbacks = {"mjcb_passive": self._passive_callback(), "mjcb_control": self._control_callback(drive, wrench)}
        inputs = [function for function in (drive, wrench) if function is not None]
        with _installed(callbacks | {"mju_user_warning": _ignore}):
            for row in range(1, len(t)):
                if not inputs:
                    mujoco.mj_step(model, data, run.steps_per_sample)
                else:
                    for number in range((row - 1) * run.steps_per_sample, row * run.steps_per_sample):
                        for function in inputs:
                            function.begin(first_step + number, run.fixed_step, data.qpos[order], data.qvel[order])
                        mujoco.mj_step(model, data)
                restarted = abs(data.time - t[row]) > run.fixed_step / 2
                finite = np.isfinite([data.qpos, data.qvel]).all()  # MuJoCo's warnings refer to the previous step
                if restarted or data.warning.number.any() or not finite:
                    raise base.divergence_error(self.name, problem, samples, row)
                q[row], qd[row] = data.qpos[order], data.qvel[order]
        return samples

    def tip_rotation(self, q: Array) -> Array:
        """Return the rotation from the tip frame into frame 0."""
        self._place(q, np.zeros(self.n))
        return np.array(self.data.xmat[self.tip].reshape(3, 3))

    def _mass_matrix(self) -> Array:
        """Return M in MuJoCo's coordinates at the state set by `_place`."""
        M = np.zeros((self.n, self.n))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def _place(self, q: Array, qd: Array) -> None:
        """Compute everything that depends on position and rate: frames, M, bias and passive torques."""
        theirs = self.coordinates
        self.data.qpos[:], self.data.qvel[:] = theirs.position(q), theirs.rates(q, qd)
        with quiet():
            mujoco.mj_fwdPosition(self.model, self.data)
            mujoco.mj_fwdVelocity(self.model, self.data)

    def _passive_callback(self) -> Callback:
        if not self.coulomb.any() and self.excess is None:
            return None

        order = self.coordinates.order

        def passive(_: Any, data: Any) -> None:
            data.qfrc_passive[order] -= self._friction(data.qvel[order]) + self._beyond(data.qpos[order])

        return passive

    def _control_callback(self, drive: base.DriveTorque | None, wrench: base.TipWrench | None) -> Callback:
        """Return a callback for drive and wrench; MuJoCo calls it at every stage, after its kinematics."""
        if drive is None and wrench is None:
            return None

        order = self.coordinates.order

        def control(_: Any, data: Any) -> None:
            if drive is not None:
                data.qfrc_applied[order] = drive(data.time, data.qpos[order], data.qvel[order])
            if wrench is not None:
                now, rotation = wrench(data.time), data.xmat[self.tip].reshape(3, 3)
                data.xfrc_applied[self.tip] = base.rotate_wrench(rotation, now) if wrench.follows else now

        return control


def _ignore(_: str) -> None:
    """Ignore MuJoCo's warnings, which would go to a file in the current folder; divergence raises an error."""


def quiet() -> contextlib.AbstractContextManager[None]:
    """Keep MuJoCo from writing a warnings file, for example about an ill-conditioned M."""
    return _installed({"mju_user_warning": _ignore})


@contextlib.contextmanager
def _installed(hooks: Mapping[str, Callable[..., None] | None]) -> Iterator[None]:
    """Install MuJoCo callbacks, one thread at a time, and restore the previous ones at the end."""
    with _callback_lock:
        old = {name: getattr(mujoco, f"get_{name}")() for name in hooks}
        try:
            for name, function in hooks.items():
                getattr(mujoco, f"set_{name}")(function)
            yield
        finally:
            for name, function in old.items():
                getattr(mujoco, f"set_{name}")(function)
