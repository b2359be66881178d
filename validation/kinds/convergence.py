"""Measured order of the integrators: slope of log error against log step, in float64 or in 50 digits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from mpmath import mp, mpf

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive, Spec
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles import exact_runge_kutta
from validation.oracles.planar_chain import DIGITS, PlanarChain
from validation.store import Series, table


class Reference(Spec, frozen=True):
    """The run whose end state is the reference."""

    method: str
    steps: int


def run(
    case: Case,
    segments: int,
    duration: Positive,
    arithmetic: Literal["float64", "extended"],
    reference: Reference,
    steps: dict[str, tuple[int, ...]],
) -> Iterator[Measured | Series]:
    """Yield the fitted slopes, their differences from the method's order, and by how much they are below the order.

    Flexible links have `segments` segments; a run lasts `duration` [s]; `steps` are numbers of steps by method.
    """
    for full in case.load_scenes():
        scene = full.varied({"link.*.segments": segments})
        end = _extended if arithmetic == "extended" else _float64
        exact = end(scene, reference.method, duration, reference.steps)
        curves: list[tuple[str, float, float]] = []
        for method, counts in steps.items():
            h = duration / np.array(counts)
            errors = [_distance(end(scene, method, duration, count), exact) for count in counts]
            slope = float(np.polyfit(np.log(h), np.log(errors), 1)[0])
            order = methods.method(method).order
            facts: Facts = {
                "method": method, "arithmetic": arithmetic, "step": float(h.max()), "to step": float(h.min()),
            }  # fmt: skip
            yield Measured("slope", slope, scene.name, varied=facts)
            yield Measured("|slope − order|", abs(slope - order), scene.name, varied=facts)
            yield Measured("order − slope", order - slope, scene.name, varied=facts)
            curves += [(method, float(step), error) for step, error in zip(h, errors, strict=True)]
        columns = table(("method", "step [s]", "error [rad]"), curves)
        title = f"{scene.name}, {segments} segments: error after {duration:g} s"
        labels = "step [s]", "step [s]", "max |Δq| [rad]"
        yield Series("convergence", title, columns, *labels, "log", "log", group="method", scene=scene.name)


def _float64(scene: Scene, method: str, duration: float, steps: int) -> list[float]:
    step = duration / steps
    run = simulate(scene, method=method, step=step, sample=duration, duration=duration)
    return [float(x) for x in run.q[-1]]


def _extended(scene: Scene, method: str, duration: float, steps: int) -> list[mpf]:
    chain = lump(scene)
    oracle = PlanarChain(chain)
    q, qd = (part.tolist() for part in initial_state(scene, chain))
    with mp.workdps(DIGITS):
        return exact_runge_kutta.integrate(oracle.forward_dynamics, methods.method(method), (q, qd), duration, steps)[0]


def _distance(a: list[float], b: list[float]) -> float:
    return max(float(abs(x - y)) for x, y in zip(a, b, strict=True))
