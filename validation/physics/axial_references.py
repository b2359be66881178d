"""python -m validation.physics.axial_references: exact values of beams under axial load and of rods in large bending.

Writes `axial_load.json` and `bent_rods.json` of the benchmark package; takes two minutes.
"""

from __future__ import annotations

import time

import numpy as np
from mpmath import nstr

from validation.oracles import bent_rods, tensioned_beam
from validation.oracles.tensioned_beam import Beam
from validation.reference_values import store_reference

SOURCE = "python -m validation.physics.axial_references"
GRAVITIES = (1, 10, 100, 1000)  # ρA g L³ / EI
SPINS = (2, 6, 12)  # Ω L² √(ρA / EI)
FOLLOWERS = (1, 2, 5, 10)  # PL² / EI
FORCE, RIGIDITY = np.array([-2.0, 3.0, 2.5]), np.array([0.7, 1.0, 3.0])
MODES = 3
COARSER = {"method": "Radau", "rtol": 1e-11, "atol": 1e-13}
"""Another method and tolerance, to estimate the error of the rod that bends in space."""


def main() -> None:
    """Compute and store the references."""
    start = time.process_time()
    beams = {f"heavy, γ = {γ}": Beam(gravity=γ) for γ in GRAVITIES}
    beams["pendulum, γ = 100"] = Beam(gravity=100, hinged=True)
    for Ω in SPINS:
        beams |= {f"flap, Ω = {Ω}": Beam(spin=Ω), f"lag, Ω = {Ω}": Beam(spin=Ω, lag=True)}
    values = {name: [nstr(ω, 20) for ω in tensioned_beam.frequencies(beam, MODES)] for name, beam in beams.items()}
    values["rope, γ = 1"] = [nstr(ω, 20) for ω in tensioned_beam.rope(1, MODES)]
    store_reference(
        "axial_load",
        "Frequencies ω [rad/s] of beams with EI = ρA = L = 1 that hang (γ = ρA g L³/EI) or turn with a hub (Ω)",
        SOURCE, time.process_time() - start, digits_trusted=18, reference=values,
    )  # fmt: skip
    start = time.process_time()
    space = bent_rods.in_space(FORCE, RIGIDITY)
    apart = float(np.abs(space - bent_rods.in_space(FORCE, RIGIDITY, **COARSER)).max())
    tips = {str(P): [nstr(x, 18) for x in bent_rods.follower(P)] for P in FOLLOWERS}
    store_reference(
        "bent_rods",
        "Tips of clamped rods, L = 1: x, y, angle under a force across the tip that turns with it (PL²/EI);"
        " x, y, z under a dead force, GJ, EI_y, EI_z = 0.7, 1, 3",
        SOURCE, time.process_time() - start,
        reference={"follower": tips, "space": {
            "force": FORCE.tolist(), "rigidity": RIGIDITY.tolist(), "tip": space.tolist(), "two_methods_apart": apart,
        }},
    )  # fmt: skip


if __name__ == "__main__":
    main()
