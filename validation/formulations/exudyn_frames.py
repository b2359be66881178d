"""Exudyn's floating frame of reference with few modes: one link that bends in a plane, moved by a joint at its root.

The frame is fixed to the root. The modes of Hurty, Craig and Bampton, with the root's section as their only boundary,
are those of the clamped link with its payload; of them, those that bend it in the plane are kept. Only the solver's
call is timed.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import (
    LoadTorqueVector,
    MarkerBodyRigid,
    MarkerNodeRigid,
    MarkerSuperElementPosition,
    ObjectGround,
    ObjectJointGeneric,
    ObjectRigidBody,
    SensorMarker,
)

from flexlink.common.types import Array
from validation.formulations.beam_bricks import CORNERS, bricks
from validation.formulations.exudyn_elements import fix, solved
from validation.formulations.task import Outcome, Setting, Task

TURN = 5  # coordinate of the frame: angle about z
OTHERS = 4  # modes to compute for each one in the plane: others bend it out of the plane, twist or stretch it
IN_PLANE = 0.99  # share of a mode's displacements that are along y


def run(task: Task, _element: str, setting: Setting) -> Outcome:
    """Build the link, and run Exudyn's solver once."""
    box = exu.SystemContainer()
    mbs = box.AddSystem()
    sensor = _link(mbs, task, setting)
    mbs.Assemble()
    return solved(mbs, task, setting, sensor, task.axes)


def _link(mbs: Any, task: Task, setting: Setting) -> Any:
    """Add the link, its joint, rotor and input; return a sensor at the tip."""
    model = finite_elements(task, round(setting["elements"]), round(setting["modes"]))
    frame = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=exu.NodeType.RotationRxyz)
    made = frame.AddObjectFFRFreducedOrder(mbs, gravity=(task.axes.T @ task.gravity).tolist())
    node, body = made["nRigidBody"], made["oFFRFreducedOrder"]
    held = mbs.AddMarker(MarkerBodyRigid(bodyNumber=mbs.AddObject(ObjectGround())))
    root = mbs.AddMarker(MarkerNodeRigid(nodeNumber=node))
    mbs.AddObject(ObjectJointGeneric(markerNumbers=[held, root], constrainedAxes=[1, 1, 1, 1, 1, 0]))
    if task.rotor:
        mbs.AddObject(ObjectRigidBody(mass=0.0, inertia=[0.0, 0.0, task.rotor, 0.0, 0.0, 0.0], nodeNumber=node))
    if (torque := task.torque) is not None:
        mbs.AddLoad(LoadTorqueVector(
            markerNumber=root, loadVector=[0.0, 0.0, 0.0],
            loadVectorUserFunction=lambda _mbs, t, _load: [0.0, 0.0, torque(t)],
        ))  # fmt: skip
    if task.angle is not None:
        fix(mbs, node, TURN, task.angle)
    last = range(model.NumberOfNodes() - CORNERS, model.NumberOfNodes())
    tip = mbs.AddMarker(MarkerSuperElementPosition(
        bodyNumber=body, meshNodeNumbers=list(last), weightingFactors=[1 / CORNERS] * CORNERS,
    ))  # fmt: skip
    position = exu.OutputVariableType.Position
    return mbs.AddSensor(SensorMarker(markerNumber=tip, storeInternal=True, outputVariableType=position))


def finite_elements(task: Task, elements: int, modes: int) -> Any:
    """The link as Exudyn's finite element model, with its first modes of bending in the plane."""
    (rod,) = task.rods
    made, model = bricks(rod.length, rod.bending[1], rod.mass, elements, task.payload), FEMinterface()
    model.nodes = {"Position": made.nodes}
    model.massMatrix, model.stiffnessMatrix = scipy.sparse.csr_matrix(made.M), scipy.sparse.csr_matrix(made.K)
    model.ComputeHurtyCraigBamptonModes([list(range(CORNERS))], OTHERS * (modes + 1))
    kept = _in_plane(model.modeBasis["matrix"])[:modes]
    model.modeBasis["matrix"], model.eigenValues = model.modeBasis["matrix"][:, kept], model.eigenValues[kept]
    return model


def _in_plane(shapes: Array) -> list[int]:
    """Columns that bend the link in the plane, in ascending order of their frequencies."""
    share = np.linalg.norm(shapes[1::3], axis=0) / np.linalg.norm(shapes, axis=0)
    return [k for k, one in enumerate(share.tolist()) if one > IN_PLANE]
