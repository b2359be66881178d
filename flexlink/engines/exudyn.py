"""Exudyn, as a KinematicTree. Exudyn reads no file: the tree is built from the numbers of the exported URDF.

M, T_GC, springs, dampers and q̈ are Exudyn's own: springs and dampers are the tree's P and D control, an armature is
the mass of a second object on the same coordinates, the tip wrench two loads on a marker. The smooth Coulomb law
c tanh(q̇/w) and the drive come from a user function, so that every stage of its Runge-Kutta methods sees them.

What Exudyn gives is the sum f of all torques that M q̈ is. Its terms are those of two more trees: one without springs
and dampers (f = −T_GC), one without masses (f = −T_FL − d q̇).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadForceVector,
    LoadTorqueVector,
    MarkerKinematicTreeRigid,
    NodeGenericODE2,
    ObjectGenericODE2,
    ObjectKinematicTree,
)

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.describe.situation import Run
from flexlink.engines.base import Array, Samples, diverged, drive_function, refuse_held, refuse_motion, start
from flexlink.engines.tree import Tree, read_tree
from flexlink.formats import to_urdf

JOINTS = {
    (1.0, 0.0, 0.0): exu.JointType.RevoluteX,
    (0.0, 1.0, 0.0): exu.JointType.RevoluteY,
    (0.0, 0.0, 1.0): exu.JointType.RevoluteZ,
}
METHODS = {"RK2": exu.DynamicSolverType.ExplicitMidpoint, "RK4": exu.DynamicSolverType.RK44}
"""The methods of ours that Exudyn has, too."""
TorqueFunction = Callable[..., Array]
CURRENT, INITIAL = exu.ConfigurationType.Current, exu.ConfigurationType.Initial
NO_VECTOR = np.zeros(3)


class ExudynEngine:
    """A chain in Exudyn.

    Attributes
    ----------
    tree
        The arrays that the exported file holds.
    """

    name = "exudyn"
    version: str = exu.__version__

    def __init__(self, chain: Chain) -> None:
        refuse_motion("Exudyn", chain)
        self.tree = tree = read_tree(to_urdf(chain, shapes=False))
        self.n, none = tree.n, np.zeros(tree.n)
        self._whole = _System(tree)
        self._bodies = _System(tree._replace(stiffness=none, damping=none))
        self._springs = _System(tree._replace(masses=none, inertias=0 * tree.inertias, armature=none))

    def mass_matrix(self, q: Array) -> Array:
        """M(q) by Exudyn's composite rigid bodies."""
        return self._bodies.mass_matrix(q)

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC: the torques of the tree without springs, negative."""
        return -self._bodies.torques(q, qd, tip_wrench)

    def gravity_torque(self, q: Array) -> Array:
        """T_G: the same at rest."""
        return self.bias_torque(q, np.zeros(self.n))

    def elastic_torque(self, q: Array) -> Array:
        """T_FL: the torques of the tree without masses at rest, negative."""
        return -self._springs.torques(q, np.zeros(self.n))

    def friction_torque(self, qd: Array) -> Array:
        """T_FR: those with slack springs, negative, and the Coulomb law with the file's numbers."""
        return self._coulomb(qd) - self._springs.torques(self.tree.rest, qd)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈ by Exudyn's solver, as it finds them at the start of a run."""
        return self._whole.accelerations(q, qd, tau - self._coulomb(qd), tip_wrench)

    def integrate(self, scene: Scene) -> Samples:
        """Exudyn's own Runge-Kutta method, sample by sample."""
        run = scene.run
        refuse_motion("Exudyn", lump(scene))
        refuse_held("Exudyn", scene)
        if run.method not in METHODS:
            known = " and ".join(map(repr, METHODS))
            raise ArgumentError(f"method = {run.method!r}: of flexlink's explicit methods Exudyn has only {known}")
        samples = t, q, qd = start(scene)
        whole = self._whole
        whole.load(np.zeros(self.n), scene.tip_wrench)
        with whole.driven(self._torque_function(scene)):
            for row in range(1, len(t)):
                began = (row - 1) * run.steps_per_sample * run.step
                q[row], qd[row] = whole.advance(q[row - 1], qd[row - 1], began, run)
                if not np.isfinite([q[row], qd[row]]).all():
                    raise diverged(self.name, scene, samples, row)
        return samples

    def _coulomb(self, qd: Array) -> Array:
        torque: Array = self.tree.coulomb * np.tanh(qd / self.tree.coulomb_width)
        return torque

    def _torque_function(self, scene: Scene) -> TorqueFunction | None:
        """Drive less Coulomb friction as Exudyn asks for it, or None if neither pushes."""
        drive = drive_function(scene)
        if drive is None and not self.tree.coulomb.any():
            return None

        def torques(_mbs: object, t: float, _number: object, q: Sequence[float], qd: Sequence[float]) -> Array:
            rates = np.array(qd)
            return -self._coulomb(rates) if drive is None else drive(t, np.array(q), rates) - self._coulomb(rates)

        return torques


