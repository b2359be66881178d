"""Exudyn: geometrically exact beams in the plane, with stretch and shear so stiff that they do not count."""

from __future__ import annotations

import math
from typing import Any

import exudyn as exu
import numpy as np
from exudyn import itemInterface as items  # noqa: N813

from flexarm_bench.case import Answer, Array, Cannot, Case, Link, Settings

ELEMENTS, INTERVALS = 16, 2  # elements of a link, with three nodes each
STIFF = 1e6  # axial and shear stiffness × L² / EI
THIN = 1e-6  # least rotary inertia of a section, relative to ρA L²: initial accelerations need one
STEPS = 20_000  # of a motion; the generalized-α method has order 2
LOAD_STEPS = 40
SPECTRAL_RADIUS, RESIDUAL = 0.9, 1e-12  # residual in terms of the axial stiffness


def run(case: Case, settings: Settings) -> Answer:
    """Compute a case; settings: `elements` of a link, `steps` of a motion."""
    if case.ask not in ("statics", "motion"):
        raise Cannot(f"not tried: {case.ask} of its beams")
    if not case.planar:
        raise Cannot("its geometrically exact beams are planar")
    if case.follows:
        raise Cannot("not tried: a force that follows its beams")
    elements, steps = int(settings.get("elements", ELEMENTS)), int(settings.get("steps", STEPS))
    arm = Arm(case, elements)
    if case.ask == "statics":
        return Answer(arm.statics(), f"{elements} elements a link, {LOAD_STEPS} load steps")
    return Answer(arm.motion(steps), f"{elements} elements a link, {steps} steps")


class Arm:
    """The arm as a system of Exudyn."""

    def __init__(self, case: Case, elements: int) -> None:
        self.case, self.box = case, exu.SystemContainer()
        self.mbs = self.box.AddSystem()
        ground = self.mbs.AddObject(items.ObjectGround())
        held = self.mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=ground))
        self.origin = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=self._point(), coordinate=0))
        place, angle, last = np.zeros(2), 0.0, None
        for link in case.links:
            angle += link.angle
            nodes, place = self._add(link, place, angle, elements)
            begin = self.mbs.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[0]))
            self.mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=[held, begin]))
            self._add_joint(link, nodes[0], last)
            held, last = self.mbs.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[-1])), nodes[-1]
            if link.end_mass or link.end_inertia:
                end = items.ObjectRigidBody2D(mass=link.end_mass, inertia=link.end_inertia, nodeNumber=last)
                self.mbs.AddObject(end)
        self._add_loads(held, last)
        output = exu.OutputVariableType.Position
        self.sensor = self.mbs.AddSensor(
            items.SensorNode(nodeNumber=last, storeInternal=True, outputVariableType=output)
        )
        self.straight, self.last = place, last
        self.mbs.Assemble()

    def _point(self) -> Any:
        return self.mbs.AddNode(items.NodePointGround())

    def _add(self, link: Link, begin: Array, angle: float, elements: int) -> tuple[list[Any], Array]:
        count = elements * INTERVALS
        end = begin + link.length * np.array([math.cos(angle), math.sin(angle)])
        nodes = [
            self.mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*place, angle]))
            for place in np.linspace(begin, end, count + 1)
        ]
        stiff = STIFF * link.EI / link.length**2
        rotary = max(link.rotary_inertia, THIN * link.mass_per_length * link.length**2)
        for i in range(0, count, INTERVALS):
            beam = items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[i : i + INTERVALS + 1], length=link.length / elements,
                massPerLength=link.mass_per_length, crossSectionInertia=rotary,
                bendingStiffness=link.EI, axialStiffness=stiff, shearStiffness=stiff,
                bendingDamping=link.loss_time * link.EI, includeReferenceRotations=True,
            )  # fmt: skip
            marker = self.mbs.AddMarker(items.MarkerBodyMass(bodyNumber=self.mbs.AddObject(beam)))
            self.mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[*self.case.gravity]))
        return nodes, end

    def _add_joint(self, link: Link, node: Any, before: Any) -> None:
        """Hub inertia, clamp, torque or given angle at the start of a link."""
        turning = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
        if link.hub_inertia:
            self.mbs.AddObject(items.ObjectRigidBody2D(mass=0.0, inertia=link.hub_inertia, nodeNumber=node))
        first = before is None
        if link.joint == "clamped":
            other = self.origin
            if not first:
                other = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=before, coordinate=2))
            self.mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[other, turning]))
        elif first and self.case.motion:
            motion = self.case.motion
            self.mbs.AddObject(
                items.ObjectConnectorCoordinate(
                    markerNumbers=[self.origin, turning],
                    offsetUserFunction=lambda mbs, t, number, offset: float(motion.motion(t)[0]),
                )
            )
        elif first and self.case.torque:
            pulse = self.case.torque
            self.mbs.AddLoad(
                items.LoadCoordinate(
                    markerNumber=turning, load=0.0, loadUserFunction=lambda mbs, t, load: float(pulse.torque(t))
                )
            )

    def _add_loads(self, tip: Any, node: Any) -> None:
        if any(self.case.force):
            self.mbs.AddLoad(items.LoadForceVector(markerNumber=tip, loadVector=[*self.case.force]))
        if any(self.case.moment):
            turning = self.mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
            self.mbs.AddLoad(items.LoadCoordinate(markerNumber=turning, load=self.case.moment[2]))

    def _settings(self) -> Any:
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = settings.timeIntegration.verboseMode = 0
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        return settings

    @property
    def _residual(self) -> float:
        return RESIDUAL * max(STIFF * link.EI / link.length**2 for link in self.case.links)

    def statics(self) -> Array:
        """Displacement of the tip."""
        settings = self._settings()
        settings.staticSolver.numberOfLoadSteps = LOAD_STEPS
        newton = settings.staticSolver.newton
        newton.absoluteTolerance, newton.relativeTolerance = 10 * self._residual, 0.0
        self.mbs.SolveStatic(settings)
        place = np.array(self.mbs.GetNodeOutput(self.last, exu.OutputVariableType.Position))
        return np.array([*(place[:2] - self.straight), 0.0])

    def motion(self, steps: int) -> Array:
        """The tip at the times of the case."""
        settings, times = self._settings(), self.case.times
        settings.solution.sensors.writePeriod = times[1]
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps = times[-1], steps
        integration.adaptiveStep = False
        integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        newton = integration.newton
        newton.absoluteTolerance, newton.relativeTolerance = self._residual, 0.0
        self.mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
        return np.array(self.mbs.GetSensorStoredData(self.sensor)[:, 1:3])
