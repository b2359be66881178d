"""flexlink as a solver of cosseratbench (0.3), found by its entry point `cosseratbench.solvers`.

A rod that is clamped or pinned at its start and free at its end is one link that bends, shears and stretches, with as
many hinges as the benchmark asks for elements. Coordinates are local, x along the rod: gravity and loads are turned
into them, positions and directors back. Other rods, contact, and driven ends raise NotImplementedError, as the
benchmark expects.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from cosseratbench.scenario import End, EndCondition, Rod, Scenario
from cosseratbench.solver import Capability
from cosseratbench.trajectory import Trajectory

import flexlink as fl
from flexlink.chain.builder import Piece
from flexlink.chain.coordinates import Kind
from flexlink.chain.lumping import pieces
from flexlink.common.types import Array
from flexlink.describe.hinges import hinges_of
from flexlink.dynamics.placement import Frames

TOLERANCE = 1e-6  # tolerance of a run, relative to the rod's length
FLAT = 1e-9  # largest distance from a plane, relative to the length, at which a rod moves in the plane


class FlexlinkSolver:
    """Solver of cosseratbench; see its `Solver` protocol."""

    name = "flexlink"
    backend_version = fl.__version__
    capabilities = frozenset({Capability.STRETCH, Capability.SHEAR})

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.tolerance = TOLERANCE * time_step_scale

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """Numerical settings of a run, shown beside its results."""
        return {"rule": rule_of(n_elements), "hinges": n_elements, "relative tolerance": self.tolerance}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Simulate the scenario, or solve its equilibrium if it is quasi-static.

        Parameters
        ----------
        scenario
            One rod without contact.
        n_elements
            Number of hinges along the rod, and of the elements in the result.
        n_frames
            Number of frames, evenly spaced from 0 to the scenario's duration; for an equilibrium, frames after the
            first are equal.

        Raises
        ------
        NotImplementedError
            The scenario has contact, several rods, or a rod that is not held at its start only.
        """
        rod = _only_rod(scenario)
        axes = _axes(rod, scenario)
        scene = _scene(rod, scenario, axes, n_elements, n_frames, self.tolerance)
        chain, times = fl.lump(scene), np.linspace(0.0, scenario.duration, n_frames)
        q = _start(rod, scene, chain, axes)
        if scenario.quasi_static:
            rest = fl.solve_static(chain, tip_wrench=scene.tip_wrench)
            angles = np.array([q] + [rest.q] * (n_frames - 1))
        else:
            angles = fl.simulate(scene, q0=q).q
        placed, parts = fl.frames(chain, angles), pieces(scene)
        nodes = np.linspace(0.0, 1.0, n_elements + 1)
        positions = [_on(parts, placed, rod.length, x)[0] for x in nodes.tolist()]
        turns = [_on(parts, placed, rod.length, x)[1] for x in ((nodes[1:] + nodes[:-1]) / 2).tolist()]
        own = rod.directors(n_elements)  # of the elements between the nodes, in the world frame
        directors = [turn @ turn[0].T @ axes @ first for turn, first in zip(turns, own, strict=True)]
        start = np.asarray(rod.centerline[0])
        return Trajectory(times, (start + np.stack(positions, axis=1) @ axes,), (np.stack(directors, axis=1) @ axes,))


def rule_of(elements: int) -> str:
    """Lumping rule with this number of hinges: `gauss` needs an even number."""
    return "legendre" if elements % 2 else "gauss"


def _only_rod(scenario: Scenario) -> Rod:
    """The rod of a scenario that flexlink can simulate."""
    if len(scenario.rods) != 1 or scenario.obstacles or scenario.self_contact:
        raise NotImplementedError("flexlink has no contact: one rod that cannot touch itself or obstacles")
    (rod,) = scenario.rods
    held = rod.start in {EndCondition.CLAMPED, EndCondition.PINNED} and rod.end is EndCondition.FREE
    if not held or rod.start_motion is not None:
        raise NotImplementedError("flexlink has open chains: a rod held at its start only, at rest")
    if any(load.at is not End.END for load in rod.loads):
        raise NotImplementedError("loads at the held end have no effect")
    return rod


def _force(rod: Rod) -> Array:
    """Sum of the loads at the free end [N], world frame."""
    return np.sum([load.force for load in rod.loads], axis=0) if rod.loads else np.zeros(3)


