"""Exudyn's geometrically exact beams in space, of two nodes, for clamped arms; only the solver's call is timed."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyRigid,
    MarkerNodeRigid,
    NodeRigidBodyRotVecLG,
    ObjectBeamGeometricallyExact,
    ObjectGround,
    ObjectJointGeneric,
    SensorNode,
)
from scipy.spatial.transform import Rotation

from flexlink.common.types import Array
from validation.formulations.exudyn_elements import solved
from validation.formulations.task import Outcome, Rod, Setting, Task


def run(task: Task, _element: str, setting: Setting) -> Outcome:
    """Build the arm, and run Exudyn's solver once."""
    box = exu.SystemContainer()
    mbs = box.AddSystem()
    last, place = mbs.AddMarker(MarkerBodyRigid(bodyNumber=mbs.AddObject(ObjectGround()))), np.zeros(3)
    before = np.eye(3)
    for rod in task.rods:
        nodes, place = _rod(mbs, rod, place, task.gravity, setting)
        begin = mbs.AddMarker(MarkerNodeRigid(nodeNumber=nodes[0]))
        mbs.AddObject(ObjectJointGeneric(
            markerNumbers=[last, begin], constrainedAxes=[1] * 6, rotationMarker0=before.T @ rod.turn,
        ))  # fmt: skip
        last, before = mbs.AddMarker(MarkerNodeRigid(nodeNumber=nodes[-1])), rod.turn
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(SensorNode(nodeNumber=nodes[-1], storeInternal=True, outputVariableType=position))
    mbs.Assemble()
    return solved(mbs, task, setting, sensor, np.eye(3))


def _rod(mbs: Any, rod: Rod, begin: Array, gravity: Array, setting: Setting) -> tuple[list[Any], Array]:
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
