"""flexlink: arms whose links bend, as chains of rigid segments and springs."""

import flexlink.entry  # noqa: F401  first of all

# isort: split

from flexlink.arm import Arm, Damping, Joint, Link, Material, Mount, Payload, Section
from flexlink.batch import simulate_many
from flexlink.chain import Chain, Coordinate
from flexlink.dynamics import (
    Energy,
    Frames,
    bias_torque,
    elastic_torque,
    energy,
    forward_dynamics,
    frames,
    friction_torque,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
    tip_position,
)
from flexlink.errors import (
    ArgumentError,
    ConvergenceError,
    DivergenceError,
    FlexlinkError,
    InterruptedRunError,
    MissingDependencyError,
    OutputError,
    SceneError,
    SingularMassError,
    UnstableStepError,
)
from flexlink.export import to_mjcf, to_urdf
from flexlink.lumping import lump
from flexlink.modal import Modes, modes, natural_frequencies
from flexlink.scene import Drive, Initial, Motion, Run, Scene, Wrench, load_scene
from flexlink.simulate import simulate
from flexlink.stability import stable_step
from flexlink.statics import Equilibrium, buckling_loads, solve_static
from flexlink.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "Arm",
    "Chain",
    "ConvergenceError",
    "Coordinate",
    "Damping",
    "DivergenceError",
    "Drive",
    "Energy",
    "Equilibrium",
    "FlexlinkError",
    "Frames",
    "Initial",
    "InterruptedRunError",
    "Joint",
    "Link",
    "Material",
    "MissingDependencyError",
    "Modes",
    "Motion",
    "Mount",
    "OutputError",
    "Payload",
    "Run",
    "Scene",
    "SceneError",
    "Section",
    "SingularMassError",
    "Trajectory",
    "UnstableStepError",
    "Wrench",
    "bias_torque",
    "buckling_loads",
    "elastic_torque",
    "energy",
    "forward_dynamics",
    "frames",
    "friction_torque",
    "gravity_torque",
    "inverse_dynamics",
    "load_scene",
    "lump",
    "mass_matrix",
    "modes",
    "natural_frequencies",
    "simulate",
    "simulate_many",
    "solve_static",
    "stable_step",
    "tip_position",
    "to_mjcf",
    "to_urdf",
]
