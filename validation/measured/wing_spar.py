"""A wing's spar bent to two fifths of its span by tip masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.placement import tip_position
from validation.measured.readings import Derived, Reading
from validation.measured.second_way import deviation, roughness
from validation.measured.uncertainty import standard
from validation.reference_values import look_up

DATA = "measured/wing_spar"
READ_WITHIN = 0.2  # reading error, percent of the span, 1 mm; not stated by the source


def readings() -> dict[str, Reading]:
    """Deflection of the tip [% of the span], relative to its position without a mass."""
    found = {}
    for mass, value in zip(look_up(DATA, "tip_mass_kg"), look_up(DATA, "tip_deflection_percent_of_span"), strict=True):
        if mass:
            found[f"{mass:g} kg"] = Reading(-value, standard(READ_WITHIN), "% of the span", "deflection")
    return found


def u_again(predicted: Mapping[str, float]) -> dict[str, float]:
    """u_D a second way: scatter of D − S about a parabola in the mass, with the zero reading, in units of u_D.

    Without the zero reading, the scatter is a third of this: the readings under a mass are smooth, but do not continue
    to the reading without a mass.
    """
    found = readings()
    u = next(iter(found.values())).u
    masses = [0.0, *(float(name.removesuffix(" kg")) for name in found)]
    off = [0.0, *(each.value - predicted[name] for name, each in found.items())]
    scale = deviation([roughness(off, [u] * len(off), masses, degree=2)], degree=2)
    return {name: each.u * scale for name, each in found.items()}


def derived() -> Iterator[Derived]:
    """No derived quantities."""
    return iter(())


def predicted(scene: Scene) -> dict[str, float]:
    """Tip deflections of the chain."""
    chain = lump(scene)
    span = float(np.linalg.norm(tip_position(chain, np.zeros(chain.n))))
    weight = scene.gravity[2]

    def height(mass: float) -> float:
        return float(tip_position(chain, solve_static(chain, tip_wrench=[0, 0, mass * weight, 0, 0, 0]).q)[2])

    return {f"{m:g} kg": 100 * (height(0.0) - height(m)) / span for m in look_up(DATA, "tip_mass_kg") if m}
