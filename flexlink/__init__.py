"""flexlink: robot arms with flexible links, modelled as rigid segments and springs."""

import importlib
import importlib.util
from typing import TYPE_CHECKING

import flexlink.common.interruption  # noqa: F401  must come first: responds to signals from then on

# isort: split

from flexlink import errors
from flexlink.common.errors import FlexlinkError
from flexlink.common.versions import __version__ as __version__
from flexlink.common.versions import old_name
from flexlink.common.wording import did_you_mean

if TYPE_CHECKING:
    from flexlink import details, fits, small_motion, strength
    from flexlink.advice.advise import advise
    from flexlink.chain.chain import Chain
    from flexlink.chain.lumping import lump
    from flexlink.describe.actions import PrescribedMotion, Wrench
    from flexlink.describe.arm import Arm, Base
    from flexlink.describe.drive import Drive
    from flexlink.describe.initial import InitialState
    from flexlink.describe.joint import Joint, Mount
    from flexlink.describe.link import Drag, Link
    from flexlink.describe.material import Damping, Friction, Material, Section
    from flexlink.describe.reference import Reference
    from flexlink.describe.rigid_body import RigidBody
    from flexlink.describe.rigidity import Rigidity
    from flexlink.describe.run_settings import RunSettings
    from flexlink.describe.scene import Scene
    from flexlink.describe.scene_file import load_scene
    from flexlink.describe.sensor import Sensor
    from flexlink.describe.shaping import InputShaper
    from flexlink.diagnosis.comparison import compare
    from flexlink.diagnosis.trajectories import compare_trajectories
    from flexlink.dynamics.accelerations import forward_dynamics
    from flexlink.dynamics.conserved import energy, momentum
    from flexlink.dynamics.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
    from flexlink.dynamics.equilibrium import solve_static
    from flexlink.dynamics.forces import drag_torque
    from flexlink.dynamics.placement import frames, jacobian, tip_position
    from flexlink.dynamics.point_motion import point_motion
    from flexlink.dynamics.terms import (
        bias_torque,
        elastic_torque,
        friction_torque,
        gravity_torque,
        inverse_dynamics,
        mass_matrix,
    )
    from flexlink.dynamics.vibration.linear import linearize, linearize_many
    from flexlink.dynamics.vibration.modal import modes, natural_frequencies
    from flexlink.dynamics.vibration.stability import stable_step
    from flexlink.formats import to_mjcf, to_sdf, to_urdf
    from flexlink.formats.code import to_c, to_casadi, to_fmu
    from flexlink.identification.fit import fit
    from flexlink.motion.batch import simulate_many
    from flexlink.motion.inputs.initial_state import initial_state
    from flexlink.motion.inversion import invert
    from flexlink.motion.loop.loop import loop
    from flexlink.motion.run_gradient import run_gradient
    from flexlink.motion.sensitivity import sensitivities
    from flexlink.motion.simulate import Problem, simulate
    from flexlink.motion.simulator import Simulator
    from flexlink.motion.simulator_batch import SimulatorBatch
    from flexlink.results.trajectory import Trajectory
    from flexlink.robots.flexible import FlexibleLink
    from flexlink.robots.importing import import_urdf
    from flexlink.scene_report.report import report
    from flexlink.sweeps.plan import Sweep
    from flexlink.sweeps.run import sweep


__all__ = [
    "Arm", "Base", "Chain", "Damping", "Drag", "Drive", "FlexibleLink", "FlexlinkError", "Friction", "InitialState",
    "InputShaper", "Joint", "Link", "Material", "Mount", "PrescribedMotion", "Problem", "Reference", "RigidBody",
    "Rigidity", "RunSettings", "Scene", "Section", "Sensor", "Simulator", "SimulatorBatch", "Sweep", "Trajectory",
    "Wrench", "advise", "bias_torque", "compare", "compare_trajectories", "details", "drag_torque", "elastic_torque",
    "energy", "errors", "fit", "fits", "forward_dynamics", "forward_dynamics_derivatives", "frames", "friction_torque",
    "gravity_torque", "import_urdf", "initial_state", "inverse_dynamics", "inverse_dynamics_derivatives", "invert",
    "jacobian", "linearize", "linearize_many", "load_scene", "loop", "lump", "mass_matrix", "modes", "momentum",
    "natural_frequencies", "point_motion", "report", "run_gradient", "sensitivities", "simulate", "simulate_many",
    "small_motion", "solve_static", "stable_step", "strength", "sweep", "tip_position", "to_c", "to_casadi", "to_fmu",
    "to_mjcf", "to_sdf", "to_urdf",
]  # fmt: skip


