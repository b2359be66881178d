"""Orders of Runge-Kutta methods, measured, and on a manufactured solution."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from mpmath import mp, mpf

from flexlink.chain.lumping import lump
from flexlink.common.interruption import deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive, Spec
from flexlink.kernels.inputs.record import PiecewisePolynomial
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import drive_of
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.simulate import simulate
from flexlink.motion.single_run import SingleRun
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.oracles import exact_runge_kutta
from validation.oracles import manufactured as solution
from validation.oracles.manufactured import Motion, Wrench
from validation.oracles.planar_chain import DIGITS, PlanarChain
from validation.oracles.spatial_chain import Vector
from validation.store import Series, table


class Reference(Spec, frozen=True):
    """The run whose end state is the reference."""

    method: str
    steps: int


@kind
def convergence(
    case: Case,
    segments: int,
    duration: Positive,
    arithmetic: Literal["float64", "extended"],
    reference: Reference,
    steps: dict[str, tuple[int, ...]],
) -> Iterator[Measured | Series]:
    """Measured order of the integrators: slope of log error against log step, in float64 or in 50 digits.

    Yield the fitted slopes, their differences from the method's order, and by how much they are below the order.

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


SAMPLES = 5
BETWEEN = 0.37  # fraction of a piece at which its torque is checked, away from the interpolation points


class ManufacturedSettings(Spec, frozen=True, kw_only=True):
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


@kind
def manufactured(case: Case, settings: ManufacturedSettings) -> Iterator[Measured | Series]:
    """A manufactured solution: runs driven by a torque computed to 50 digits from a smooth motion must return it.

    This tests every term of the equation of motion, the inputs and every integrator: any deviation is an error.

    Yield the error of each method at two steps, its order, and the error of the torque's interpolation.
    """
    (scene,) = case.load_scenes()
    scene = scene.varied({"run.duration": settings.duration, "run.sample": settings.duration / SAMPLES})
    chain = problem_of(scene).chain
    moved = solution.motion(chain, (settings.driven, settings.held), settings.rates, settings.seed)
    wrench = _wrench(scene)
    spline = PiecewisePolynomial(
        *solution.torque_pieces(chain, moved, wrench, settings.duration, settings.pieces, settings.degree)
    )
    at = spline.knots + BETWEEN * settings.duration / settings.pieces
    exact = solution.torques(chain, at, moved, wrench)
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
    q, qd = (rows[0] for rows in solution.states([0.0], moved))
    start = {"initial.q": q.tolist(), "initial.qd": qd.tolist()}
    problem = problem_of(scene.varied({"run.method": method, "run.step": scene.run.duration / steps, **start}))
    drive = drive_for(problem.chain, drive_of(np.arange(problem.chain.n), feedforward=spline))
    problem = dataclasses.replace(problem, inputs=problem.inputs._replace(drive=drive))
    with deferred() as stop:
        found = SingleRun(problem).finish(stop)
    return float(np.abs(found.q - solution.states(found.t, moved)[0]).max())
