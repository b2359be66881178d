"""What Drake reads in SDF files, in a process of its own, which some files abort: requests and answers are JSON."""

from __future__ import annotations

import json
import logging
import sys

import numpy as np
from pydrake.all import MultibodyForces, MultibodyPlant, Parser


def read(request: dict) -> dict:
    """M, T_GC and T_FL at a state, the joints' names in order, and what Drake warns of."""
    warnings: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: warnings.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("drake").handlers = [handler]
    plant = MultibodyPlant(0.0)
    try:
        Parser(plant).AddModelsFromString(request["text"], "sdf")
    except RuntimeError as error:
        return {"error": str(error)}
    plant.mutable_gravity_field().set_gravity_vector(request["gravity"])
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, request["q"])
    still, moving = np.zeros(plant.num_velocities()), request["qd"]
    springs = MultibodyForces(plant)
    plant.SetVelocities(context, still)
    plant.CalcForceElementsContribution(context, springs)  # gravity acts on bodies, springs and dampers on joints
    plant.SetVelocities(context, moving)
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    moved = [joint for joint in joints if joint.num_positions()]
    return {
        "joints": [joint.name() for joint in moved],
        "order": [joint.position_start() for joint in moved],
        "damping": [joint.default_damping() for joint in moved],
        "motors": plant.num_actuators(),
        "M": plant.CalcMassMatrix(context).tolist(),
        "bias": bias.tolist(),
        "elastic": (-springs.generalized_forces()).tolist(),
        "warnings": warnings,
    }


json.dump([read(request) for request in json.load(sys.stdin)], sys.stdout)
