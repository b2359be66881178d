"""Links as rigid segments with springs at Gauss points, for any program that knows joints; numpy only.

A link has cells of equal length with two hinges each, at the nodes of Gauss's quadrature; a spring has the stiffness
EI / weight. A program supplies M, the torques and the place of the tip; statics, buckling and frequencies follow here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np

from flexarm_bench.case import Array, Cannot, Case, Link, Settings

HINGES = {"statics": 64, "buckling": 96, "frequencies": 96, "motion": 20}
"""Hinges of a link, unless the setting `hinges` gives another number; several links share them."""
LEAST_HINGES = 4
LOAD_STEPS, ITERATIONS, CHANGE = 3, 60, 1e-6
SMALL_STEP, SLOW = 1e-10, 0.1  # last step of Newton's method [rad]; ratio of steps above which its matrix is too old


@dataclass
class Joint:
    """A joint of a body: axis, spring and damper."""

    axis: tuple[float, float, float]
    stiffness: float = 0.0
    damping: float = 0.0
    armature: float = 0.0


@dataclass
class Body:
    """A rigid body at `place` in its parent, turned about z by `angle`; its joints act in their order at its origin."""

    place: Array
    angle: float
    joints: list[Joint]
    mass: float = 0.0
    moment: Array = field(default_factory=lambda: np.zeros(3))  # mass × centre
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))  # about the origin

    @property
    def centre(self) -> Array:
        """Centre of mass."""
        return self.moment / self.mass if self.mass else np.zeros(3)

    @property
    def central_inertia(self) -> Array:
        """Inertia about the centre of mass."""
        return self.inertia - self.mass * _square(self.centre)

    def add(self, mass: float, place: Array, turn: Array, inertia: Array) -> None:
        """Add a mass at a place, with its inertia about its centre in axes turned by a matrix."""
        self.mass += mass
        self.moment = self.moment + mass * place
        self.inertia = self.inertia + turn @ inertia @ turn.T + mass * _square(place)


@dataclass(frozen=True)
class HingeChain:
    """Bodies in a row; `held` are joints that do not move freely, `tip` is in the last body."""

    bodies: list[Body]
    tip: Array
    held: tuple[int, ...]

    @property
    def joints(self) -> list[Joint]:
        """All joints, in order."""
        return [joint for body in self.bodies for joint in body.joints]

    @property
    def free(self) -> list[int]:
        """Numbers of the joints that move freely."""
        return [k for k in range(len(self.joints)) if k not in self.held]


class Program(Protocol):
    """What a program computes for a chain of n joints; `follows` and loads are handled here."""

    def mass(self, q: Array) -> Array:
        """Mass matrix, shape (n, n)."""

    def bias(self, q: Array, v: Array) -> Array:
        """Torques of gravity and rates, without springs: M a + bias = joint torques."""

    def tip(self, q: Array) -> Array:
        """Place of the tip [m]."""

    def turn(self, q: Array) -> Array:
        """Rotation matrix of the last body."""

    def jacobian(self, q: Array) -> Array:
        """Rows: velocity of the tip and angular velocity in axes of the world, shape (6, n)."""


def chain_of(case: Case, hinges: int) -> HingeChain:
    """The arm of a case as a chain of rigid bodies.

    Raises
    ------
    Cannot
        The number of hinges is odd.
    """
    if hinges % 2 or hinges < 2:
        raise Cannot(f"hinges = {hinges}: expected an even number")
    bodies: list[Body] = []
    if any(case.spin):
        bodies.append(Body(np.zeros(3), 0.0, [Joint(tuple(np.array(case.spin) / np.linalg.norm(case.spin)))]))
    place, angle = np.zeros(3), 0.0  # of the next link in the last body
    for number, link in enumerate(case.links):
        angle += link.angle
        if link.joint == "free":
            bodies.append(Body(place, angle, [Joint((0.0, 0.0, 1.0), armature=link.hub_inertia)]))
            place, angle = np.zeros(3), 0.0
        elif not bodies:
            bodies.append(Body(place, angle, []))
            place, angle = np.zeros(3), 0.0
        place, angle = _add_link(bodies, link, hinges, place, angle, number)
    held = (0,) if any(case.spin) or case.motion else ()
    return HingeChain(bodies, place, held)


def _add_link(
    bodies: list[Body], link: Link, hinges: int, place: Array, angle: float, number: int
) -> tuple[Array, float]:
    """Append the segments of a link; return its end and direction in the last body."""
    cell = 2 * link.length / hinges
    nodes = [cell * (k + (1 + s / math.sqrt(3)) / 2) for k in range(hinges // 2) for s in (-1, 1)]
    if not any(math.isfinite(each) for each in (link.EI, link.EI_y, link.GJ)):
        nodes = []
    for k, (begin, end) in enumerate(itertools.pairwise([0.0, *nodes, link.length])):
        if k:
            bodies.append(Body(place, angle, _hinge(link, cell / 2, k + number)))
            place, angle = np.zeros(3), 0.0
        turn, size = _about_z(angle), end - begin
        mass = link.mass_per_length * size
        slender = mass * size**2 / 12 + link.rotary_inertia * size
        middle = place + turn @ np.array([size / 2, 0.0, 0.0])
        bodies[-1].add(mass, middle, turn, np.diag([link.polar_inertia * size, slender, slender]))
        place = place + turn @ np.array([size, 0.0, 0.0])
    bodies[-1].add(link.end_mass, place, np.eye(3), link.end_inertia * np.eye(3))
    return place, angle


def _hinge(link: Link, weight: float, number: int) -> list[Joint]:
    """Joints of a hinge; their order alternates, so that finite rotations have no error of the first order."""
    stiffnesses = ((link.GJ, 0), (link.EI_y, 1), (link.EI, 2))
    joints = [
        Joint(tuple(np.eye(3)[axis].tolist()), k / weight, link.loss_time * k / weight)
        for k, axis in stiffnesses
        if math.isfinite(k)
    ]
    return joints[:: 1 if number % 2 else -1]


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _square(r: Array) -> Array:
    """−(r×)², the inertia of a unit mass at r."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))


