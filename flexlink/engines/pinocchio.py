"""Pinocchio, from the exported URDF.

Pinocchio has no springs, and its `aba` ignores damping and dry friction: −T_FL − T_FR, computed by us, join the joint
torques, those of springs and dampers between joints, and of springs of rotation vectors, included. The armature is in
its M, its recursive Newton-Euler and its `aba` alike, but not in URDF, so it is read from our element.

Joints whose motion is prescribed, p, leave the rows of the others, f, to be solved (Featherstone 2008, section 9.2):

    M_ff q̈_f = (T_EX − T_FL − T_FR − T_GC)_f − M_fp q̈_p
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Self
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from flexlink.chain.arguments import vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines import couplings, pinocchio_reader
from flexlink.engines.base import (
    ForeignFile,
    Samples,
    TipWrench,
    allocate_samples,
    divergence_error,
    drive_function,
    fixed_steps_problem,
    wrench_function,
)
from flexlink.engines.read_back import ReadBack
from flexlink.engines.rotation_springs import Excess, excess_of, refuse_in_files
from flexlink.formats.document import xml_joint_names
from flexlink.formats.urdf import LIMIT, to_urdf
from flexlink.formats.urdf_reading import read_urdf
from flexlink.kernels.inputs.drive_torque import follow

NOT_IN_URDF = ("stiffness", "rest", "coulomb_width", "armature")  # attributes of our own elements


class PinocchioEngine:
    """A chain in Pinocchio.

    Attributes
    ----------
    model, data
        Pinocchio's own, gravity and armature set.
    tip
        Index of the tip's frame.
    stiffness, rest, damping, coulomb, coulomb_width, gear
        As read from the file, shape (n,).
    couplings
        Springs and dampers between joints, of dtype `COUPLING`, as read from our own elements.
    unspecified
        Fields of `ReadBack` that the file does not specify.
    prescribed
        Joints with a prescribed motion, which is not in the file.
    """

    name = "pinocchio"
    version: str = pin.__version__
    _excess: Excess | None = None

    def __init__(self, chain: Chain) -> None:
        exported = to_urdf(chain, shapes=False)
        self._parse(exported)
        self._excess = excess_of(chain, exported, read_urdf)
        if list(self.model.names[1:]) != xml_joint_names(chain):
            order = ", ".join(self.model.names[1:])
            raise ArgumentError(
                f"Pinocchio orders the joints of {chain.name!r} as {order}; expected the order of the file"
            )
        self.prescribed = np.flatnonzero(chain.hinges["prescribed"])

    @classmethod
    def from_file(cls, file: ForeignFile) -> Self:
        """Load a foreign URDF file; continuous joints become revolute joints with wide limits.

        Raises
        ------
        ArgumentError
            Pinocchio refuses the file, or it has other joints than hinges.
        """
        refuse_in_files("Pinocchio", file.path)
        robot = ET.parse(file.path).getroot()
        for joint in robot.findall("joint[@type='continuous']"):
            joint.set("type", "revolute")
            ET.SubElement(joint, "limit", LIMIT)
        engine = cls.__new__(cls)
        try:
            engine._parse(ET.tostring(robot, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise ArgumentError(f"Pinocchio cannot load the file: {error}") from error
        engine.prescribed = np.zeros(0, dtype=np.intp)
        return engine

    def _parse(self, text: str) -> None:
        robot = ET.fromstring(text)
        self.model = model = pin.buildModelFromXML(text)
        pinocchio_reader.require_hinges_of(model)
        if model.nv > 600:  # pinocchio.Data holds four arrays of n³ numbers, for second derivatives: 7 GB
            raise ArgumentError(
                f"{model.nv} joints: Pinocchio's data would take {32e-9 * model.nv**3:.0f} GB; at most 600 joints are "
                "supported; use another engine or fewer segments"
            )
        self.data, self.n = pin.Data(model), model.nv  # createData copies it
        own = {joint.get("name"): joint.find("flexlink") for joint in robot.findall("joint")}
        elements = [own.get(name) for name in model.names[1:]]
        self.stiffness, self.rest, self.coulomb_width, armature = (_own(elements, key) for key in NOT_IN_URDF)
        self.damping, self.coulomb = np.array(model.damping), np.array(model.friction)
        self.gear = pinocchio_reader.transmissions(robot, model.names[1:])
        gravity = robot.find("flexlink")
        self.couplings = couplings.of_elements(robot.findall("flexlink/coupling"), model.names[1:])
        plain = all(element is None for element in elements)
        self.unspecified = frozenset((*NOT_IN_URDF, *couplings.COUPLED_FIELDS) if plain else ())
        if gravity is None:
            self.unspecified |= {"gravity"}
        else:
            model.gravity.linear = vector("gravity", [float(x) for x in gravity.get("gravity", "").split()], 3)
        model.armature = armature
        self.tip = model.getFrameId(robot.findall("link")[-1].attrib["name"], pin.FrameType.BODY)

    def read_back(self) -> ReadBack:
        """The arm as Pinocchio has read it, with springs of our own elements and the transmissions of the file."""
        own = {name: getattr(self, name) for name in ("stiffness", "rest", "coulomb_width", "gear")}
        return pinocchio_reader.read(self.model, own | couplings.to_matrices(self.couplings, self.n), self.unspecified)

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set fields of `ReadBack` that the file does not specify."""
        for field, values in fields.items():
            if field == "gravity":
                self.model.gravity.linear = values
            elif field == "armature":
                self.model.armature = values
            elif field not in couplings.COUPLED_FIELDS:
                setattr(self, field, np.array(values))
        if couplings.COUPLED_FIELDS.keys() <= fields.keys():
            self.couplings = couplings.of_matrices(fields)

    def neutralize_settings(self) -> None:
        """Nothing to do: Pinocchio has no such settings."""

    def mass_matrix(self, q: Array) -> Array:
        """M(q) by composite rigid bodies (`crba`)."""
        return np.array(pin.crba(self.model, self.data, q))

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC by `nle`, less Jᵀ F."""
        return np.array(pin.nle(self.model, self.data, q, qd) - self._wrench_torque(q, tip_wrench))

    def gravity_torque(self, q: Array) -> Array:
        """T_G by `computeGeneralizedGravity`."""
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))

    def elastic_torque(self, q: Array) -> Array:
        """T_FL, from the springs in the file."""
        torque: Array = self.stiffness * (q - self.rest)
        if len(self.couplings):
            torque += couplings.torque(self.couplings, "stiffness", q - self.rest)
        if self._excess is not None:
            torque += self._excess(q)
        return torque

    def friction_torque(self, qd: Array) -> Array:
        """T_FR, from the damping and dry friction in the file."""
        torque: Array = self.damping * qd
        if len(self.couplings):
            torque += couplings.torque(self.couplings, "damping", qd)
        if self.coulomb.any():
            torque += self.coulomb * np.tanh(qd / self.coulomb_width)
        return torque

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈ by the articulated-body algorithm (`aba`); a joint whose motion is prescribed keeps its rate."""
        return self._accelerations(q, qd, tau, tip_wrench, np.zeros(self.n))

    def integrate(self, scene: Scene) -> Samples:
        """The scene's Runge-Kutta method, as a plain loop over `aba`."""
        problem = fixed_steps_problem(scene)
        samples = t, q, qd = allocate_samples(problem)
        run, step = problem.run, self._step_function(problem)
        first_step = round(problem.start / run.fixed_step)
        y = np.concatenate([q[0], qd[0]])
        with np.errstate(all="ignore"):  # divergence raises an error below
            for row in range(1, len(t)):
                for number in range((row - 1) * run.steps_per_sample, row * run.steps_per_sample):
                    y = step(first_step + number, y)
                if not np.isfinite(y).all():
                    raise divergence_error(self.name, problem, samples, row)
                q[row], qd[row] = y[: self.n], y[self.n :]
        return samples

    def _step_function(self, problem: InitialValueProblem) -> Callable[[int, Array], Array]:
        """A function that returns the state (q, q̇) at (number + 1) h from the one at number · h."""
        n, h, wrench = self.n, problem.run.fixed_step, wrench_function(problem)
        A, b, c = method(problem.run.method).arrays
        drive, motion = drive_function(problem), problem.inputs.motion
        F, no_torque, prescribed = np.empty((len(c), 2 * n)), np.zeros(n), np.zeros(n)

        def step(number: int, y: Array) -> Array:
            for function in (drive, wrench):
                if function is not None:
                    function.begin(number, h, y[:n], y[n:])
            for i in range(len(c)):
                t, x = (number + c[i]) * h, y + h * A[i, :i] @ F[:i]
                follow(motion, t, x[:n], x[n:], prescribed)
                torque = no_torque if drive is None else drive(t, x[:n], x[n:])
                F[i, :n] = x[n:]
                F[i, n:] = self._accelerations(
                    x[:n], x[n:], torque + self._tip_torque(wrench, t, x[:n]), None, prescribed
                )
            y = y + h * b @ F
            follow(motion, (number + 1) * h, y[:n], y[n:], prescribed)
            return y

        return step

    def _tip_torque(self, wrench: TipWrench | None, t: float, q: Array) -> Array:
        """Jᵀ F of the scene's wrench at time t."""
        return np.zeros(self.n) if wrench is None else self._wrench_torque(q, wrench(t), follows=wrench.follows)

    def _accelerations(self, q: Array, qd: Array, tau: Array, tip_wrench: Array | None, prescribed: Array) -> Array:
        """q̈, for prescribed joints as in `prescribed`."""
        total = tau - self.elastic_torque(q) - self.friction_torque(qd) + self._wrench_torque(q, tip_wrench)
        p = self.prescribed
        if len(p) == 0:
            return np.array(pin.aba(self.model, self.data, q, qd, total))
        f, M = np.setdiff1d(np.arange(self.n), p), self.mass_matrix(q)
        qdd, rhs = prescribed.copy(), total - self.bias_torque(q, qd) - M[:, p] @ prescribed[p]
        qdd[f] = np.linalg.solve(M[np.ix_(f, f)], rhs[f])
        return qdd

    def _wrench_torque(self, q: Array, wrench: Array | None, *, follows: bool = False) -> Array:
        """Jᵀ F with the Jacobian of the tip's origin in axes of frame 0 or of the tip, linear part first."""
        if wrench is None:
            return np.zeros(self.n)
        frame = pin.ReferenceFrame.LOCAL if follows else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.array(pin.computeFrameJacobian(self.model, self.data, q, self.tip, frame).T @ wrench)


def _own(elements: Sequence[ET.Element | None], key: str) -> Array:
    """An attribute of our own elements, joint by joint; 0 where there is none."""
    return np.array([0.0 if element is None else float(element.get(key, 0)) for element in elements])
