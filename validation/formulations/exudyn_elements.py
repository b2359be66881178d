"""Exudyn's finite elements: in a plane, geometrically exact beams of three nodes and ANCF cables; beams in space.

Those in space are geometrically exact, of two nodes, for clamped arms.

Only the solver's call is timed. Beams that are too stiff to stretch or shear noticeably have EA = GA = s EI / L²; the
ladder chooses s, as a large one needs more steps and a small one stretches.
"""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    CoordinateConstraint,
    LoadCoordinate,
    LoadMassProportional,
    LoadTorqueVector,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    MarkerNodeRigid,
    NodePoint2DSlope1,
    NodePointGround,
    NodeRigidBody2D,
    NodeRigidBodyRotVecLG,
    ObjectANCFCable2D,
    ObjectBeamGeometricallyExact,
    ObjectBeamGeometricallyExact2D,
    ObjectGround,
    ObjectJointGeneric,
    ObjectJointRevolute2D,
    ObjectMassPoint2D,
    ObjectRigidBody2D,
    SensorNode,
)
from scipy.spatial.transform import Rotation

from flexlink.common.types import Array
from validation.formulations.task import Outcome, Rod, Setting, Task

CABLE, BEAM, IN_SPACE = "ANCFCable2D", "GeometricallyExact2D", "GeometricallyExact"
SPARSE_FROM = 40  # coordinates from which the sparse solver is cheaper
ROUNDING = 2e-12  # residual at which Newton's method ends, relative to EA: well above rounding errors of axial forces
NEGLIGIBLE = 1e-9  # mass of a rotor, relative to the rod's


def run(task: Task, element: str, setting: Setting) -> Outcome:
    """Build the arm, and run Exudyn's solver once."""
    if element == IN_SPACE:
        return _run_in_space(task, setting)
    arm = _Arm(task, element, setting)
    return solved(arm.mbs, task, setting, arm.sensor, task.axes)


def solved(mbs: Any, task: Task, setting: Setting, sensor: Any, axes: Array) -> Outcome:
    """Run Exudyn's solver once on an assembled system; `axes`, in columns, are those of the system in frame 0."""
    size = mbs.systemData.ODE2Size()
    settings = settings_of(task, setting, size)
    begun = time.thread_time()
    if task.moment:
        good = mbs.SolveStatic(settings)
    else:
        good = mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    seconds = time.thread_time() - begun
    stored = np.atleast_2d(mbs.GetSensorStoredData(sensor))[:, 1:4] if good else np.empty((0, 3))
    rows = stored[-1:] if task.moment else stored
    return Outcome(np.asarray(rows @ axes.T), seconds, size)


