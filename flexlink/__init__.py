"""flexlink: arms whose links bend, as chains of rigid segments and springs."""

import importlib
from typing import TYPE_CHECKING

import flexlink.common.entry  # noqa: F401  first of all

# isort: split

from flexlink import errors
from flexlink.advice.advise import advise
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.versions import __version__ as __version__
from flexlink.describe.actions import Drive, PrescribedMotion, Wrench
from flexlink.describe.arm import Arm, Base, Damping, Friction, Link, Material, Section
from flexlink.describe.drag import Drag
from flexlink.describe.initial import BaseState, InitialState
from flexlink.describe.joint import DenavitHartenberg, Joint, Mount
from flexlink.describe.reference import Reference
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.rigidified import rigidified
from flexlink.describe.rigidity import Rigidity
from flexlink.describe.root import RootDamping, RootStiffness
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene, load_scene
from flexlink.describe.sensor import Sensor
from flexlink.describe.shaping import InputShaper
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
from flexlink.dynamics.equilibrium import buckling_loads, solve_static
from flexlink.dynamics.forces import drag_torque
from flexlink.dynamics.loads import internal_loads
from flexlink.dynamics.momentum import momentum
from flexlink.dynamics.placement import frames, jacobian, tip_position
from flexlink.dynamics.point_motion import point_motion
from flexlink.dynamics.sensors.outputs import SensorOutputs
from flexlink.dynamics.strain import beam_strain
from flexlink.dynamics.terms import (
    bias_torque,
    elastic_torque,
    energy,
    friction_torque,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
)
from flexlink.dynamics.vibration.in_motion import equilibrium_in_motion, modes_in_motion
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.modal import modes, natural_frequencies
from flexlink.dynamics.vibration.poles import pd_poles
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.formats import to_mjcf, to_sdf, to_urdf
from flexlink.motion.batch import simulate_many
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.sensitivity import sensitivities
from flexlink.motion.simulate import Problem, simulate
from flexlink.motion.simulator import Simulator
from flexlink.results.loading import load_trajectory
from flexlink.results.settling import overshoot, residual_vibration, settling_time
from flexlink.results.trajectory import Trajectory
from flexlink.robots.flexible import FlexibleLink
from flexlink.robots.importing import import_urdf

if TYPE_CHECKING:
    from flexlink.diagnosis.comparison import compare
    from flexlink.diagnosis.trajectories import compare_trajectories
    from flexlink.identification.fit import check_fit, fit
    from flexlink.identification.fitted import Fitted
    from flexlink.identification.loading import load_fit
    from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun, FitStatic
    from flexlink.scene_report.report import report
    from flexlink.sweeps.plan import Sweep, load_sweep
    from flexlink.sweeps.run import sweep


__all__ = [
    "Arm",
    "Base",
    "BaseState",
    "Chain",
    "Damping",
    "DenavitHartenberg",
    "Drag",
    "Drive",
    "FitModes",
    "FitParameter",
    "FitProblem",
    "FitRun",
    "FitStatic",
    "Fitted",
    "FlexibleLink",
    "FlexlinkError",
    "Friction",
    "InitialState",
    "InputShaper",
    "Joint",
    "Link",
    "Material",
    "Mount",
    "PrescribedMotion",
    "Problem",
    "Reference",
    "ReferenceTrajectory",
    "RigidBody",
    "Rigidity",
    "RootDamping",
    "RootStiffness",
    "RunSettings",
    "Scene",
    "Section",
    "Sensor",
    "SensorOutputs",
    "Simulator",
    "Sweep",
    "Trajectory",
    "Wrench",
    "advise",
    "beam_strain",
    "bias_torque",
    "buckling_loads",
    "check_fit",
    "compare",
    "compare_trajectories",
    "drag_torque",
    "elastic_torque",
    "energy",
    "equilibrium_in_motion",
    "errors",
    "fit",
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
    "load_fit",
    "load_scene",
    "load_sweep",
    "load_trajectory",
    "lump",
    "mass_matrix",
    "modes",
    "modes_in_motion",
    "momentum",
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


def __getattr__(name: str) -> object:
    """What is public but loaded when it is used: it brings other engines, pages and workers."""
    later = {
        "diagnosis.comparison": ["compare"],
        "diagnosis.trajectories": ["compare_trajectories"],
        "identification.fit": ["check_fit", "fit"],
        "identification.fitted": ["Fitted"],
        "identification.loading": ["load_fit"],
        "identification.problem": ["FitModes", "FitParameter", "FitProblem", "FitRun", "FitStatic"],
        "scene_report.report": ["report"],
        "sweeps.plan": ["Sweep", "load_sweep"],
        "sweeps.run": ["sweep"],
    }
    for module, names in later.items():
        if name in names:
            return getattr(importlib.import_module(f"flexlink.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
