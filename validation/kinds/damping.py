"""Kelvin-Voigt's price: an explicit method's largest step against the damping ratio of the fastest mode, and its cap.

With d = η k every mode has ζ = η ω/2. A mode with ζ > 1 creeps with rates λ = −ω (ζ ± √(ζ² − 1)), of which the method
must follow the faster: h ω = r / (ζ + √(ζ² − 1)), r the method's limit on the negative real axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import linalg

import flexlink as fl
from flexlink.engines.mujoco import MujocoEngine
from flexlink.scene import Scene
from flexlink.spec import Positive, Spec
from flexlink.stability import largest_frequency
from validation.benchmarks.parity import springs
from validation.benchmarks.variant import Rule, Variant
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series


class Settings(Spec, frozen=True):
    """Damping ratios of the fastest mode; the method, with its published limit on the real axis; and a capped law.

    `target` is the damping ratio of the slowest mode with which the capped law is asked for, `cap` its bound.
    """

    chain: Rule
    ratios: tuple[Positive, ...]
    method: str
    real_limit: Positive
    target: Positive
    cap: Positive


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Stable steps with Kelvin-Voigt's law, then the same target with a cap."""
    free = _scene(case, settings, {})
    ω = largest_frequency(free.chain(), np.zeros(free.chain().n))
    steps = {}
    for ζ in settings.ratios:
        h = _step(_scene(case, settings, {"material": {"unit": {"loss_time": 2 * ζ / ω}}}), settings.method) * ω
        steps[ζ] = h
        facts: Facts = {"method": settings.method, "damping ratio": ζ}
        yield Measured("stable step × ω_max", h, free.name, varied=facts)
        if ζ > 1:
            theory = settings.real_limit / (ζ + math.sqrt(ζ * ζ - 1))
            note = f"Theory {theory:.4g}."
            yield Measured("stable step of a creeping mode", abs(h / theory - 1), free.name, varied=facts, note=note)
    columns = {"ratio [1]": np.array(list(steps)), "h ω_max [1]": np.array(list(steps.values()))}
    title = f"{settings.method}: largest stable step against Kelvin-Voigt damping, {settings.chain}"
    label = "damping ratio of the fastest mode [1]"
    yield Series("steps", title, columns, "ratio [1]", label, "largest stable step × ω_max [1]", "log", "log")
    yield from _capped(case, settings, ω)


def _capped(case: Case, settings: Settings, ω: float) -> Iterator[Measured]:
    slowest = float(fl.natural_frequencies(_scene(case, settings, {}).chain())[0])
    target = {"ratio": settings.target, "at_hz": slowest / (2 * math.pi)}
    for name, damping in (("no cap", target), (f"cap {settings.cap:g}", target | {"cap": settings.cap})):
        scene = _scene(case, settings, {"link": [{"damping": damping}]})
        ratios = fl.modes(scene.chain()).damping_ratios
        facts: Facts = {"damping ratio": settings.target, "law": name}
        yield Measured("damping ratio of the slowest mode", float(ratios[0]), scene.name, varied=facts)
        yield Measured("stable step × ω_max", _step(scene, settings.method) * ω, scene.name, varied=facts)
        yield Measured("MuJoCo: fastest eigenvalue", _difference(scene), scene.name, "mujoco", facts)
        if "cap" in damping:
            largest = float(ratios.max()) / settings.cap
            yield Measured("largest damping ratio / cap", largest, scene.name, varied=facts)


def _difference(scene: Scene) -> float:
    """|λ / λ of MuJoCo − 1| of the eigenvalue that sets the step, from MuJoCo's own M and torques."""
    chain = scene.chain()
    engine, rest = MujocoEngine(chain), np.zeros(chain.n)
    M, K = engine.mass_matrix(rest), springs(engine)
    D = np.array([engine.friction_torque(e) for e in np.eye(chain.n)]).T
    λ = linalg.eigvals(np.block([[np.zeros_like(M), np.eye(chain.n)], [-linalg.solve(M, K), -linalg.solve(M, D)]]))
    return abs(float(np.abs(λ).max()) / largest_frequency(chain, rest) - 1)


def _scene(case: Case, settings: Settings, change: dict[str, Any]) -> Scene:
    return Variant(change=change).build(case, settings.chain)


def _step(scene: Scene, method: str) -> float:
    return fl.stable_step(scene.chain(), method)
