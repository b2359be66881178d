"""Load the exported SDF into Drake, in a child process, because some files make Drake abort (`engines.child_process`).

M, T_GC, springs, dampers, rotors and q̈ are computed by Drake. Drake ignores gravity and dry friction in the file and
has no springs between joints. The adapter sets gravity. A `LeafSystem` outputs the drive and the terms that flexlink
computes: the smooth Coulomb law c tanh(q̇/w), springs and dampers between joints, and rotation-vector springs. Drake's
integrators evaluate the system at every stage. Its second output is the tip wrench, an external force on the last link.

A floating base is Drake's floating base with a quaternion, whose coordinates are converted (`coordinates`). An arm with
a floating base runs in flexlink's coordinates: the scene's Runge-Kutta method integrates Drake's accelerations.
"""

import importlib.metadata
import re
from collections.abc import Mapping, Sequence
from typing import Any, Self
from xml.etree import ElementTree as ET

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody import tree
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from flexlink.chain.arguments import vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines import base
from flexlink.engines import read_back as records
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates, Floating
from flexlink.engines.read_back import COUPLED_FIELDS, ReadBack
from flexlink.formats.document import loaded_tip, tips
from flexlink.formats.sdf import read_sdf, sdf_names, to_sdf
from flexlink_witnesses import refuse_sampled_inputs

OWN = "{urn:flexlink}"