def __getattr__(name: str) -> object:
    """Load a public name when it is first used, because compiled code and linear algebra are slow to import."""
    places = {
        "advice.advise": ["advise"], "chain.chain": ["Chain"], "chain.lumping": ["lump"],
        "describe.actions": ["PrescribedMotion", "Wrench"], "describe.drive": ["Drive"],
        "describe.arm": ["Arm", "Base"], "describe.initial": ["InitialState"], "describe.joint": ["Joint", "Mount"],
        "describe.link": ["Drag", "Link"], "describe.material": ["Damping", "Friction", "Material", "Section"],
        "describe.reference": ["Reference"], "describe.rigid_body": ["RigidBody"], "describe.rigidity": ["Rigidity"],
        "describe.run_settings": ["RunSettings"], "describe.scene": ["Scene"], "describe.scene_file": ["load_scene"],
        "describe.sensor": ["Sensor"], "describe.shaping": ["InputShaper"], "diagnosis.comparison": ["compare"],
        "diagnosis.trajectories": ["compare_trajectories"], "dynamics.accelerations": ["forward_dynamics"],
        "dynamics.derivatives": ["forward_dynamics_derivatives", "inverse_dynamics_derivatives"],
        "dynamics.conserved": ["energy", "momentum"], "dynamics.equilibrium": ["solve_static"],
        "dynamics.forces": ["drag_torque"], "dynamics.placement": ["frames", "jacobian", "tip_position"],
        "dynamics.point_motion": ["point_motion"],
        "dynamics.terms": [
            "bias_torque", "elastic_torque", "friction_torque", "gravity_torque", "inverse_dynamics", "mass_matrix",
        ],
        "dynamics.vibration.linear": ["linearize", "linearize_many"],
        "dynamics.vibration.modal": ["modes", "natural_frequencies"], "dynamics.vibration.stability": ["stable_step"],
        "formats": ["to_mjcf", "to_sdf", "to_urdf"], "formats.code": ["to_c", "to_casadi", "to_fmu"],
        "identification.fit": ["fit"], "motion.batch": ["simulate_many"],
        "motion.inputs.initial_state": ["initial_state"], "motion.loop.loop": ["loop"],
        "motion.sensitivity": ["sensitivities"], "motion.simulate": ["Problem", "simulate"],
        "motion.simulator": ["Simulator"], "motion.simulator_batch": ["SimulatorBatch"],
        "motion.inversion": ["invert"], "motion.run_gradient": ["run_gradient"],
        "results.trajectory": ["Trajectory"], "robots.flexible": ["FlexibleLink"],
        "robots.importing": ["import_urdf"], "scene_report.report": ["report"], "sweeps.plan": ["Sweep"],
        "sweeps.run": ["sweep"],
    }  # fmt: skip
    modules = ("details", "fits", "small_motion", "strength")
    if name in modules:
        return importlib.import_module(f"flexlink.{name}")
    for module, names in places.items():
        if name in names:
            return globals().setdefault(name, getattr(importlib.import_module(f"flexlink.{module}"), name))
    if found := old_name(f"flexlink.{name}"):
        return found
    where = ""
    if not name.startswith("_") and importlib.util.find_spec(f"flexlink.{name}") is None:  # a module is also asked for
        moved = [m for m in modules if name in importlib.import_module(f"flexlink.{m}").__all__]
        elsewhere = {"crba": "mass_matrix", "rnea": "inverse_dynamics", "aba": "forward_dynamics", "load": "load_scene"}
        near = did_you_mean(elsewhere.get(name.partition("_")[0], name), __all__)
        near = "; a run plots itself, run.plot()" if name == "plot" else near
        where = f"; it is flexlink.{moved[0]}.{name}" if moved else near
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{where}")


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
