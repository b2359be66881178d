"""Represent a chain as a KinematicTree of Exudyn, which flexlink builds from the exported URDF: Exudyn reads no files.

M, T_GC, springs, dampers and q̈ are computed by Exudyn. Springs and dampers are P and D gains of the tree's joints. A
second object on the same coordinates adds armatures through its mass matrix, and springs and dampers between joints
through its stiffness and damping matrices. The tip wrench is two loads on a marker. A user function adds the drive and
two terms that flexlink computes: the smooth Coulomb law c tanh(q̇/w) and the extra torque of rotation-vector springs.
Exudyn's Runge-Kutta methods call this function at every stage.

A floating base is represented by six joints of the tree, three prismatic and three revolute, as in flexlink.

Exudyn returns f = M q̈, the sum of all torques. Two more trees give the individual terms: a tree without springs and
dampers (f = −T_GC), and a tree without masses (f = −T_FL − d q̇).
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import exudyn as exu
import exudyn.itemInterface as items  # noqa: N813
import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.dynamics.floating_base import ANGLES
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines import base
from flexlink.engines.read_back import ReadBack, of_chain, to_matrices
from flexlink.formats import read_urdf, to_urdf
from flexlink.formats.document import loaded_tip, places
from flexlink_witnesses import refuse_sampled_inputs

METHODS = {"RK2": exu.DynamicSolverType.ExplicitMidpoint, "RK4": exu.DynamicSolverType.RK44}  # keys: flexlink's names
UserFunction = Callable[..., Array]


class ExudynEngine(base.OtherProgram):
    """A chain in Exudyn; `read` is the chain read from the exported file."""

    name, title = "exudyn", "Exudyn"
    version: str = exu.__version__

    def __init__(self, chain: Chain) -> None:
        self.read = read_urdf(to_urdf(chain, shapes=False))
        self.excess = base.excess_of(chain, lambda: self.read)
        self.n, hinges = self.read.n, self.read.hinges
        self.coulomb, self.coulomb_width = hinges["coulomb"], hinges["coulomb_width"]
        self._whole = _System(self.read)
        self._bodies = _System(_without(self.read, hinges=("stiffness", "damping")))
        self._springs = _System(_without(self.read, hinges=("armature",), bodies=("mass", "inertia")))

    def read_back(self) -> ReadBack:
        """Return the arm's properties as flexlink passes them to Exudyn."""
        return of_chain(self.read)

    def mass_matrix(self, q: Array) -> Array:
        """Return M(q) by Exudyn's composite-rigid-body algorithm."""
        return self._bodies.mass_matrix(q)

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return T_GC: minus the torques of the tree without springs."""
        return -self._bodies.torques(q, qd, tip_wrench)

    def elastic_torque(self, q: Array) -> Array:
        """Return T_FL: minus the torques of the massless tree with zero rates."""
        return self._beyond(q) - self._springs.torques(q, np.zeros(self.n))

    def friction_torque(self, qd: Array) -> Array:
        """Return T_FR: Coulomb friction minus the torques of the massless tree with relaxed springs."""
        return self._friction(qd) - self._springs.torques(self.read.rest, qd)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return q̈ from Exudyn's solver, as at the start of a run."""
        return self._whole.accelerations(q, qd, tau - self._friction(qd) - self._beyond(q), tip_wrench)

    def integrate(self, scene: Scene) -> base.Samples:
        """Run Exudyn's own Runge-Kutta method sample by sample."""
        largest_turn = 1.2  # largest angle of a floating base [rad]; the angle about Y is singular at 90°
        run = scene.run
        problem = base.fixed_steps_problem(scene, self.title)
        refuse_sampled_inputs(self.title, scene)
        base.refuse_method(self.title, run.method, METHODS)
        samples = t, q, qd = base.allocate_samples(problem)
        whole = self._whole
        whole.load(np.zeros(self.n), None)
        with whole.driven(self._torque_function(problem), base.wrench_function(problem)):
            for row in range(1, len(t)):
                begin = (row - 1) * run.steps_per_sample * run.fixed_step
                q[row], qd[row] = whole.advance(q[row - 1], qd[row - 1], begin, run)
                if not np.isfinite([q[row], qd[row]]).all():
                    raise base.divergence_error(self.name, problem, samples, row)
                if problem.base is not None and np.abs(q[row, ANGLES]).max() > largest_turn:
                    turned = f"the base has turned by more than {np.degrees(largest_turn):.0f}° at t = {t[row]:.6g} s"
                    why = f"{turned}, close to the singularity of Exudyn's three angles"
                    remedy = "use another engine or a shorter run"
                    raise ArgumentError(f"{scene.name}: {why}; {remedy}", id="base-turned-too-far")
        return samples

    def _torque_function(self, problem: InitialValueProblem) -> UserFunction | None:
        """Return a function for Exudyn: drive torques minus friction and drag torques; None if none of these acts."""
        drive, drag = base.drive_function(problem), base.drag_function(problem)
        if drive is None and drag is None and not self.coulomb.any() and self.excess is None:
            return None

        def torques(_mbs: object, t: float, _number: object, q: Sequence[float], qd: Sequence[float]) -> Array:
            angles, rates = np.array(q), np.array(qd)
            opposing = self._friction(rates) + self._beyond(angles)
            if drag is not None:
                opposing = opposing + drag(angles, rates)
            return -opposing if drive is None else drive(t, angles, rates) - opposing

        return torques


