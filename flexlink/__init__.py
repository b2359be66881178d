"""flexlink: arms whose links bend, as chains of rigid segments and springs."""

import importlib
from typing import TYPE_CHECKING

import flexlink.common.entry  # noqa: F401  first of all

# isort: split

from flexlink.advice.advise import advise
from flexlink.advice.verdict import Advice
from flexlink.chain.chain import Chain, Coordinate
from flexlink.chain.lumping import lump
from flexlink.common.errors import (
    AdviceError,
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
from flexlink.common.versions import __version__ as __version__
from flexlink.describe.arm import Arm, Damping, Friction, Link, Material, Section
from flexlink.describe.conditions import Drive, InitialState, PrescribedMotion, RunSettings, Wrench
from flexlink.describe.joint import DenavitHartenberg, Joint, Mount
from flexlink.describe.reference import Reference
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.rigidified import rigidified
from flexlink.describe.scene import Scene, load_scene
from flexlink.describe.shaping import InputShaper
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import (
    ForwardDerivatives,
    InverseDerivatives,
    forward_dynamics_derivatives,
    inverse_dynamics_derivatives,
)
from flexlink.dynamics.equilibrium import Equilibrium, buckling_loads, solve_static
from flexlink.dynamics.loads import InternalLoads, internal_loads
from flexlink.dynamics.placement import Frames, Jacobian, frames, jacobian, tip_position
from flexlink.dynamics.point_motion import PointMotion, point_motion
from flexlink.dynamics.strain import BeamStrain, beam_strain
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
from flexlink.dynamics.vibration.linear import LinearModel, linearize
from flexlink.dynamics.vibration.modal import Modes, modes, natural_frequencies
from flexlink.dynamics.vibration.poles import pd_poles
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.formats import to_mjcf, to_sdf, to_urdf
from flexlink.inputs.initial_state import initial_state
from flexlink.motion.batch import simulate_many
from flexlink.motion.sensitivity import Sensitivities, sensitivities
from flexlink.motion.simulate import simulate
from flexlink.motion.simulator import Simulator
from flexlink.results.samples import State
from flexlink.results.settling import overshoot, residual_vibration, settling_time
from flexlink.results.stop_reasons import ControlError, DivergenceError, EvaluationLimitError, InterruptedRunError
from flexlink.results.trajectory import Trajectory
from flexlink.robots.flexible import FlexibleLink
from flexlink.robots.importing import ImportResult, import_urdf

if TYPE_CHECKING:
    from flexlink.diagnosis.comparison import Comparison, compare
    from flexlink.diagnosis.trajectories import TrajectoryComparison, compare_trajectories
    from flexlink.pages.verdict import Report
    from flexlink.scene_report.report import report
    from flexlink.sweeps.measures import SweepOutput
    from flexlink.sweeps.plan import Sweep, load_sweep
    from flexlink.sweeps.ranges import RandomDesign
    from flexlink.sweeps.run import InterruptedSweepError, sweep
    from flexlink.sweeps.table import SweepRows


__all__ = [
    "Advice",
    "AdviceError",
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
    "EvaluationLimitError",
    "FlexibleLink",
    "FlexlinkError",
    "ForwardDerivatives",
    "Frames",
    "Friction",
    "ImportResult",
    "InitialState",
    "InputShaper",
    "InternalLoads",
    "InterruptedRunError",
    "InterruptedSweepError",
    "InverseDerivatives",
    "Jacobian",
    "Joint",
    "LinearModel",
    "Link",
    "Material",
    "MissingDependencyError",
    "Modes",
    "Mount",
    "OutputError",
    "PointMotion",
    "PrescribedMotion",
    "RandomDesign",
    "Reference",
    "ReferenceTrajectory",
    "Report",
    "RigidBody",
    "RunSettings",
    "Scene",
    "SceneError",
    "Section",
    "Sensitivities",
    "Simulator",
    "SingularMassError",
    "State",
    "Sweep",
    "SweepOutput",
    "SweepRows",
    "Trajectory",
    "TrajectoryComparison",
    "UnstableStepError",
    "Wrench",
    "advise",
    "beam_strain",
    "bias_torque",
    "buckling_loads",
    "compare",
    "compare_trajectories",
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
    "load_sweep",
    "lump",
    "mass_matrix",
    "modes",
    "natural_frequencies",
    "overshoot",
    "pd_poles",
    "point_motion",
    "report",
    "residual_vibration",
    "rigidified",
    "sensitivities",
    "settling_time",
    "simulate",
    "simulate_many",
    "solve_static",
    "stable_step",
    "sweep",
    "tip_position",
    "to_mjcf",
    "to_sdf",
    "to_urdf",
]


LATER = {
    "Comparison": "diagnosis.comparison",
    "compare": "diagnosis.comparison",
    "InterruptedSweepError": "sweeps.run",
    "SweepOutput": "sweeps.measures",
    "Report": "pages.verdict",
    "RandomDesign": "sweeps.ranges",
    "Sweep": "sweeps.plan",
    "SweepRows": "sweeps.table",
    "TrajectoryComparison": "diagnosis.trajectories",
    "compare_trajectories": "diagnosis.trajectories",
    "load_sweep": "sweeps.plan",
    "report": "scene_report.report",
    "sweep": "sweeps.run",
}
"""What only those load who ask for it: comparison and sweeps, with the adapters of other engines."""


def __getattr__(name: str) -> object:
    if name in LATER:
        return getattr(importlib.import_module(f"flexlink.{LATER[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
