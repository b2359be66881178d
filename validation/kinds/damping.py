"""Damping of links: its ratio in slow modes, and its effect on stable steps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import linalg

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.vibration.stability import fastest_eigenvalues
from flexlink.engines.mujoco import MujocoEngine
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.physics.parity import springs
from validation.physics.variant import Rule, Variant
from validation.runs import peaks
from validation.store import Series


class DampingSettings(Spec, frozen=True):
    """Damping ratios of the fastest mode; the method and its published stability limit on the real axis; and a target.

    `target` is the damping ratio specified for the slowest mode of the continuous link, whose frequency is `slowest`
    [rad/s]. It is checked on chains with the numbers of hinges in `refined`.
    """

    chain: Rule
    ratios: tuple[Positive, ...]
    method: str
    real_limit: Positive
    target: Positive
    slowest: Positive
    refined: tuple[int, ...]


@kind
def damping(case: Case, settings: DampingSettings) -> Iterator[Measured | Series]:
    """Kelvin-Voigt damping: largest stable step against the damping ratio of the fastest mode; ratio of the slowest.

    The damping ratio of the slowest mode must be as specified for any number of hinges.

    With d = η k every mode has ζ = η ω/2. A mode with ζ > 1 decays with rates λ = −ω (ζ ± √(ζ² − 1)); the faster one
    limits the step: h ω = r / (ζ + √(ζ² − 1)), with r the method's stability limit on the negative real axis.

    Yield stable steps with Kelvin-Voigt damping, then one target damping ratio on finer and finer chains.
    """
    free = _scene(case, settings.chain, {})
    ω = np.abs(fastest_eigenvalues(fl.lump(free), np.zeros(fl.lump(free).n))).max()
    steps = {}
    for ζ in settings.ratios:
        h = _step(_scene(case, settings.chain, {"material.unit.loss_time": 2 * ζ / ω}), settings.method) * ω
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
    yield from _refined(case, settings)


def _refined(case: Case, settings: DampingSettings) -> Iterator[Measured]:
    """Compare the damping ratio of the chain's slowest mode with the ratio specified for the frequency of that mode."""
    damping = {"ratio": settings.target, "at_hz": settings.slowest / (2 * math.pi)}
    for hinges in settings.refined:
        rule = Rule(rule=settings.chain.rule, hinges=hinges)
        bare, scene = _scene(case, rule, {}), _scene(case, rule, {"link.*.damping": damping})
        found = fl.modes(fl.lump(scene))
        facts: Facts = {"damping ratio": settings.target, **rule.facts}
        ratio = float(found.damping_ratios[0])
        expected = settings.target * float(found.frequencies[0]) / settings.slowest
        yield Measured("damping ratio of the slowest mode", ratio, scene.name, varied=facts)
        yield Measured("damping ratio of the slowest mode, asked", abs(ratio / expected - 1), scene.name, varied=facts)
        cost = _step(bare, settings.method) / _step(scene, settings.method)
        yield Measured("stable step undamped / damped", cost, scene.name, varied=facts)
        yield Measured("MuJoCo: fastest eigenvalue", _difference(scene), scene.name, "mujoco", facts)


def _difference(scene: Scene) -> float:
    """|λ_MuJoCo / λ − 1| of the largest eigenvalue, which limits the step; λ_MuJoCo is from MuJoCo's M and torques."""
    chain = fl.lump(scene)
    engine, rest = MujocoEngine(chain), np.zeros(chain.n)
    M, K = engine.mass_matrix(rest), springs(engine)
    D = np.array([engine.friction_torque(e) for e in np.eye(chain.n)]).T
    λ = linalg.eigvals(np.block([[np.zeros_like(M), np.eye(chain.n)], [-linalg.solve(M, K), -linalg.solve(M, D)]]))
    return abs(float(np.abs(λ).max() / np.abs(fastest_eigenvalues(chain, rest)).max()) - 1)


def _scene(case: Case, rule: Rule, change: dict[str, Any]) -> Scene:
    return Variant(change=change).build(case, rule)


def _step(scene: Scene, method: str) -> float:
    return fl.stable_step(fl.lump(scene), method=method)


PERIODS, OF_A_PERIOD = 8, 200  # periods of a run, samples per period


@kind
def constant_damping(case: Case, ratio: Positive, modes: int, amplitude: Positive) -> Iterator[Measured]:
    """Damping with an equal ratio in every mode: decrements of free vibrations in the first modes.

    The logarithmic decrement is ln(A_k / A_k+1) = 2π ζ / √(1 − ζ²) per period. Each run starts in one mode with an
    amplitude in the linear range; its peaks are found by parabolas through samples of the tip.

    Yield each mode's damping ratio, from its decrement, relative to the target; tips start at `amplitude` [m].
    """
    for scene in case.load_scenes():
        damped = scene.varied({"link.*.damping": {"ratio": ratio, "law": "constant"}})
        found = fl.modes(fl.lump(scene), count=modes)
        for k in range(modes):
            ζ = _decrement_ratio(_ringing(damped, found.shapes[k].real, 2 * math.pi / found.frequencies[k], amplitude))
            note = f"Found {ζ:.6g}, asked for {ratio:g}."
            yield Measured(f"ratio of mode {k + 1}", abs(ζ / ratio - 1), scene.name, note=note)


def _ringing(scene: fl.Scene, shape: np.ndarray, period: float, amplitude: float) -> fl.Trajectory:
    chain = fl.lump(scene)
    tip = fl.jacobian(chain, np.zeros(chain.n)).linear[1] @ shape
    every = period / OF_A_PERIOD
    settings = {"method": "Radau9", "tolerance": 1e-6 * amplitude, "sample": every, "duration": PERIODS * period}
    return fl.simulate(scene.varied({"initial.q": (amplitude / tip * shape).tolist(), "run": settings}))


def _decrement_ratio(run: fl.Trajectory) -> float:
    """Damping ratio from the slope of the logarithms of the maxima."""
    _, heights = peaks(run)
    decrement = -float(np.polyfit(np.arange(len(heights)), np.log(heights), 1)[0])
    return decrement / math.hypot(2 * math.pi, decrement)