class _System:
    """A tree and its loads in an Exudyn system."""

    def __init__(self, chain: Chain) -> None:
        self.n = n = chain.n
        self._box = exu.SystemContainer()  # owns the system
        self.mbs = mbs = self._box.AddSystem()
        zero, self.slack = np.zeros(n), np.array(chain.rest)  # the node's coordinates are relative to `slack`
        node = mbs.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=self.slack, initialCoordinates=zero, initialCoordinates_t=zero,
                numberOfODE2Coordinates=n,
            )
        )  # fmt: skip
        self.tree = mbs.AddObject(_kinematic_tree(chain, node))
        matrices = to_matrices(chain.couplings, n).values() if len(chain.couplings) else ()
        between = dict(zip(("stiffnessMatrix", "dampingMatrix"), matrices, strict=False))
        rotors = np.diag(chain.hinges["armature"])
        mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=rotors, **between))
        tip = loaded_tip(chain)
        self.tip_rotation = np.array(tip.rotation)
        if tip.parent >= 0:
            place = {"linkNumber": tip.parent, "localPosition": tip.translation}
            marker = mbs.AddMarker(items.MarkerKinematicTreeRigid(objectNumber=self.tree, **place))
        else:  # the wrench acts on the fixed base
            marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
        self.force = mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=np.zeros(3)))
        self.moment = mbs.AddLoad(items.LoadTorqueVector(markerNumber=marker, loadVector=np.zeros(3)))
        mbs.Assemble()
        settings = _settings()
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False  # undefined for the massless tree
        self.solver = exu.MainSolverImplicitSecondOrder()
        self.solver.InitializeSolver(mbs, settings)

    def load(self, tau: Array, wrench: Array | None) -> None:
        """Set joint torques, and force and moment on the tip."""
        force, moment = np.split(np.zeros(6) if wrench is None else wrench, 2)
        self.mbs.SetObjectParameter(self.tree, "jointForceVector", tau)
        self.mbs.SetLoadParameter(self.force, "loadVector", force)
        self.mbs.SetLoadParameter(self.moment, "loadVector", moment)

    def mass_matrix(self, q: Array) -> Array:
        """Return M, shape (n, n)."""
        self._set_state(q, np.zeros(self.n), exu.ConfigurationType.Current)
        self.solver.ComputeMassMatrix(self.mbs)
        return np.array(self.solver.GetSystemMassMatrix())

    def torques(self, q: Array, qd: Array, wrench: Array | None = None) -> Array:
        """Return M q̈, shape (n,)."""
        self.load(np.zeros(self.n), wrench)
        self._set_state(q, qd, exu.ConfigurationType.Current)
        self.solver.ComputeODE2RHS(self.mbs)
        return np.array(self.solver.GetSystemResidual())

    def accelerations(self, q: Array, qd: Array, tau: Array, wrench: Array | None) -> Array:
        """Return q̈, shape (n,)."""
        self.load(tau, wrench)
        self._set_state(q, qd, exu.ConfigurationType.Initial)
        exu.MainSolverImplicitSecondOrder().InitializeSolver(self.mbs, _settings())
        return np.array(self.mbs.systemData.GetODE2Coordinates_tt())

    def advance(self, q: Array, qd: Array, begin: float, run: RunSettings) -> tuple[Array, Array]:
        """Return the state q, q̇ one sample later; these numbers are not finite if Exudyn stops."""
        self._set_state(q, qd, exu.ConfigurationType.Initial)
        settings = _settings()
        time = settings.timeIntegration
        time.startTime, time.endTime = begin, begin + run.steps_per_sample * run.fixed_step
        time.numberOfSteps = run.steps_per_sample
        self.mbs.SolveDynamic(settings, solverType=METHODS[run.method])
        data = self.mbs.systemData
        return data.GetODE2Coordinates() + self.slack, data.GetODE2Coordinates_t()

    @contextlib.contextmanager
    def driven(self, torques: UserFunction | None, wrench: base.TipWrench | None) -> Iterator[None]:
        """Make Exudyn evaluate drive torques and a tip wrench at every stage."""
        try:
            self._drive(torques, wrench)
            yield
        finally:
            self._drive(None, None)

    def _drive(self, torques: UserFunction | None, wrench: base.TipWrench | None) -> None:
        self.mbs.SetObjectParameter(self.tree, "forceUserFunction", torques or 0)
        for load, part in ((self.force, slice(3)), (self.moment, slice(3, 6))):
            self.mbs.SetLoadParameter(load, "loadVectorUserFunction", 0 if wrench is None else self._part(wrench, part))
            self.mbs.SetLoadParameter(load, "bodyFixed", wrench is not None and wrench.follows)

    def _part(self, wrench: base.TipWrench, part: slice) -> UserFunction:
        """Return a load function with Exudyn's signature; a wrench that follows the tip is in axes of the last link."""
        rotation = self.tip_rotation if wrench.follows else np.eye(3)
        return lambda _mbs, t, _vector: base.rotate_wrench(rotation, wrench(t))[part]

    def _set_state(self, q: Array, qd: Array, configuration: Any) -> None:
        self.mbs.systemData.SetODE2Coordinates(q - self.slack, configuration)
        self.mbs.systemData.SetODE2Coordinates_t(qd, configuration)