def solve(case: Case, chain: HingeChain, program: Program) -> Array:
    """Answer to a case of statics, buckling or frequencies."""
    return {"statics": _statics, "buckling": _buckling, "frequencies": _frequencies}[case.ask](case, chain, program)


def springs(chain: HingeChain) -> Array:
    """Stiffness of each joint."""
    return np.array([joint.stiffness for joint in chain.joints])


def _torques(case: Case, chain: HingeChain, program: Program, share: float, q: Array) -> Array:
    """Torques that the joints lack for equilibrium under a share of the tip's load."""
    load = np.array([*case.force, *case.moment]) * share
    if case.follows:
        turn = program.turn(q)
        load = np.concatenate([turn @ load[:3], turn @ load[3:]])
    return program.bias(q, np.zeros(len(q))) + springs(chain) * q - program.jacobian(q).T @ load


def _statics(case: Case, chain: HingeChain, program: Program) -> Array:
    q = np.zeros(len(chain.joints))
    straight = program.tip(q)
    for share in np.linspace(0, 1, LOAD_STEPS + 1)[1:]:
        left = partial(_torques, case, chain, program, share)
        slope, size = None, math.inf
        for _ in range(ITERATIONS):
            slope = _slope(left, q) if slope is None else slope
            step = np.linalg.solve(slope, -left(q))
            q, before, size = q + step, size, float(np.abs(step).max())
            if size < SMALL_STEP:
                break
            slope = None if math.isinf(before) or size > SLOW * before else slope
        else:
            raise ArithmeticError(f"no equilibrium under {share:.3g} of the load")
    return program.tip(q) - straight


def _buckling(case: Case, chain: HingeChain, program: Program) -> Array:
    rest = np.zeros(len(chain.joints))
    elastic = np.diag(springs(chain))
    load = _slope(partial(_torques, case, chain, program, 1.0), rest) - elastic
    inverse = np.linalg.eigvals(np.linalg.solve(elastic, -load))
    return np.array([1 / inverse.real[np.abs(inverse.imag) < 1e-9 * np.abs(inverse).max()].max()])


def _frequencies(case: Case, chain: HingeChain, program: Program) -> Array:
    rest, v = np.zeros(len(chain.joints)), np.zeros(len(chain.joints))
    v[list(chain.held)] = np.linalg.norm(case.spin)
    free = np.ix_(chain.free, chain.free)
    K = (np.diag(springs(chain)) + _slope(lambda q: program.bias(q, v), rest))[free]
    root = np.linalg.inv(np.linalg.cholesky(program.mass(rest)[free]))
    squares = np.linalg.eigvalsh(root @ (K + K.T) / 2 @ root.T)
    still = sum(link.joint == "free" for link in case.links) if not any(case.gravity) else 0
    return np.asarray(np.sqrt(squares[still : still + case.modes]))


def _slope(function: Callable[[Array], Array], q: Array) -> Array:
    """Derivative by central differences, shape (n, n)."""
    steps = CHANGE * np.eye(len(q))
    return np.array([(function(q + h) - function(q - h)) / (2 * CHANGE) for h in steps]).T


def hinges_of(case: Case, settings: Settings) -> int:
    """Hinges of a link, from the settings."""
    if "hinges" in settings:
        return int(settings["hinges"])
    several = len(case.links) > 1 and case.ask == "motion"  # links that fall on free joints hardly bend
    return LEAST_HINGES if several else HINGES[case.ask] // len(case.links) // 2 * 2
