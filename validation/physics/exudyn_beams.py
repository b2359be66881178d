"""python -m validation.physics.exudyn_beams: compute reference motions of Exudyn's geometrically exact beams.

Elements have three nodes, so the error has order 4 in the number of elements. The generalized-α method has order 2;
a released beam also vibrates in unresolved modes, so order 1 is assumed. A chain does not shear or stretch;
so the beam's shear and axial stiffness are both set to a large s EI/L², whose effect is proportional to 1/s. Newton's
method stops at a residual relative to this stiffness, which must exceed the rounding error of axial forces.

Each of the four parameters is coarsened separately. The error estimate of the finest run is the sum of the changes,
each divided by its ratio to the remaining error. Needs exudyn; takes a minute.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadCoordinate,
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    NodeRigidBody2D,
    ObjectBeamGeometricallyExact2D,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
    SensorNode,
)

from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.results.tip_motion import largest_distance
from validation.physics.beam_references import SCENES, Beam, Plane, beam_scene, file_name, plane_of
from validation.physics.formulas import pulse
from validation.reference_values import store_reference

TORQUES_OF_SCENES = {"torque_pulse": pulse}
SPECTRAL_RADIUS = 0.9  # spectral radius of the generalized-α method at infinite frequency
INTERVALS = 2  # number of intervals between the nodes of an element


class Numerics(NamedTuple):
    """Resolution of a run; `stiffness` is s, or None for the section's own stiffnesses."""

    elements: int  # number of elements per link
    step: float  # time step [s]
    stiffness: float | None
    residual: float


FINEST = Numerics(elements=16, step=1.5625e-5, stiffness=1e6, residual=2e-13)
COARSER: dict[str, tuple[Any, int]] = {
    "elements": (8, 2**4 - 1), "step": (3.125e-5, 2 - 1), "stiffness": (1e5, 10 - 1), "residual": (2e-12, 10 - 1),
}  # fmt: skip
"""For each parameter, a coarser value, and the ratio of the resulting change to the remaining error."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute and store the references."""
    parser = argparse.ArgumentParser(prog="python -m validation.physics.exudyn_beams", description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="names (default: all)")
    for name in parser.parse_args(arguments).scenes:
        print(f"{name}: own error {compute(name):.1e} m", flush=True)
    return 0


def compute(name: str) -> float:
    """Run and store a scene; return the error estimate [m]."""
    scene, began = beam_scene(name), time.process_time()
    plane = plane_of(scene)
    finest = tip(name, plane, scene.run, FINEST)
    errors = {
        key: largest_distance(finest, tip(name, plane, scene.run, FINEST._replace(**{key: coarser}))) / times
        for key, (coarser, times) in COARSER.items()
    }
    reference = {"plane": plane.numbers, "errors_m": errors, "own_error_m": sum(errors.values())}
    if all(section.shape != "general" for section in scene.arm.sections.values()):
        own = tip(name, plane, scene.run, FINEST._replace(stiffness=None))
        reference["shear_and_stretch_m"] = largest_distance(finest, own)
    store_reference(
        file_name(name),
        f"Tip of {name!r} in frame 0 as geometrically exact beams. {scene.about}",
        "python -m validation.physics.exudyn_beams",
        time.process_time() - began,
        exudyn=exu.__version__,
        settings={
            "element": "ObjectBeamGeometricallyExact2D, 3 nodes", "finest": FINEST._asdict(),
            "coarser": {key: value for key, (value, _) in COARSER.items()},
            "solver": "GeneralizedAlpha", "spectral_radius": SPECTRAL_RADIUS,
        },
        reference=reference | {"t_s": scene.run.times.tolist(), "tip": finest.tolist()},
    )  # fmt: skip
    return sum(errors.values())


def tip(name: str, plane: Plane, run: RunSettings, fine: Numerics) -> Array:
    """Tip at the samples of a run, in frame 0, shape (samples, 3) [m]."""
    box = exu.SystemContainer()
    mbs = box.AddSystem()
    held = mbs.AddMarker(MarkerBodyPosition(bodyNumber=mbs.AddObject(ObjectGround())))
    first, place, node = None, np.zeros(2), None
    for beam in plane.beams:
        nodes, place = _add_beam(mbs, beam, place, plane.gravity, fine)
        begin = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[0]))
        mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[held, begin]))
        held, node = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1])), nodes[-1]
        first = nodes[0] if first is None else first
    mbs.AddObject(ObjectRigidBody2D(mass=0.0, inertia=plane.rotor, nodeNumber=first))
    mbs.AddObject(ObjectRigidBody2D(mass=plane.payload, inertia=0.0, nodeNumber=node))
    if name in TORQUES_OF_SCENES:
        angle = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=first, coordinate=2))
        torque = TORQUES_OF_SCENES[name]
        mbs.AddLoad(LoadCoordinate(markerNumber=angle, load=0.0, loadUserFunction=lambda _mbs, t, _: float(torque(t))))
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=position))
    mbs.Assemble()
    axial = max(_stiffnesses(beam, fine)[0] for beam in plane.beams)
    mbs.SolveDynamic(
        _settings(run, fine.step, fine.residual * axial), solverType=exu.DynamicSolverType.GeneralizedAlpha
    )
    stored = mbs.GetSensorStoredData(sensor)
    return np.asarray(stored[:, 1:4] @ plane.axes.T)


def _add_beam(mbs: Any, beam: Beam, begin: Array, gravity: Array, fine: Numerics) -> tuple[list[Any], Array]:
    """Add a beam; return its nodes and its end."""
    intervals = fine.elements * INTERVALS
    end = begin + beam.length * np.array([np.cos(beam.angle), np.sin(beam.angle)])
    places = np.linspace(begin, end, intervals + 1)
    nodes = [mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[*place, beam.angle])) for place in places]
    axial, shear = _stiffnesses(beam, fine)
    for i in range(0, intervals, INTERVALS):
        element = ObjectBeamGeometricallyExact2D(
            nodeNumbers=nodes[i : i + INTERVALS + 1], length=beam.length / fine.elements, massPerLength=beam.mass,
            crossSectionInertia=beam.inertia, bendingStiffness=beam.bending, axialStiffness=axial,
            shearStiffness=shear, includeReferenceRotations=True,
        )  # fmt: skip
        marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=mbs.AddObject(element)))
        mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[*gravity, 0.0]))
    return nodes, end


def _stiffnesses(beam: Beam, fine: Numerics) -> tuple[float, float]:
    """Axial and shear stiffness [N]."""
    stiff = (fine.stiffness or 0.0) * beam.bending / beam.length**2
    return (stiff, stiff) if stiff else (beam.axial, beam.shear)


def _settings(run: RunSettings, step: float, residual: float) -> Any:
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = run.spacing
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    time = settings.timeIntegration
    time.endTime, time.numberOfSteps = run.duration, round(run.duration / step)
    time.adaptiveStep = False
    time.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    time.newton.absoluteTolerance, time.newton.relativeTolerance = residual, 0.0
    return settings


if __name__ == "__main__":
    sys.exit(main())
