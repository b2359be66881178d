"""PyElastica's discrete Cosserat rods with explicit steps; only its steps are timed.

A rod of radius r stretches and shears with EA = 4 EI / r² = s EI / L², so one setting s replaces the section: a large
one is nearly inextensible, but its waves need short steps. Joints are springs as stiff as an element. Bending springs
are between the centres of elements, so the half elements at a support or a rigid joint would not bend: the spring next
to a support is softened by their share, and that of a rigid joint represents them.
"""

from __future__ import annotations

import time
from typing import Any

import elastica as ea
import numpy as np

from flexlink.common.types import Array
from validation.formulations.task import Outcome, Rod, Setting, Task


class _Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Connections):  # type: ignore[misc]
    """A system of rods."""


def run(task: Task, _element: str, setting: Setting) -> Outcome:
    """Run with steps that divide the time between samples."""
    _advance(*_arm(task, setting), task, setting["step"], 1)  # compiles
    simulator, rods = _arm(task, setting)
    begun = time.thread_time()
    tip = _advance(simulator, rods, task, setting["step"], len(task.times) - 1)
    seconds = time.thread_time() - begun
    count = round(setting["elements"])
    return Outcome(tip, seconds, len(rods) * (3 * (count + 1) + 3 * count))


def _advance(simulator: Any, rods: list[Any], task: Task, step: float, samples: int) -> Array:
    stepper, t = ea.PositionVerlet(), np.float64(0.0)
    many = round(task.scene.run.spacing / step)
    dt, found = np.float64(task.scene.run.spacing / many), [rods[-1].position_collection[:, -1].copy()]
    for _ in range(samples):
        for _ in range(many):
            t = stepper.step(simulator, t, dt)
        found.append(rods[-1].position_collection[:, -1].copy())
    return np.array(found)


def _arm(task: Task, setting: Setting) -> tuple[Any, list[Any]]:
    simulator, rods, place = _Simulator(), list[Any](), np.zeros(3)
    count, stiff = round(setting["elements"]), setting["stiffness"]
    for k, rod in enumerate(task.rods):
        made = _rod(rod, place, count, stiff)
        simulator.append(made)
        simulator.add_forcing_to(made).using(ea.GravityForces, acc_gravity=task.gravity)
        if rods:
            _join(simulator, rods[-1], made, rod, task.rods[k - 1], (count, stiff))
        rods.append(made)
        place = place + rod.length * rod.turn[:, 0]
    _add_masses(task, rods)
    if task.held != "hinge" or task.torque is not None:
        rods[0].bend_matrix[:, :, 0] *= 2 / 3  # over one and a half elements
    simulator.constrain(rods[0]).using(_Root, constrained_position_idx=(0,), constrained_director_idx=(0,), task=task)
    if task.torque is not None:
        simulator.add_forcing_to(rods[0]).using(_Torque, task.torque)
    simulator.finalize()
    return simulator, rods


def _rod(rod: Rod, start: Array, count: int, stiff: float) -> Any:
    """Make a rod whose first director is its joint's axis."""
    radius = 2.0 * rod.length / np.sqrt(stiff)
    area, second = np.pi * radius**2, np.pi * radius**4 / 4
    young = rod.bending[1] / second
    shear = rod.twist / (2 * second) if rod.twist > 1e-3 * rod.bending[1] else young / 2
    return ea.CosseratRod.straight_rod(
        count, start, rod.turn[:, 0], rod.turn[:, 2], rod.length, radius, rod.mass / area, youngs_modulus=young,
        shear_modulus=shear,
    )  # fmt: skip


def _add_masses(task: Task, rods: list[Any]) -> None:
    """Add the payload to the last node, and the rotor to the first element."""
    rods[-1].mass[-1] += task.payload
    rods[0].mass_second_moment_of_inertia[0, 0, 0] += task.rotor
    rods[0].inv_mass_second_moment_of_inertia[0, 0, 0] = 1 / rods[0].mass_second_moment_of_inertia[0, 0, 0]


def _join(simulator: Any, one: Any, two: Any, rod: Rod, before: Rod, size: tuple[int, float]) -> None:
    """Join two rods by springs."""
    count, stiff = size
    edge = rod.length / count
    k = stiff * rod.bending[1] / rod.length**2 / edge
    joint = simulator.connect(first_rod=one, second_rod=two, first_connect_idx=-1, second_connect_idx=0)
    if rod.hinged:
        joint.using(ea.FreeJoint, k=k, nu=0.0)
        return
    directors = [np.array([turn[:, 2], -turn[:, 1], turn[:, 0]]) for turn in (before.turn, rod.turn)]
    rest = directors[0] @ directors[1].T
    joint.using(ea.FixedJoint, k=k, nu=0.0, kt=rod.bending[1] / edge, nut=0.0, rest_rotation_matrix=rest)


class _Root(ea.ConstraintBase):  # type: ignore[misc]
    """The start of the arm: a free joint, a moved one, or a clamp."""

    def __init__(self, *fixed: Any, task: Task, **rest: Any) -> None:
        super().__init__(**rest)
        self.task, self.place, self.directors = task, fixed[0].copy(), fixed[1].copy()

    def constrain_values(self, system: Any, time: Any) -> None:
        """Set the first node's position and, without a free joint, the first element's directors."""
        system.position_collection[:, 0] = self.place
        if self.task.held == "clamped":
            system.director_collection[:, :, 0] = self.directors
        elif self.task.angle is not None:
            angle = self.task.angle(float(time))[0]
            along, across = np.cos(angle), np.sin(angle)
            turn = self.task.axes @ np.array([[along, -across, 0.0], [across, along, 0.0], [0.0, 0.0, 1.0]])
            system.director_collection[:, :, 0] = [turn[:, 2], -turn[:, 1], turn[:, 0]]

    def constrain_rates(self, system: Any, time: Any) -> None:
        """Set the rates of the same."""
        system.velocity_collection[:, 0] = 0.0
        if self.task.held != "hinge":
            rate = self.task.angle(float(time))[1] if self.task.angle is not None else 0.0
            system.omega_collection[:, 0] = (rate, 0.0, 0.0)


class _Torque(ea.NoForces):  # type: ignore[misc]
    """A torque of the first joint."""

    def __init__(self, torque: Any) -> None:
        super().__init__()
        self.torque = torque

    def apply_torques(self, system: Any, time: Any = 0.0) -> None:
        """Add the torque to the first element, about its first director."""
        system.external_torques[0, 0] += self.torque(float(time))
