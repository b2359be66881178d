"""Pazy wing: displacement and twist of the tip under a mass, with and without the wing's skin, up to half the span.

The mass hangs at the middle of the chord (bending) or behind the trailing edge (torsion). The beam has the published
EI, GJ and mass of each element; its axis is at 44 % of the chord, the displacement is that of the middle of the chord.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.placement import frames
from validation.case import scene_file
from validation.measured.readings import Reading
from validation.measured.uncertainty import standard
from validation.reference_values import look_up

DATA = "measured/pazy_wing"
SCENE = "pazy_wing"
AXIS, MIDDLE, EDGE = 0.44, 0.5, 1.0  # of the chord, from the leading edge
RESOLVED = 0.001  # displacement of an edge of the chord [m]: twists without skin are multiples of 1 mm over the chord


class Loading(NamedTuple):
    """A test: skin, place of the mass, its lever behind the axis [m], masses [kg], displacements [%], twists [deg]."""

    skin: str
    test: str
    lever: float
    masses: list[float]
    displacements: list[float]
    twists: list[float]

    def name(self, what: str, mass: float) -> str:
        """Name of a quantity."""
        return f"{what}, {self.skin}, {self.test}, {mass:g} kg"


def loadings() -> Iterator[Loading]:
    """The four tests; displacements and twists are relative to no mass, down and nose up positive."""
    chord = look_up(DATA, "chord_m")
    for skin in ("without skin", "with skin"):
        for test, place in (("bending", MIDDLE), ("torsion", EDGE)):
            of = look_up(DATA, skin.replace(" ", "_"), test)
            lever = (place - AXIS) * chord + of.get("mass_behind_trailing_edge_m", 0.0)
            down = [-each for each in of["displacement_percent"]]
            yield Loading(skin, test, lever, of["mass_kg"], down, of.get("twist_deg", []))


def readings() -> dict[str, Reading]:
    """The 48 displacements [% of the span] and 23 twists [deg] under a mass."""
    u_twist = math.degrees(math.hypot(1.0, 1.0) * standard(RESOLVED / 2) / look_up(DATA, "chord_m"))  # of two edges
    found = {}
    for each in loadings():
        for k, mass in enumerate(each.masses[1:], 1):
            u = reproducibility(each.skin)
            found[each.name("displacement", mass)] = Reading(each.displacements[k], u, "% of the span", "displacement")
            if each.twists:
                found[each.name("twist", mass)] = Reading(each.twists[k], u_twist, "deg", "twist")
    return found


@functools.cache
def reproducibility(skin: str) -> float:
    """Standard uncertainty of a displacement [% of the span]: both tests measured the same wing under the same masses.

    Their difference, minus the computed one, is the error of two tests. A reading error is not stated by the source.
    """
    bending, torsion = (each for each in loadings() if each.skin == skin)
    computed = predicted(load_scene(scene_file(SCENE)))
    off = [
        torsion.displacements[torsion.masses.index(mass)] - bending.displacements[k]
        - (computed[torsion.name("displacement", mass)] - computed[bending.name("displacement", mass)])
        for k, mass in enumerate(bending.masses)
        if mass and mass in torsion.masses
    ]  # fmt: skip
    return math.sqrt(float(np.mean(np.square(off))) / 2)


def columns(skin: str) -> dict[str, tuple[float, ...]]:
    """Columns of a rigidity: constant along each element, with the mass of a node spread over its half elements."""
    nodes, of = look_up(DATA, "nodes_m"), look_up(DATA, skin.replace(" ", "_"))
    middles = [(a + b) / 2 for a, b in itertools.pairwise(nodes)]
    lengths = np.diff([nodes[0], *middles, nodes[-1]])
    density = (np.array(of["node_mass_kg"]) / lengths).tolist()
    rho = [each for a, b in itertools.pairwise(density) for each in (a, a, b, b)]
    found = {"x": [x for a, m, b in zip(nodes, middles, nodes[1:], strict=False) for x in (a, m, m, b)], "rho_a": rho}
    for name, key in (("ei_y", "EI_flap_Nm2"), ("ei_z", "EI_lag_Nm2"), ("gj", "GJ_Nm2")):
        found[name] = np.repeat(of[key], 4).tolist()
    found["rho_i_z"] = [each * look_up(DATA, "chord_m") ** 2 / 12 for each in rho]
    return {name: tuple(column) for name, column in found.items()}


def predicted(scene: Scene) -> dict[str, float]:
    """Displacements and twists of the chain."""
    span, found = look_up(DATA, "span_m"), {}
    for each in loadings():
        wing = scene.varied({f"rigidity.wing.{name}": column for name, column in columns(each.skin).items()})
        rest, *loaded = (tip(wing, mass, each.lever) for mass in each.masses)
        for mass, (down, twist) in zip(each.masses[1:], loaded, strict=True):
            found[each.name("displacement", mass)] = 100 * (down - rest[0]) / span
            if each.twists:
                found[each.name("twist", mass)] = twist - rest[1]
    return found


def tip(wing: Scene, mass: float, lever: float) -> tuple[float, float]:
    """Displacement down [m] of the middle of the tip's chord, and twist [deg], with a mass behind the axis."""
    chain = lump(wing.varied({"tip.mass": mass, "tip.center": [0.0, -lever, 0.0]}) if mass else wing)
    placed = frames(chain, np.array([np.zeros(chain.n), solve_static(chain).q]))
    backward = placed.rotations[1, -1] @ placed.rotations[0, -1].T @ [0.0, -1.0, 0.0]
    middle = placed.points[1, -1] - placed.points[0, -1] + (MIDDLE - AXIS) * look_up(DATA, "chord_m") * backward
    return -float(middle[2]), math.degrees(math.asin(-backward[2]))
