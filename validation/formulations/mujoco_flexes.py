"""MuJoCo's one-dimensional flexes, a chain of points with bending springs, in a plane; only its roll-out is timed.

Vertices are points with two slides. Edges are springs with EA = s EI / L². At a hub, a second vertex close to the first
gives the direction of the rod. A moved joint is a hub whose orientation is set before every step.
"""

from __future__ import annotations

import time

import mujoco
import mujoco.rollout
import numpy as np

from flexlink.common.types import Array
from flexlink.engines.mujoco import quiet
from validation.formulations.task import Outcome, Rod, Setting, Task

CLOSE = 1e-3  # distance of the hub's vertices, in lengths of an edge
LIGHT = 1e-9  # mass of the hub, relative to the rod's
SPRINGS, CONSTRAINTS = "springs", "constraints"
INTEGRATORS = {SPRINGS: "RK4", CONSTRAINTS: "discrete"}
"""Element → integrator: edges are springs, in explicit steps, or rigid by soft constraints, in implicit steps."""


def run(task: Task, element: str, setting: Setting) -> Outcome:
    """Roll out once, and read the tip from the points' coordinates."""
    many = round(task.scene.run.spacing / setting["step"])
    with quiet():
        model = mujoco.MjModel.from_xml_string(_text(task, element, setting, task.scene.run.spacing / many))
    steps = many * (len(task.times) - 1)
    start, spec, inputs = _inputs(task, model, steps)
    data = mujoco.MjData(model)
    with quiet():
        begun = time.thread_time()
        states, _ = mujoco.rollout.rollout(
            model, data, start[None], None if inputs is None else inputs[None], nstep=steps, control_spec=spec
        )
        seconds = time.thread_time() - begun
    moved = states[0, many - 1 :: many, model.nq - 1 : model.nq + 1]  # after the time; the last point's coordinates
    rest = np.sum([rod.length * rod.turn[:, 0] for rod in task.rods], axis=0)
    tip = rest + np.vstack([np.zeros((1, 2)), moved]) @ task.axes[:, :2].T
    return Outcome(np.asarray(tip), seconds, model.nv)


def _inputs(task: Task, model: mujoco.MjModel, steps: int) -> tuple[Array, int, Array | None]:
    """Initial state, kind of the inputs, and inputs in the middle or at the end of each step."""
    data, h = mujoco.MjData(model), model.opt.timestep
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, start, full)
    if task.torque is not None:
        torques = [task.torque((k + 0.5) * h) for k in range(steps)]
        return start, int(mujoco.mjtState.mjSTATE_CTRL), np.array(torques)[:, None]
    if task.angle is not None:
        half = 0.5 * np.array([task.angle((k + 0.5) * h)[0] for k in range(steps)])
        zero = np.zeros(steps)
        return start, int(mujoco.mjtState.mjSTATE_MOCAP_QUAT), np.array([np.cos(half), zero, zero, np.sin(half)]).T
    return start, int(mujoco.mjtState.mjSTATE_CTRL), None


def _text(task: Task, element: str, setting: Setting, step: float) -> str:
    """The MJCF of the arm, in the plane x, y."""
    arm = _Arm(task, element, setting)
    rigid = ""
    if element == CONSTRAINTS:
        soft = f'solref="{2 * step:.17g} 1" solimp="0.9999 0.9999 0.001"'
        rigid = "".join(f'<flex flex="rod{k}" {soft}/>' for k in range(len(task.rods)))
    gravity = _numbers((task.axes.T @ task.gravity)[:2])
    return (
        f'<mujoco><option timestep="{step:.17g}" gravity="{gravity}" integrator="{INTEGRATORS[element]}">'
        f'<flag contact="disable"/></option><worldbody>{arm.bodies()}</worldbody><deformable>{"".join(arm.flexes)}'
        f"</deformable><equality>{rigid}</equality>{arm.motor}</mujoco>"
    )


class _Arm:
    """Bodies of the vertices and flexes of the rods. The arm starts at the hub or, on a free joint, at the world."""

    def __init__(self, task: Task, element: str, setting: Setting) -> None:
        self.task, self.springs, self.setting = task, element == SPRINGS, setting
        self.hub = task.held != "hinge" or bool(task.rotor) or task.torque is not None
        self.masses, self.places = dict[str, float](), dict[str, Array]()
        self.flexes: list[str] = []
        begin, last = np.zeros(2), "hub" if self.hub else "world"
        for k, rod in enumerate(task.rods):
            last, begin = self._rod(k, rod, last, begin)
        self.masses[last] += task.payload
        self.motor = '<actuator><motor joint="hub"/></actuator>' if self.hub and task.held != "moved" else ""

    def _rod(self, k: int, rod: Rod, first: str, begin: Array) -> tuple[str, Array]:
        """Add a rod; return the body of its last vertex, and its place."""
        count = round(self.setting["elements"])
        edge, along = rod.length / count, (self.task.axes.T @ rod.turn[:, 0])[:2]
        names, vertices = [first, *(f"v{k}_{i}" for i in range(1, count + 1))], [_numbers(np.zeros(2))] * (count + 1)
        for i, name in enumerate(names):
            mass = rod.mass * edge * (0.5 if i in {0, count} else 1.0)
            self.masses[name] = self.masses.get(name, 0.0) + mass
            self.places[name] = begin + i * edge * along
        if k == 0 and self.hub:
            names, vertices = ["hub", *names], [_numbers(-CLOSE * edge * along), *vertices]
        radius = (4 * rod.bending[1] / np.pi) ** 0.25  # with E = 1 Pa: EI = E π r⁴ / 4
        edges = " ".join(f"{i} {i + 1}" for i in range(len(names) - 1))
        stiff = self.setting["stiffness"] * rod.bending[1] / rod.length**2 / edge if self.springs else 0.0
        stretch = f'<edge stiffness="{stiff:.17g}"/>' if self.springs else ""
        self.flexes.append(
            f'<flex name="rod{k}" dim="1" body="{" ".join(names)}" vertex="{" ".join(vertices)}" element="{edges}" '
            f'radius="{radius:.17g}">{stretch}<elasticity young="1" poisson="0"/>'
            '<contact selfcollide="none" contype="0" conaffinity="0"/></flex>'
        )
        return names[-1], begin + rod.length * along

    def bodies(self) -> str:
        """The hub and the points, in the order of the vertices."""
        slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0"))
        points = (
            f'<body name="{name}" pos="{_numbers(self.places[name])}">{_inertial(mass)}{slides}</body>'
            for name, mass in self.masses.items()
            if name not in {"world", "hub"}
        )
        return self._hub() + "".join(points)

    def _hub(self) -> str:
        if not self.hub:
            return ""
        if self.task.held == "moved":
            return '<body name="hub" mocap="true"/>'
        light = _inertial(LIGHT * self.task.rods[0].mass * self.task.length)
        hinge = f'<joint name="hub" type="hinge" axis="0 0 1" armature="{self.task.rotor:.17g}"/>'
        return f'<body name="hub">{light}{hinge}</body>'


def _inertial(mass: float) -> str:
    return f'<inertial pos="0 0 0" mass="{mass:.17g}" diaginertia="{mass:.17g} {mass:.17g} {mass:.17g}"/>'


def _numbers(place: Array) -> str:
    return f"{place[0]:.17g} {place[1]:.17g} 0"