def settings_of(task: Task, setting: Setting, size: int) -> Any:
    """Settings of the solvers for a system with `size` coordinates."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.verboseMode = settings.staticSolver.verboseMode = 0
    sparse = size > SPARSE_FROM
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse if sparse else exu.LinearSolverType.EXUdense
    if task.moment:
        settings.staticSolver.numberOfLoadSteps = round(setting["load steps"])
        return settings
    run, over = task.scene.run, settings.timeIntegration
    settings.solution.sensors.writePeriod = run.spacing
    over.endTime, over.numberOfSteps = run.duration, round(run.duration / setting["step"])
    over.generalizedAlpha.spectralRadius = setting.get("radius", 0.9)
    over.newton.useModifiedNewton = True
    rod = task.rods[0]
    stiff = setting.get("stiffness", 0.0) * rod.bending[1] / rod.length**2
    over.newton.absoluteTolerance = max(over.newton.absoluteTolerance, ROUNDING * stiff)
    return settings


def fix(mbs: Any, node: Any, coordinate: int, motion: Any = None) -> None:
    """Fix a coordinate of a node, or let it move as prescribed."""
    still = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    moved = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
    constraint = CoordinateConstraint(markerNumbers=[still, moved])
    if motion is not None:
        constraint.offsetUserFunction = lambda _mbs, t, _item, _offset: motion(t)[0]
        constraint.offsetUserFunction_t = lambda _mbs, t, _item, _offset: motion(t)[1]
    mbs.AddObject(constraint)


class _Arm:
    """The arm as a system of elements, with a sensor at the tip."""

    def __init__(self, task: Task, element: str, setting: Setting) -> None:
        self.task, self.element = task, element
        self.count, self.stiff = round(setting["elements"]), setting["stiffness"]
        self.reduced = round(setting.get("reduced", 0))
        self.box = exu.SystemContainer()
        self.mbs = self.box.AddSystem()
        self.ground = self.mbs.AddObject(ObjectGround())
        place, held = np.zeros(2), self.mbs.AddMarker(MarkerBodyPosition(bodyNumber=self.ground))
        for k, rod in enumerate(task.rods):
            nodes, bodies, place = self._rod(rod, place)
            if k == 0:
                self._hold(nodes[0], bodies[0], held)
            else:
                begin = self.mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[0]))
                self.mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[held, begin]))
            held = self.mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1]))
        self._end(nodes[-1], bodies[-1])
        position = exu.OutputVariableType.Position
        self.sensor = self.mbs.AddSensor(
            SensorNode(nodeNumber=nodes[-1], storeInternal=True, outputVariableType=position)
        )
        self.mbs.Assemble()

    def _rod(self, rod: Rod, begin: Array) -> tuple[list[Any], list[Any], Array]:
        """Add a rod; return its nodes, its elements and its end."""
        along = self.task.axes.T @ rod.turn[:, 0]
        end = begin + rod.length * along[:2]
        make = self._cables if self.element == CABLE else self._beams
        nodes, bodies = make(rod, begin, end)
        for body in bodies:
            marker = self.mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
            load = [*(self.task.axes.T @ self.task.gravity)[:2], 0.0]
            if np.any(load):
                self.mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=load))
        return nodes, bodies, end

    def _beams(self, rod: Rod, begin: Array, end: Array) -> tuple[list[Any], list[Any]]:
        angle = float(np.arctan2(*(end - begin)[::-1]))
        places = np.linspace(begin, end, 2 * self.count + 1)
        nodes = [self.mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[*place, angle])) for place in places]
        stiff = self.stiff * rod.bending[1] / rod.length**2
        bodies = [
            self.mbs.AddObject(ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[i : i + 3], length=rod.length / self.count, massPerLength=rod.mass,
                crossSectionInertia=rod.rotary[2], bendingStiffness=rod.bending[1], axialStiffness=stiff,
                shearStiffness=stiff, includeReferenceRotations=True,
            ))
            for i in range(0, 2 * self.count, 2)
        ]  # fmt: skip
        return nodes, bodies

    def _cables(self, rod: Rod, begin: Array, end: Array) -> tuple[list[Any], list[Any]]:
        slope, places = (end - begin) / rod.length, np.linspace(begin, end, self.count + 1)
        nodes = [self.mbs.AddNode(NodePoint2DSlope1(referenceCoordinates=[*place, *slope])) for place in places]
        bodies = [
            self.mbs.AddObject(ObjectANCFCable2D(
                length=rod.length / self.count, massPerLength=rod.mass, bendingStiffness=rod.bending[1],
                axialStiffness=self.stiff * rod.bending[1] / rod.length**2, nodeNumbers=nodes[i : i + 2],
                useReducedOrderIntegration=self.reduced,
            ))
            for i in range(self.count)
        ]  # fmt: skip
        return nodes, bodies

    def _hold(self, node: Any, body: Any, held: Any) -> None:
        """Hold the start: clamped, or by a hub that turns about a joint."""
        if self.task.held == "clamped":
            for coordinate in (0, 1, 3) if self.element == CABLE else (0, 1, 2):
                fix(self.mbs, node, coordinate)
            return
        if self.element == CABLE and not (self.task.rotor or self.task.torque or self.task.angle):
            begin = self.mbs.AddMarker(MarkerNodePosition(nodeNumber=node))
            self.mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[held, begin]))
            return
        hub = self._hub(body) if self.element == CABLE else node
        begin = self.mbs.AddMarker(MarkerNodePosition(nodeNumber=hub))
        self.mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[held, begin]))
        if self.task.rotor and self.element == BEAM:
            self.mbs.AddObject(ObjectRigidBody2D(mass=0.0, inertia=self.task.rotor, nodeNumber=hub))
        if (torque := self.task.torque) is not None:
            angle = self.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=hub, coordinate=2))
            self.mbs.AddLoad(
                LoadCoordinate(markerNumber=angle, load=0.0, loadUserFunction=lambda _mbs, t, _load: torque(t))
            )
        if self.task.angle is not None:
            fix(self.mbs, hub, 2, self.task.angle)

    def _hub(self, body: Any) -> Any:
        """Add a rigid hub to which the first cable is clamped."""
        mass = NEGLIGIBLE * self.task.rods[0].mass * self.task.length
        hub = self.mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[0.0, 0.0, 0.0]))
        rotor = self.task.rotor or mass * self.task.length**2
        rigid = self.mbs.AddObject(ObjectRigidBody2D(mass=mass, inertia=rotor, nodeNumber=hub))
        ends = [
            self.mbs.AddMarker(MarkerBodyRigid(bodyNumber=each, localPosition=[0.0, 0.0, 0.0]))
            for each in (rigid, body)
        ]
        self.mbs.AddObject(ObjectJointGeneric(markerNumbers=ends, constrainedAxes=[1, 1, 0, 0, 0, 1]))
        return hub

    def _end(self, node: Any, body: Any) -> None:
        """Add the payload and the end moment."""
        if self.task.payload and self.element == CABLE:
            self.mbs.AddObject(ObjectMassPoint2D(mass=self.task.payload, nodeNumber=node))
        elif self.task.payload:
            self.mbs.AddObject(ObjectRigidBody2D(mass=self.task.payload, inertia=0.0, nodeNumber=node))
        if self.task.moment and self.element == CABLE:
            end = [self.task.rods[-1].length / self.count, 0.0, 0.0]
            marker = self.mbs.AddMarker(MarkerBodyRigid(bodyNumber=body, localPosition=end))
            self.mbs.AddLoad(LoadTorqueVector(markerNumber=marker, loadVector=[0.0, 0.0, self.task.moment]))
        elif self.task.moment:
            angle = self.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
            self.mbs.AddLoad(LoadCoordinate(markerNumber=angle, load=self.task.moment))


def _run_in_space(task: Task, setting: Setting) -> Outcome:
    """Build the arm, and run Exudyn's solver once."""
    box = exu.SystemContainer()
    mbs = box.AddSystem()
    last, place = mbs.AddMarker(MarkerBodyRigid(bodyNumber=mbs.AddObject(ObjectGround()))), np.zeros(3)
    before = np.eye(3)
    for rod in task.rods:
        nodes, place = _rod_in_space(mbs, rod, place, task.gravity, setting)
        begin = mbs.AddMarker(MarkerNodeRigid(nodeNumber=nodes[0]))
        mbs.AddObject(ObjectJointGeneric(
            markerNumbers=[last, begin], constrainedAxes=[1] * 6, rotationMarker0=before.T @ rod.turn,
        ))  # fmt: skip
        last, before = mbs.AddMarker(MarkerNodeRigid(nodeNumber=nodes[-1])), rod.turn
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(SensorNode(nodeNumber=nodes[-1], storeInternal=True, outputVariableType=position))
    mbs.Assemble()
    return solved(mbs, task, setting, sensor, np.eye(3))


def _rod_in_space(mbs: Any, rod: Rod, begin: Array, gravity: Array, setting: Setting) -> tuple[list[Any], Array]:
    """Add a rod; return its nodes and its end."""
    count = round(setting["elements"])
    end = begin + rod.length * rod.turn[:, 0]
    turn = Rotation.from_matrix(rod.turn).as_rotvec()
    nodes = [
        mbs.AddNode(NodeRigidBodyRotVecLG(referenceCoordinates=[*place, *turn]))
        for place in np.linspace(begin, end, count + 1)
    ]
    section = exu.BeamSection()
    stiff = setting["stiffness"] * rod.bending[1] / rod.length**2
    section.stiffnessMatrix = np.diag([stiff, stiff, stiff, rod.twist, *rod.bending])
    section.inertia, section.massPerLength = np.diag(rod.rotary), rod.mass
    for pair in pairwise(nodes):
        beam = mbs.AddObject(
            ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=rod.length / count, sectionData=section)
        )
        marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=beam))
        mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=gravity.tolist()))
    return nodes, end