class _System:
    """One tree with its loads in a system of Exudyn's."""

    def __init__(self, tree: Tree) -> None:
        self.n = n = tree.n
        self._box = exu.SystemContainer()  # owns the system
        self.mbs = mbs = self._box.AddSystem()
        zero = np.zeros(n)
        node = mbs.AddNode(
            NodeGenericODE2(
                referenceCoordinates=zero, initialCoordinates=zero, initialCoordinates_t=zero, numberOfODE2Coordinates=n
            )
        )
        self.tree = mbs.AddObject(_kinematic_tree(tree, node))
        mbs.AddObject(ObjectGenericODE2(nodeNumbers=[node], massMatrix=np.diag(tree.armature)))
        tip = MarkerKinematicTreeRigid(objectNumber=self.tree, linkNumber=n - 1, localPosition=tree.tip)
        marker = mbs.AddMarker(tip)
        self.force = mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=NO_VECTOR))
        self.moment = mbs.AddLoad(LoadTorqueVector(markerNumber=marker, loadVector=NO_VECTOR))
        mbs.Assemble()
        settings = _settings()
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False  # of no masses there are none
        self.solver = exu.MainSolverImplicitSecondOrder()
        self.solver.InitializeSolver(mbs, settings)

    def load(self, tau: Array, wrench: Array | None) -> None:
        """Torques of the joints, force and moment on the tip."""
        force, moment = (NO_VECTOR, NO_VECTOR) if wrench is None else np.split(wrench, 2)
        self.mbs.SetObjectParameter(self.tree, "jointForceVector", tau)
        self.mbs.SetLoadParameter(self.force, "loadVector", force)
        self.mbs.SetLoadParameter(self.moment, "loadVector", moment)

    def mass_matrix(self, q: Array) -> Array:
        """M, shape (n, n)."""
        self._place(q, np.zeros(self.n), CURRENT)
        self.solver.ComputeMassMatrix(self.mbs)
        return np.array(self.solver.GetSystemMassMatrix())

    def torques(self, q: Array, qd: Array, wrench: Array | None = None) -> Array:
        """M q̈, shape (n,)."""
        self.load(np.zeros(self.n), wrench)
        self._place(q, qd, CURRENT)
        self.solver.ComputeODE2RHS(self.mbs)
        return np.array(self.solver.GetSystemResidual())

    def accelerations(self, q: Array, qd: Array, tau: Array, wrench: Array | None) -> Array:
        """q̈, shape (n,)."""
        self.load(tau, wrench)
        self._place(q, qd, INITIAL)
        exu.MainSolverImplicitSecondOrder().InitializeSolver(self.mbs, _settings())
        return np.array(self.mbs.systemData.GetODE2Coordinates_tt())

    def advance(self, q: Array, qd: Array, began: float, run: Run) -> tuple[Array, Array]:
        """The state one sample later; not finite if Exudyn gives up."""
        self._place(q, qd, INITIAL)
        settings = _settings()
        time = settings.timeIntegration
        time.startTime, time.endTime = began, began + run.steps_per_sample * run.step
        time.numberOfSteps = run.steps_per_sample
        self.mbs.SolveDynamic(settings, solverType=METHODS[run.method])
        data = self.mbs.systemData
        return data.GetODE2Coordinates(), data.GetODE2Coordinates_t()

    @contextlib.contextmanager
    def driven(self, torques: TorqueFunction | None) -> Iterator[None]:
        """With torques that Exudyn asks for at every stage."""
        try:
            self.mbs.SetObjectParameter(self.tree, "forceUserFunction", torques or 0)
            yield
        finally:
            self.mbs.SetObjectParameter(self.tree, "forceUserFunction", 0)

    def _place(self, q: Array, qd: Array, configuration: Any) -> None:
        self.mbs.systemData.SetODE2Coordinates(q, configuration)
        self.mbs.systemData.SetODE2Coordinates_t(qd, configuration)


def _kinematic_tree(tree: Tree, node: Any) -> Any:
    n = tree.n
    return ObjectKinematicTree(
        nodeNumber=node, gravity=tree.gravity, linkParents=np.arange(-1, n - 1),
        jointTypes=[JOINTS[tuple(axis.tolist())] for axis in tree.axes],
        jointTransformations=exu.Matrix3DList(list(tree.rotations)), jointOffsets=exu.Vector3DList(list(tree.offsets)),
        linkMasses=tree.masses, linkCOMs=exu.Vector3DList(list(tree.centers)),
        linkInertiasCOM=exu.Matrix3DList(list(tree.inertias)), jointForceVector=np.zeros(n),
        jointPControlVector=tree.stiffness, jointPositionOffsetVector=tree.rest,
        jointDControlVector=tree.damping, jointVelocityOffsetVector=np.zeros(n),
    )  # fmt: skip


def _settings() -> Any:
    """Fixed steps, no files; Eigen's LU, because Exudyn's own multiplies by M⁻¹, which costs two digits of q̈."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.solution.file.write = settings.solution.sensors.active = False
    settings.timeIntegration.automaticStepSize = settings.timeIntegration.adaptiveStep = False
    return settings