def _axes(rod: Rod, scenario: Scenario) -> Array:
    """Local axes in rows, (3, 3): x along the rod, and z normal to the plane in which it moves."""
    shape = np.asarray(rod.centerline) - rod.centerline[0]
    x = shape[-1] / np.linalg.norm(shape[-1])
    directions = [shape / rod.length, *(_unit(each)[None] for each in (np.array(scenario.gravity), _force(rod)))]
    across = np.vstack(directions)
    across = across - np.outer(across @ x, x)
    _, sizes, rows = np.linalg.svd(across)
    y = rows[0] if sizes[0] > FLAT else _unit(np.cross(rod.normal, x))
    if sizes[1] > FLAT:
        raise NotImplementedError("a rod that moves out of one plane")
    return np.array([x, y, np.cross(x, y)])


def _unit(v: Array) -> Array:
    """v / |v|, or zero."""
    size = np.linalg.norm(v)
    return np.asarray(v / size if size else v)


def _scene(rod: Rod, scenario: Scenario, axes: Array, hinges: int, frames: int, tolerance: float) -> fl.Scene:
    """The rod as a link, in local axes."""
    E, G = rod.material.youngs_modulus, rod.material.shear_modulus
    clamped = rod.start is EndCondition.CLAMPED
    link = fl.Link(
        name="rod", joint=fl.Joint(locked=clamped), length=rod.length, flex="z", segments=hinges + 1,
        lumping=rule_of(hinges), shear=True, stretch=True, material="rod", section="rod",
    )  # fmt: skip
    material = fl.Material(young=E, poisson=E / (2 * G) - 1, density=rod.material.density)
    section = fl.Section(shape="circle", diameter=2 * rod.radius)
    gravity, force = (tuple((axes @ each).tolist()) for each in (scenario.gravity, _force(rod)))
    duration = scenario.duration
    return fl.Scene(
        name="rod", arm=fl.Arm(links=(link,), materials={"rod": material}, sections={"rod": section}),
        gravity=gravity, wrench=fl.Wrench(force=force), initial=fl.InitialState(joint_deg=(0.0,)),
        run=fl.RunSettings(tolerance=tolerance * rod.length, duration=duration, sample=duration / (frames - 1)),
    )  # fmt: skip


def _start(rod: Rod, scene: fl.Scene, chain: fl.Chain, axes: Array) -> Array:
    """Coordinates (n,) of the rod's initial shape: angles between segments, and the stretch of the rod at stations."""
    edges = np.array([piece.part[0] for piece in pieces(scene)] + [1.0])
    chords = np.diff(_shape(rod, edges) @ axes.T, axis=0)
    angles = np.arctan2(chords[:, 1], chords[:, 0])
    ((nodes, weights),) = hinges_of(scene.arm)
    near = 1e-4  # half the length, relative to the rod's, over which the strain at a station is measured
    around = [_shape(rod, np.clip(nodes + side, 0.0, 1.0)) for side in (-near, near)]
    strain = np.linalg.norm(around[1] - around[0], axis=1) / (2 * near * rod.length) - 1
    q = np.zeros(chain.n)
    for k, at in enumerate(chain.coordinates):
        if at.kind is Kind.JOINT:
            q[k] = angles[0]
        elif at.kind is Kind.HINGE:
            q[k] = angles[at.segment] - angles[at.segment - 1]
        elif at == Kind.STRAIN.at(at.link, at.segment):
            q[k] = strain[at.segment - 1] * weights[at.segment - 1] * rod.length
    return q


def _shape(rod: Rod, x: Array) -> Array:
    """Initial positions of the material points x, from 0 to 1 along the unstretched rod, relative to its start [m]."""
    points = np.asarray(rod.centerline)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    rest = np.append(0.0, np.cumsum(lengths)) if rod.rest_arc_length is None else np.asarray(rod.rest_arc_length)
    return np.transpose([np.interp(x * rest[-1], rest, column) for column in (points - points[0]).T])


def _on(parts: list[Piece], placed: Frames, length: float, x: float) -> tuple[Array, Array]:
    """Position (times, 3) [m] of the point at x, from 0 to 1 along the rod, and rotation of its segment."""
    piece = next(each for each in reversed(parts) if each.part[0] <= x)
    if not piece.body:  # the held segment of a clamped rod
        count = len(placed.points)
        return np.tile([x * length, 0.0, 0.0], (count, 1)), np.tile(np.eye(3), (count, 1, 1))
    R, p = placed.rotations[:, piece.body - 1], placed.points[:, piece.body - 1]
    along = np.array([(x - piece.part[0]) * length, 0.0, 0.0])
    return p + R @ (piece.place.p + along), R
