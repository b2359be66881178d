"""Rough dimensions and masses of an arm, relative to which loads, positions and rotors are checked."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexlink.describe.link import Link
from flexlink.describe.scene import Scene


class Situation(NamedTuple):
    """Rough dimensions and masses of an arm that is stretched out."""

    spans: tuple[float, ...]  # from each link's joint to the next joint [m]
    masses: tuple[float, ...]  # of each link, including hub and end [kg]
    payload: float  # kg
    gravity: float  # m/s²

    @property
    def reach(self) -> float:
        """Sum of all spans [m]."""
        return sum(self.spans)

    @property
    def pull(self) -> float:
        """Gravity, or at least a typical acceleration during handling [m/s²]."""
        # 0.3 m/s²: typical acceleration during handling, which is the load if there is no gravity, as in space
        return max(self.gravity, 0.3)

    def moment(self, k: int) -> float:
        """Moment about the joint of link k (from 0) due to the weight, or handling force, of its subtree [N m]."""
        return self.pull * self._first_moment(k)

    def weight_moment(self, k: int) -> float:
        """Moment about the joint of link k (from 0) due to the subtree's weight on Earth [N m]."""
        return 9.81 * self._first_moment(k)

    def force(self, k: int) -> float:
        """Weight, or handling force, of link k (from 0) and its subtree, along the axis of its joint [N]."""
        return self.pull * self.mass(k)

    def mass(self, k: int = 0) -> float:
        """Mass of link k (from 0) and its subtree [kg]."""
        return sum(self.masses[k:]) + self.payload

    def inertia(self, k: int = 0) -> float:
        """Inertia of link k (from 0) and its subtree about its joint [kg m²]."""
        return self._first_moment(k) * max(sum(self.spans[k:]), 1e-3)

    def _first_moment(self, k: int) -> float:
        first, at = 0.0, 0.0
        for span, mass in zip(self.spans[k:], self.masses[k:], strict=True):
            first += mass * (at + span / 2)
            at += span
        return first + self.payload * at


def situation_of(scene: Scene) -> Situation:
    """Return the rough dimensions and masses of a scene's arm."""
    links = scene.arm.links
    masses = []
    for link in links:
        own = link.hub.mass + link.end.mass
        if link.section is not None and link.material is not None:
            area = scene.arm.sections[link.section].properties.area
            own += scene.arm.materials[link.material].density * area * link.beam.length
        if link.rigidity is not None:
            rows = scene.arm.rigidities[link.rigidity].rows
            own += float(np.trapezoid(rows.masses[0], rows.x))
        masses.append(own)
    beyond = [*(math.hypot(*after.mount.xyz) for after in links[1:]), 0.0]
    spans = tuple(span(link) + more for link, more in zip(links, beyond, strict=True))
    return Situation(spans, tuple(masses), scene.arm.tip.mass, math.hypot(*scene.gravity))


def span(link: Link) -> float:
    """Distance from a link's joint to its end [m]."""
    return math.dist((0.0, 0.0, 0.0), link.stop)