def _without(chain: Chain, *, hinges: Sequence[str] = (), bodies: Sequence[str] = ()) -> Chain:
    """Return the chain with the given fields of all hinges, couplings and bodies set to 0."""
    hinge, body, coupling = chain.hinges.copy(), chain.bodies.copy(), chain.couplings.copy()
    shared = [field for field in hinges if field in (coupling.dtype.names or ())]
    for array, fields in ((hinge, hinges), (coupling, shared), (body, bodies)):
        for field in fields:
            array[field] = 0.0
    return dataclasses.replace(chain, hinges=hinge, bodies=body, couplings=coupling)


def _kinematic_tree(chain: Chain, node: Any) -> Any:
    n, hinges, massless = chain.n, chain.hinges, np.zeros((), chain.bodies.dtype)
    placements = list(places(chain))
    bodies = [massless if place.body is None else place.body for place in placements]
    kind = exu.JointType
    kinds = (kind.RevoluteX, kind.RevoluteY, kind.RevoluteZ, kind.PrismaticX, kind.PrismaticY, kind.PrismaticZ)
    return items.ObjectKinematicTree(
        nodeNumber=node, gravity=chain.gravity, linkParents=np.array([place.parent for place in placements]),
        jointTypes=[kinds[axis] for axis in hinges["axis"]],
        jointTransformations=exu.Matrix3DList([place.rotation for place in placements]),
        jointOffsets=exu.Vector3DList([place.translation for place in placements]),
        linkMasses=[float(body["mass"]) for body in bodies],
        linkCOMs=exu.Vector3DList([body["center"] for body in bodies]),
        linkInertiasCOM=exu.Matrix3DList([body["inertia"] for body in bodies]), jointForceVector=np.zeros(n),
        jointPControlVector=hinges["stiffness"], jointPositionOffsetVector=hinges["rest"],
        jointDControlVector=hinges["damping"], jointVelocityOffsetVector=np.zeros(n),
    )  # fmt: skip


def _settings() -> Any:
    """Return settings: fixed steps, no files, LU by Eigen (Exudyn's own solver multiplies by M⁻¹; two digits less)."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.solution.file.write = settings.solution.sensors.active = False
    settings.timeIntegration.automaticStepSize = settings.timeIntegration.adaptiveStep = False
    return settings
