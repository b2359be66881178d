"""Solvers of cosseratbench: a round rod, clamped, under a dead force on its tip, until it is at rest."""

from __future__ import annotations

import math
from importlib.metadata import entry_points

import numpy as np
from cosseratbench.scenario import EndCondition, Material, PointLoad, Rod, Scenario

from flexarm_bench.case import Answer, Cannot, Case, Settings

GROUP = "cosseratbench.solvers"
SOLVER, ELEMENTS = "mujoco", 40
SLENDER = 0.01  # radius of the rod / length
REST = 25.0  # duration × the slowest frequency; solvers damp the rod critically


def run(case: Case, settings: Settings) -> Answer:
    """Compute a case; settings: `rods`, the name of the solver, and `elements` of a rod."""
    if case.ask != "statics" or any(case.moment) or case.follows or len(case.links) > 1 or not case.planar:
        raise Cannot("a clamped rod under a dead force is all that its scenarios share with this bench")
    name, elements = str(settings.get("rods", SOLVER)), int(settings.get("elements", ELEMENTS))
    (link,) = case.links
    radius = SLENDER * link.length
    young = link.EI / (math.pi * radius**4 / 4)
    material = Material(young, young / 3, link.mass_per_length / (math.pi * radius**2))
    rod = Rod(
        ((0.0, 0.0, 0.0), (link.length, 0.0, 0.0)), radius, material,
        start=EndCondition.CLAMPED, loads=(PointLoad(case.force),),
    )  # fmt: skip
    slowest = 3.516 * math.sqrt(link.EI / link.mass_per_length) / link.length**2
    scenario = Scenario((rod,), REST / slowest, quasi_static=True, self_contact=False)
    for entry in entry_points(group=GROUP, name=name):
        tip = entry.load()().run(scenario, n_elements=elements, n_frames=2).positions[0][-1, -1]
        return Answer(np.asarray(tip) - [link.length, 0.0, 0.0], f"{name}, {elements} elements")
    raise Cannot(f"cosseratbench has no solver {name!r}")