class DrakeEngine(base.OtherProgram):
    """A chain in Drake: its `plant` and `context`, with the numbers of flexlink's custom elements as in `ReadBack`."""

    name, title = "drake", "Drake"
    version: str = importlib.metadata.version("drake")

    def __init__(self, chain: Chain) -> None:
        try:
            exported = to_sdf(chain, shapes=False)
            names = sdf_names(chain)[1:]
            frame = [tip.link for tip in tips(chain)].index(loaded_tip(chain).link)
            self._parse(exported, names[: chain.n], names[2 * chain.n + frame])
        except RuntimeError as error:
            reason = " ".join(str(error).split())  # on one line
            raise base.cannot_load("Drake", repr(chain.name), f"{reason}; use another engine") from error
        self.excess = base.excess_of(chain, lambda: read_sdf(exported))

    @classmethod
    def from_file(cls, file: base.ForeignFile) -> Self:
        """Load a foreign SDF file."""
        engine, text = cls.__new__(cls), file.path.read_text(encoding="utf-8")
        base.refuse_in_files(cls.title, file.path)
        try:
            engine._parse(text, reference=file.base)
        except (RuntimeError, ValueError) as error:
            raise base.cannot_load("Drake", "the file", error) from error
        return engine

    def _parse(self, text: str, names: Sequence[str] = (), tip: str = "", reference: Array | None = None) -> None:
        """Load a document with joints in the order of `names`, by default in Drake's order."""
        floating = Floating(velocity_in_base=False, spin_in_base=False, turn_first=True, scalar_first=True)
        self.text, root = text, ET.fromstring(text)
        width, model = f"{OWN}coulomb_width", root.find(".//model")
        gravity = root.findtext("world/gravity")
        self.gravity = None if gravity is None else vector("gravity", [float(x) for x in gravity.split()], 3)
        self.plant = self._load(MultibodyPlant(time_step=0.0))
        degrees = degrees_of_freedom(self.plant)
        self.names = tuple(names or degrees)
        nothing, by_name = ET.Element("joint"), {joint.get("name"): joint for joint in root.iter("joint")}
        elements = [nothing if name in BASE_JOINTS else by_name[name] for name in self.names]
        self.coulomb = np.array([float(element.findtext("axis/dynamics/friction", "0")) for element in elements])
        self.coulomb_width = np.array([float(element.get(width, "1")) for element in elements])
        own = any(width in element.attrib for element in elements)
        specified = {"coulomb_width": own, "gravity": gravity is not None} | dict.fromkeys(COUPLED_FIELDS, own)
        self.unspecified = frozenset(name for name, there in specified.items() if not there)
        self.n, self.context = self.plant.num_velocities(), self.plant.CreateDefaultContext()
        floats, rotation = BASE_JOINTS[0] in degrees, "" if model is None else model.get(f"{OWN}base", "")
        if reference is None:
            reference = np.reshape([float(x) for x in rotation.split()], (3, 3)) if rotation else np.eye(3)
        order = np.array([degrees[name] for name in self.names])
        self.coordinates = Coordinates(order, reference if floats else None, floating)
        self.couplings = records.of_elements(root.iter(f"{OWN}coupling"), self.names)
        self.rest = self.read_back().rest
        frames = root.findall(".//model/frame")
        last = moving_joints(self.plant)[-1].frame_on_child()
        self.tip = self.plant.GetFrameByName(tip or frames[-1].attrib["name"]) if frames else last

    def read_back(self) -> ReadBack:
        """Return the arm's properties as Drake has read them."""
        own = {"coulomb": self.coulomb, "coulomb_width": self.coulomb_width}
        own |= records.to_matrices(self.couplings, self.n)
        return read(self.plant, self.context, self.coordinates, self.names, own, self.unspecified)

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify, gravity in a new plant."""
        super().fill_missing(fields)
        if "gravity" in fields:
            self.plant = self._load(MultibodyPlant(time_step=0.0))
            self.context = self.plant.CreateDefaultContext()

    def mass_matrix(self, q: Array) -> Array:
        """Return M(q) by the composite-rigid-body algorithm (`CalcMassMatrix`)."""
        self._place(q, np.zeros(self.n))
        return self.coordinates.our_matrix(q, self.plant.CalcMassMatrix(self.context))

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return T_GC: `CalcBiasTerm` minus gravity and Jᵀ F."""
        self._place(q, qd)
        plant, context = self.plant, self.context
        torque = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        if tip_wrench is not None:
            world = plant.world_frame()
            J = plant.CalcJacobianSpatialVelocity(
                context, tree.JacobianWrtVariable.kV, self.tip, np.zeros(3), world, world
            )  # angular part first
            torque -= J[3:].T @ tip_wrench[:3] + J[:3].T @ tip_wrench[3:]
        if (drift := self.coordinates.drift(q, qd)) is not None:
            torque += plant.CalcMassMatrix(context) @ drift
        return self.coordinates.our_torques(q, torque)

    def gravity_torque(self, q: Array) -> Array:
        """Return T_G: `CalcGravityGeneralizedForces` with the opposite sign."""
        self._place(q, np.zeros(self.n))
        return -self.coordinates.our_torques(q, self.plant.CalcGravityGeneralizedForces(self.context))

    def elastic_torque(self, q: Array) -> Array:
        """Return T_FL: minus the forces of Drake's force elements at zero rates, plus springs between joints."""
        torque = -self._joint_forces(q, np.zeros(self.n))
        return np.asarray(torque + self._between("stiffness", q - self.rest) + self._beyond(q))

    def friction_torque(self, qd: Array) -> Array:
        """Return T_FR: minus the forces of Drake's dampers, plus the friction and dampers that the adapter adds."""
        return self.added_torque(self.rest, qd) - self._joint_forces(self.rest, qd)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return q̈ from the articulated-body algorithm (`get_generalized_acceleration_output_port`)."""
        self._place(q, qd)
        plant, context, theirs = self.plant, self.context, self.coordinates
        torque = theirs.torques(q, tau - self.added_torque(q, qd))
        plant.get_applied_generalized_force_input_port().FixValue(context, torque)
        force = self.tip_force(np.zeros(6) if tip_wrench is None else tip_wrench)
        plant.get_applied_spatial_force_input_port().FixValue(context, [force])
        return theirs.our_accelerations(q, qd, plant.get_generalized_acceleration_output_port().Eval(context))

    def integrate(self, scene: Scene) -> base.Samples:
        """Run `Simulator.AdvanceTo` with Drake's own Runge-Kutta method at fixed steps."""
        run, order = scene.run, self.coordinates.order
        problem = base.fixed_steps_problem(scene, self.title)
        if self.coordinates.reference is not None or scene.arm.has_drag:
            return self.run_in_steps(problem)
        refuse_sampled_inputs(self.title, scene)
        methods = {"RK3": "runge_kutta3", "DOPRI5": "runge_kutta5"}  # flexlink's names → Drake's names
        base.refuse_method(self.title, run.method, methods)
        samples = t, q, qd = base.allocate_samples(problem)
        simulator, plant = self._simulator(problem)
        state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        inverse = np.argsort(order)
        plant.SetPositionsAndVelocities(state, np.concatenate([q[0][inverse], qd[0][inverse]]))
        ResetIntegratorFromFlags(simulator, methods[run.method], run.fixed_step).set_fixed_step_mode(True)
        simulator.Initialize()
        for row in range(1, len(t)):
            try:
                simulator.AdvanceTo(t[row])
            except RuntimeError as error:
                if re.search("NaN|hinge inertia", str(error)):  # Drake's errors for a state that is not finite
                    raise base.divergence_error(self.name, problem, samples, row) from error
                raise
            q[row], qd[row] = plant.GetPositions(state)[order], plant.GetVelocities(state)[order]
            if not np.isfinite([q[row], qd[row]]).all():
                raise base.divergence_error(self.name, problem, samples, row)
        return samples

    def _load(self, plant: MultibodyPlant) -> MultibodyPlant:
        Parser(plant).AddModelsFromString(self.text, "sdf")
        if self.gravity is not None:
            plant.mutable_gravity_field().set_gravity_vector(self.gravity)
        plant.Finalize()
        return plant

    def _simulator(self, problem: InitialValueProblem) -> tuple[Simulator, MultibodyPlant]:
        """Return a simulator with drive, tip wrench and Coulomb friction, and its plant."""
        builder = DiagramBuilder()
        plant = self._load(builder.AddSystem(MultibodyPlant(time_step=0.0)))
        drive, wrench = base.drive_function(problem), base.wrench_function(problem)
        inputs = builder.AddSystem(_Inputs(self, drive, wrench))
        builder.Connect(plant.get_state_output_port(), inputs.state)
        if drive is not None or self.coulomb.any() or len(self.couplings) or self.excess is not None:
            builder.Connect(inputs.torque, plant.get_applied_generalized_force_input_port())
        if wrench is not None:
            builder.Connect(inputs.force, plant.get_applied_spatial_force_input_port())
        return Simulator(builder.Build()), plant

    def _place(self, q: Array, qd: Array) -> None:
        theirs = self.coordinates
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([theirs.position(q), theirs.rates(q, qd)]))

    def _joint_forces(self, q: Array, qd: Array) -> Array:
        """Return the generalized forces of springs and dampers, shape (n,)."""
        self._place(q, qd)
        forces = tree.MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return self.coordinates.our_torques(q, forces.generalized_forces())

    def tip_force(self, wrench: Array) -> ExternallyAppliedSpatialForce:
        """Return force and moment on the tip in axes of frame 0."""
        force = ExternallyAppliedSpatialForce()
        force.body_index = self.tip.body().index()
        force.p_BoBq_B = self.tip.GetFixedPoseInBodyFrame().translation()
        f, m = np.split(wrench, 2)
        force.F_Bq_W = SpatialForce(m, f)
        return force

    def tip_rotation(self, q: Array) -> Array:
        """Return the rotation from the tip frame into frame 0."""
        self._place(q, np.zeros(self.n))
        return np.array(self.tip.CalcPoseInWorld(self.context).rotation().matrix())

    def added_torque(self, q: Array, qd: Array) -> Array:
        """Torques that Drake does not compute, with the file's constants: friction, couplings, rotation springs."""
        torque = self._friction(qd) + self._between("stiffness", q - self.rest)
        return np.asarray(torque + self._between("damping", qd) + self._beyond(q))


