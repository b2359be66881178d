"""Energy drift of runs without friction, compared with a prediction from the method's damping of the excited modes.

A straight arm released under gravity starts away from its static equilibrium: each elastic mode m receives the energy
E_m = ½ (φ_m·T_G)² / ω_m², with φ_m its shape and φ_mᵀ M φ_m = 1. A Runge-Kutta method with the stability function R
multiplies the mode's amplitude by |R(iω_m h)| in each step; N steps lose Σ_m E_m (1 − |R(iω_m h)|^2N). Rounding adds
at most eps · kinetic energy per step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import linalg

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import gravity_torque, mass_matrix
from flexlink.dynamics.vibration.stability_function import stability_function
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series, table


def run(case: Case, steps: dict[str, tuple[float, ...]]) -> Iterator[Measured | Series]:
    """Yield measured and predicted drift of every method and step; `steps` [s] by method."""
    for scene in case.load_scenes():
        ω, E = released_modes(scene)
        points = []
        for method, step in ((m, h) for m, sizes in steps.items() for h in sizes):
            energy = simulate(scene, method=method, step=step).energy
            drift = float(np.abs(energy.total - np.asarray(energy.total)[0]).max())
            exchanged = float(np.abs(np.diff(energy.gravity)).sum())
            count = round(scene.run.duration / step)
            loss = modal_loss(method, ω * step, E, count)
            rounding = count * EPS * float(np.max(energy.kinetic))
            facts: Facts = {"method": method, "step": step}
            note = f"Predicted {loss:.2g} J, rounding at most {rounding:.2g} J."
            yield Measured("drift", drift, scene.name, varied=facts, scale=loss + rounding, note=note)
            yield Measured("drift / energy exchanged", drift / exchanged, scene.name, varied=facts)
            points.append((method, step, drift, loss + rounding))
        columns = table(("method", "step [s]", "measured", "predicted"), points)
        yield Series(
            "drift", f"{scene.name}: energy drift in {scene.run.duration:g} s", columns, "step [s]",
            "step [s]", "energy drift [J]", "log", "log", group="method", scene=scene.name,
        )  # fmt: skip


def released_modes(scene: Scene) -> tuple[Array, Array]:
    """Frequencies ω [rad/s] of the elastic modes at the initial state, and the energy E [J] of each when released."""
    chain = lump(scene)
    q, _ = initial_state(scene, chain)
    squares, Φ = linalg.eigh(chain.matrix("stiffness"), mass_matrix(chain, q))  # Φᵀ M Φ = 1
    force = Φ.T @ (gravity_torque(chain, q) + chain.times("stiffness", q - chain.rest))
    elastic = squares > 1e-9 * squares.max()  # the other modes are rigid: their ω² is only rounding error
    ω: Array = np.sqrt(squares[elastic])
    return ω, 0.5 * force[elastic] ** 2 / ω**2


def modal_loss(method: str, ωh: Array, E: Array, steps: int) -> float:
    """Magnitude of the energy [J] that `method` removes from or adds to the modes in `steps` steps."""
    R = np.abs(stability_function(methods.method(method), 1j * ωh))
    return float((E * np.abs(np.expm1(2 * steps * np.log(R)))).sum())
