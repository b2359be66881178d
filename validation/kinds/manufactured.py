"""A manufactured solution: runs driven by a torque computed to 50 digits from a smooth motion must return the motion.

This tests every term of the equation of motion, the inputs and every integrator: any deviation is an error.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from mpmath import mpf

from flexlink.common.interruption import deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive, Spec
from flexlink.kernels.inputs.record import PiecewisePolynomial
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import drive_of
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles import manufactured
from validation.oracles.manufactured import Motion, Wrench
from validation.oracles.spatial_chain import Vector
from validation.store import Series, table

SAMPLES = 5
BETWEEN = 0.37  # fraction of a piece at which its torque is checked, away from the interpolation points


class Settings(Spec, frozen=True, kw_only=True):
    """The motion, the number of pieces of its torque, two numbers of steps per method, and a `finest` one for some.

    `driven` and `held` are the largest amplitudes of driven joints and of joints with springs [rad, m]; `rates` are the
    slowest and the fastest frequency [rad/s].
    """

    duration: Positive
    driven: Positive
    held: Positive
    rates: tuple[Positive, Positive]
    pieces: int
    degree: int
    steps: dict[str, tuple[int, int]]
    finest: dict[str, int]
    seed: int = 1


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the error of each method at two steps, its order, and the error of the torque's interpolation."""
    (scene,) = case.load_scenes()
    scene = scene.varied({"run.duration": settings.duration, "run.sample": settings.duration / SAMPLES})
    chain = problem_of(scene).chain
    moved = manufactured.motion(chain, (settings.driven, settings.held), settings.rates, settings.seed)
    wrench = _wrench(scene)
    spline = PiecewisePolynomial(
        *manufactured.torque_pieces(chain, moved, wrench, settings.duration, settings.pieces, settings.degree)
    )
    at = spline.knots + BETWEEN * settings.duration / settings.pieces
    exact = manufactured.torques(chain, at, moved, wrench)
    held = np.abs(_values(spline, at) - exact).max() / np.abs(exact).max()
    yield Measured("torque between its points", float(held), scene.name)
    rows = []
    for method, counts in settings.steps.items():
        errors = [_error(scene, method, count, spline, moved) for count in counts]
        slope = float(np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0]))
        order = methods.method(method).order
        facts: Facts = {"method": method, "step": settings.duration / counts[1]}
        note = f"Observed order {slope:.2f} of {order}."
        yield Measured("order − observed", order - slope, scene.name, varied=facts, note=note)
        yield Measured("largest |Δq|", errors[1], scene.name, varied=facts)
        rows += [(method, settings.duration / n, e) for n, e in zip(counts, errors, strict=True)]
    for method, count in settings.finest.items():
        facts = {"method": method, "step": settings.duration / count}
        rounding = _error(scene, method, count, spline, moved)
        yield Measured("largest |Δq|, finest step", rounding, scene.name, varied=facts)
    yield Series(
        "manufactured", case.title, table(("method", "step [s]", "error [rad]"), rows), "step [s]", "step [s]",
        "max |Δq| [rad, m]", "log", "log", group="method", scene=scene.name,
    )  # fmt: skip


def _wrench(scene: Scene) -> Wrench:
    """The scene's wrench table of two rows, interpolated to 50 digits."""
    given = scene.wrench
    assert given.times is not None and given.forces is not None and given.moments is not None
    start, end = ([*map(mpf, (*given.forces[row], *given.moments[row]))] for row in (0, -1))
    first, last = mpf(given.times[0]), mpf(given.times[-1])
    return functools.partial(_between, (first, start), (last, end))


def _between(start: tuple[Any, Vector], end: tuple[Any, Vector], t: Any) -> Vector:
    """Interpolate linearly between two times."""
    part = (t - start[0]) / (end[0] - start[0])
    return [a + (b - a) * part for a, b in zip(start[1], end[1], strict=True)]


def _values(spline: PiecewisePolynomial, at: Array) -> Array:
    """Values of the spline at one time `at` in each of its pieces."""
    x = (at - spline.knots)[:, None]
    return np.asarray(sum(c * x**j for j, c in enumerate(spline.coefficients.swapaxes(0, 1))))


def _error(scene: Scene, method: str, steps: int, spline: PiecewisePolynomial, moved: Motion) -> float:
    """Largest difference of any joint from the motion over all samples; the torque drives every joint."""
    q, qd = (rows[0] for rows in manufactured.states([0.0], moved))
    start = {"initial.q": q.tolist(), "initial.qd": qd.tolist()}
    problem = problem_of(scene.varied({"run.method": method, "run.step": scene.run.duration / steps, **start}))
    drive = drive_for(problem.chain, drive_of(np.arange(problem.chain.n), feedforward=spline))
    problem = dataclasses.replace(problem, inputs=problem.inputs._replace(drive=drive))
    with deferred() as stop:
        found = SingleRun(problem).finish(stop)
    return float(np.abs(found.q - manufactured.states(found.t, moved)[0]).max())
