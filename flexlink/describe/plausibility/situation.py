"""An arm in round numbers, by which its loads, places and rotors are judged."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexlink.describe.link import Link
from flexlink.describe.scene import Scene


class Situation(NamedTuple):
    """An arm in round numbers, stretched out straight."""

    spans: tuple[float, ...]  # of each link, to the next joint [m]
    masses: tuple[float, ...]  # of each link, hub and end included [kg]
    payload: float  # kg
    gravity: float  # m/s²

    @property
    def reach(self) -> float:
        """Sum of all spans [m]."""
        return sum(self.spans)

    @property
    def pull(self) -> float:
        """Gravity, or the acceleration of handling [m/s²]."""
        # acceleration [m/s²] that an arm bears where nothing weighs, such as in space
        return max(self.gravity, 0.3)

    def moment(self, k: int) -> float:
        """Of the weight, or handling, of all from link k (from 0) on, about its joint [N m]."""
        return self.pull * self._first_moment(k)

    def weight_moment(self, k: int) -> float:
        """Of the weight that all from link k (from 0) on has on Earth, about its joint [N m]."""
        return 9.81 * self._first_moment(k)

    def force(self, k: int) -> float:
        """Of the weight, or handling, of all from link k (from 0) on, along its joint [N]."""
        return self.pull * self.mass(k)

    def mass(self, k: int = 0) -> float:
        """Of all from link k (from 0) on [kg]."""
        return sum(self.masses[k:]) + self.payload

    def inertia(self, k: int = 0) -> float:
        """Of all from link k (from 0) on, about its joint [kg m²]."""
        return self._first_moment(k) * max(sum(self.spans[k:]), 1e-3)

    def _first_moment(self, k: int) -> float:
        first, at = 0.0, 0.0
        for span, mass in zip(self.spans[k:], self.masses[k:], strict=True):
            first += mass * (at + span / 2)
            at += span
        return first + self.payload * at


def situation_of(scene: Scene) -> Situation:
    """The arm of a scene."""
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
    """From a link's joint to its end [m]."""
    return math.dist((0.0, 0.0, 0.0), link.stop)