class _Inputs(LeafSystem):  # type: ignore[misc]  # pydrake is not type-checked
    """System that outputs the drive minus the torques that Drake does not compute, and the force on the tip."""

    def __init__(self, engine: DrakeEngine, drive: base.DriveTorque | None, wrench: base.TipWrench | None) -> None:
        super().__init__()
        self._engine, self._drive, self._wrench = engine, drive, wrench
        self.state = self.DeclareVectorInputPort("state", 2 * engine.n)
        self.torque = self.DeclareVectorOutputPort("torque", engine.n, self._write_torque)
        forces = Value[list[ExternallyAppliedSpatialForce]]
        self.force = self.DeclareAbstractOutputPort("forces", forces, self._write_force)

    def _write_torque(self, context: Context, output: BasicVector) -> None:
        order = self._engine.coordinates.order
        q, qd = (part[order] for part in np.split(self.state.Eval(context), 2))
        torque = -self._engine.added_torque(q, qd)
        if self._drive is not None:
            torque += self._drive(context.get_time(), q, qd)
        output.SetFromVector(self._engine.coordinates.torques(q, torque))

    def _write_force(self, context: Context, output: Any) -> None:
        wrench, engine = np.zeros(6), self._engine
        if self._wrench is not None:
            wrench = self._wrench(context.get_time())
            if self._wrench.follows:
                q = self.state.Eval(context)[: engine.n][engine.coordinates.order]
                wrench = base.rotate_wrench(engine.tip_rotation(q), wrench)
        output.set_value([engine.tip_force(wrench)])


# Read the record (`ReadBack`) of a finalized Drake plant.


ONE_AXIS = (tree.RevoluteJoint, tree.PrismaticJoint)


def moving_joints(plant: Any) -> list[Any]:
    """Return the joints that can move, in Drake's order."""
    known = (*ONE_AXIS, tree.QuaternionFloatingJoint)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    moving = sorted((joint for joint in joints if joint.num_velocities()), key=lambda joint: joint.velocity_start())
    records.require_joints([(joint.name(), "" if isinstance(joint, known) else joint.type_name()) for joint in moving])
    return moving


