"""flexlink: arms whose links bend, as chains of rigid segments and springs."""

import importlib
from typing import TYPE_CHECKING

import flexlink.common.entry  # noqa: F401  first of all

# isort: split

from flexlink.analysis.equilibrium import Equilibrium, buckling_loads, solve_static
from flexlink.analysis.linear import LinearModel, linearize
from flexlink.analysis.loads import InternalLoads, internal_loads
from flexlink.analysis.modal import Modes, modes, natural_frequencies
from flexlink.analysis.stability import stable_step
from flexlink.analysis.strain import BeamStrain, beam_strain
from flexlink.chain.chain import Chain, Coordinate
from flexlink.chain.lumping import lump
from flexlink.common.errors import (
    ArgumentError,
    ConvergenceError,
    DataFileError,
    EngineError,
    FlexlinkError,
    MissingDependencyError,
    OutputError,
    SceneError,
    SingularMassError,
    UnstableStepError,
)
from flexlink.describe.arm import Arm, Damping, Friction, Link, Material, Section
from flexlink.describe.joint import DenavitHartenberg, Joint, Mount
from flexlink.describe.rigid_body import Payload
from flexlink.describe.scene import Scene, load_scene
from flexlink.describe.situation import Drive, Initial, Motion, Run, Wrench
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import (
    ForwardDerivatives,
    InverseDerivatives,
    forward_dynamics_derivatives,
    inverse_dynamics_derivatives,
)
from flexlink.dynamics.placement import Frames, Jacobian, frames, jacobian, tip_position
from flexlink.dynamics.point_motion import PointMotion, point_motion
from flexlink.dynamics.terms import (
    Energy,
    bias_torque,
    elastic_torque,
    energy,
    friction_torque,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
)
from flexlink.formats import to_mjcf, to_sdf, to_urdf
from flexlink.motion.batch import simulate_many
from flexlink.motion.endings import ControlError, DivergenceError, InterruptedRunError
from flexlink.motion.result import State, Trajectory
from flexlink.motion.settling import overshoot, residual_vibration, settling_time
from flexlink.motion.simulator import Simulator
from flexlink.motion.single import simulate
from flexlink.motion.start import initial_state
from flexlink.robots.flexible import Flexible
from flexlink.robots.importing import Imported, import_urdf

if TYPE_CHECKING:
    from flexlink.engines.comparison import Comparison, compare

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "Arm",
    "BeamStrain",
    "Chain",
    "Comparison",
    "ControlError",
    "ConvergenceError",
    "Coordinate",
    "Damping",
    "DataFileError",
    "DenavitHartenberg",
    "DivergenceError",
    "Drive",
    "Energy",
    "EngineError",
    "Equilibrium",
    "Flexible",
    "FlexlinkError",
    "ForwardDerivatives",
    "Frames",
    "Friction",
    "Imported",
    "Initial",
    "InternalLoads",
    "InterruptedRunError",
    "InverseDerivatives",
    "Jacobian",
    "Joint",
    "LinearModel",
    "Link",
    "Material",
    "MissingDependencyError",
    "Modes",
    "Motion",
    "Mount",
    "OutputError",
    "Payload",
    "PointMotion",
    "Run",
    "Scene",
    "SceneError",
    "Section",
    "Simulator",
    "SingularMassError",
    "State",
    "Trajectory",
    "UnstableStepError",
    "Wrench",
    "beam_strain",
    "bias_torque",
    "buckling_loads",
    "compare",
    "elastic_torque",
    "energy",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "frames",
    "friction_torque",
    "gravity_torque",
    "import_urdf",
    "initial_state",
    "internal_loads",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "jacobian",
    "linearize",
    "load_scene",
    "lump",
    "mass_matrix",
    "modes",
    "natural_frequencies",
    "overshoot",
    "point_motion",
    "residual_vibration",
    "settling_time",
    "simulate",
    "simulate_many",
    "solve_static",
    "stable_step",
    "tip_position",
    "to_mjcf",
    "to_sdf",
    "to_urdf",
]


def __getattr__(name: str) -> object:
    """What only those load who ask for it: `compare` and its `Comparison`, with the adapters of other engines."""
    if name in {"Comparison", "compare"}:
        return getattr(importlib.import_module("flexlink.engines.comparison"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