def degrees_of_freedom(plant: Any) -> dict[str, int]:
    """Map joint names to Drake's numbers; a floating base has six, rotation first, under flexlink's names."""
    found = dict[str, int]()
    for joint in moving_joints(plant):
        floats = isinstance(joint, tree.QuaternionFloatingJoint)
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
    slides = np.array([isinstance(joint, tree.PrismaticJoint) for joint in joints])
    floats = theirs.reference is not None
    axes = np.array([turned @ _axis(joint) for turned, joint in zip(R, joints, strict=True)])
    if floats:  # flexlink's three slides and three rotations, in Drake's order
        slides[3:6], axes[:3], axes[3:6] = True, R[0].T, np.eye(3)
    behind = _behind(plant, joints)
    springs = _springs(plant)
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    limits = {actuator.joint().name(): actuator.effort_limit() for actuator in actuators}
    rotors = {actuator.joint().name(): actuator.default_reflected_inertia() for actuator in actuators}
    most = np.array([limits.get(joint.name(), np.inf) for joint in joints])
    driven = np.array([float(joint.name() in limits) for joint in joints])  # an actuator's input is the joint torque
    constants = np.array([springs.get(joint.name(), (0.0, 0.0)) for joint in joints], float)
    fields: dict[str, Any] = {name: np.zeros_like(given) for name, given in own.items()}
    fields |= {"stiffness": constants[:, 0], "rest": constants[:, 1]}
    fields["damping"] = np.array([j.default_damping() if isinstance(j, ONE_AXIS) else 0.0 for j in joints], float)
    fields["armature"] = np.array([rotors.get(joint.name(), 0.0) for joint in joints], float)
    before = np.array([behind[int(joint.parent_body().index())] for joint in joints])
    first = np.array([k == 0 or joint is not joints[k - 1] for k, joint in enumerate(joints)])
    parents = np.where(first, before, np.arange(n) - 1)
    if floats:  # in flexlink the rotations of a base follow its slides
        parents[3:6], parents[:3] = [-1, 3, 4], [5, 0, 1]
    fields |= _bodies(plant, context, behind, points)
    tip = plant.GetFrameByName("tip").CalcPoseInWorld(context).translation() if plant.HasFrameNamed("tip") else None
    record = ReadBack(
        names=("",) * n, parents=parents, axes=axes, points=points, frames=R, slides=slides,
        **records.no_actuators(n) | {"gear": driven, "effort": np.stack([-most, most], axis=1)}, **fields,
        gravity=np.array(plant.gravity_field().gravity_vector()), unspecified=unspecified,
        tip=None if tip is None else np.array(tip), bodies=tuple(joint.child_body().name() for joint in joints),
    )  # fmt: skip
    return record.in_order(theirs.order, names=tuple(names), **own)


def _axis(joint: Any) -> Array:
    """Return the axis in the joint's frame; zero for a floating base."""
    if isinstance(joint, tree.RevoluteJoint):
        return np.asarray(joint.revolute_axis())
    return np.asarray(joint.translation_axis()) if isinstance(joint, tree.PrismaticJoint) else np.zeros(3)


def _behind(plant: Any, joints: list[Any]) -> Indices:
    """Return the last degree of freedom that moves each body: −1 if it is fixed, the last rotation if it floats."""
    carrier = {int(joint.child_body().index()): k for k, joint in enumerate(joints)}
    floats = (joint for joint in joints if isinstance(joint, tree.QuaternionFloatingJoint))
    carrier |= {int(joint.child_body().index()): 2 for joint in floats}
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
    bodies = [plant.get_body(tree.BodyIndex(k)) for k in range(plant.num_bodies())]
    masses, centers, inertias = np.zeros(len(bodies)), np.zeros((len(bodies), 3)), np.zeros((len(bodies), 3, 3))
    for k, body in enumerate(bodies[1:], 1):  # the first is the world
        X, M = plant.EvalBodyPoseInWorld(context, body), body.default_spatial_inertia()
        R, c = X.rotation().matrix(), M.get_com()
        masses[k], centers[k] = M.get_mass(), X.translation() + R @ c
        inertias[k] = R @ M.Shift(c).CalcRotationalInertia().CopyToFullMatrix3() @ R.T
    return records.merge_bodies(behind, masses, centers, inertias, points)


def _springs(plant: Any) -> dict[str, tuple[float, float]]:
    """Return stiffness and rest position of the springs, by the names of their joints."""
    found = dict[str, tuple[float, float]]()
    for spring in (plant.get_force_element(tree.ForceElementIndex(k)) for k in range(plant.num_force_elements())):
        if isinstance(spring, tree.RevoluteSpring):
            found[spring.joint().name()] = spring.default_stiffness(), spring.default_nominal_angle()
        elif isinstance(spring, tree.PrismaticSpring):
            found[spring.joint().name()] = spring.stiffness(), spring.nominal_position()
    return found
