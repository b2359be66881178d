"""Derivatives of runs with respect to parameters of their scene, by differences between runs side by side.

The polynomial through the values at a point x and at its neighbours x + a_i h, for integers a_i and a step h, has the
derivative

    f' ≈ Σ w_i (f(x + a_i h) − f(x)) / h        w_i = L_i'(0), L_i: Lagrange polynomials

With m neighbours the truncation error is a constant times h^m f^(m+1), and the rounding error is Σ |w_i| ε / h. The
error estimate is the difference from a derivative of the next lower order, computed from the same runs, as in embedded
Runge-Kutta methods.
"""

import functools
import math
import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError, or_error, or_raise
from flexlink.common.interruption import deferred
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.scene import Scene
from flexlink.describe.variants import Variants
from flexlink.describe.vary import number_in, parts_of
from flexlink.dynamics.floating_base import ANGLES
from flexlink.motion.batch import outcomes
from flexlink.results.stop_reasons import InterruptedRunError
from flexlink.results.trajectory import Trajectory

Value = TypeVar("Value")
Places = tuple[int, ...]  # multiples of the step at which a function is evaluated around a point
CENTRAL: Places = (-1, 1)  # central differences with a second-order error
CENTRAL_4: Places = (-2, -1, 1, 2)  # central differences with a fourth-order error
FORWARD: Places = (1, 2)
"""One-sided differences with a second-order error, for a lower bound; mirrored for an upper bound."""


@functools.cache
def weights(at: Places) -> tuple[float, ...]:
    """Weights w_i of the differences f(x + a_i h) − f(x) for multiples a_i = `at` of the step h."""
    factors = [[(Fraction(-y), Fraction(x - y)) for y in (0, *at) if y != x] for x in at]
    return tuple(
        float(math.prod(top for top, _ in one if top) / math.prod(bottom for _, bottom in one)) for one in factors
    )


class Neighbours(NamedTuple, Generic[Value]):
    """Values of a function at the neighbours of a point along one coordinate."""

    at: Places  # in multiples of the step
    step: float
    values: list[Value]  # at each neighbour

    def slope(self, middle: Array, read: Callable[[Value], Array]) -> Array:
        """Derivative of the quantity that `read` extracts from a value; `middle` is this quantity at the point."""
        return self._slope(self.at, self._changes(middle, read))

    def slope_with_error(self, middle: Array, read: Callable[[Value], Array]) -> tuple[Array, float]:
        """Return `slope` and an estimate of its largest error: three times its change if the last neighbour is omitted.

        The truncation error is far smaller, as `slope` is one order more accurate than the derivative without the last
        neighbour. The rounding error is 0.8 to 1.6 times the change.
        """
        changes = self._changes(middle, read)
        found, rougher = self._slope(self.at, changes), self._slope(self.at[:-1], changes[:-1])
        return found, 3 * float(np.abs(found - rougher).max(initial=0.0))

    def _changes(self, middle: Array, read: Callable[[Value], Array]) -> list[Array]:
        return [read(value) - middle for value in self.values]

    def _slope(self, at: Places, changes: Sequence[Array]) -> Array:
        return np.tensordot(np.array(weights(at)) / self.step, np.array(changes), 1)


def neighbours(
    many: Callable[[Sequence[Array]], Sequence[Value | FlexlinkError]], x: Array, steps: Array, at: Sequence[Places],
    one_sided: Places = FORWARD,
) -> tuple[Value, list[Neighbours[Value] | FlexlinkError]]:  # fmt: skip
    """Evaluate a function at a point x (p,) and at its neighbours along each coordinate, all in one call of `many`.

    `many` takes several points and returns a value or an error for each; an error at x is raised. `steps` (p,) are the
    distances along the coordinates, 0: no neighbours, and `at` the neighbours in these units. If the function fails at
    one of them, `one_sided` neighbours or their mirror images are tried instead.
    """
    varied = [k for k in range(len(x)) if steps[k]]
    first, *beside = many([x, *(moved(x, k, place * steps[k]) for k in varied for place in at[k])])
    middle = or_raise(first)
    found, left = list[Neighbours[Value] | FlexlinkError](), iter(beside)
    for k in varied:
        places, values = at[k], [next(left) for _ in at[k]]
        for other in (mirrored(one_sided), one_sided):
            if any(isinstance(value, FlexlinkError) for value in values) and places != other:
                places, values = other, list(many([moved(x, k, place * steps[k]) for place in other]))
        good = [value for value in values if not isinstance(value, FlexlinkError)]
        failed = next((value for value in values if isinstance(value, FlexlinkError)), None)
        found.append(Neighbours(places, float(steps[k]), good) if failed is None else failed)
    return middle, found


def moved(x: Array, k: int, by: float) -> Array:
    """The point x moved along coordinate k."""
    point = x.copy()
    point[k] += by
    return point


def mirrored(at: Places) -> Places:
    """Return these multiples of the step with opposite signs."""
    return tuple(-place for place in at)


def smooth(scene: Scene, tolerance: float) -> Scene:
    """The scene with differentiable runs: sensors without noise and resolution, and this relative tolerance."""
    sensors = [one.ideal for one in scene.sensor]
    plain = replace(scene, sensor=tuple(sensors)) if sensors else scene
    return plain.varied({"run.relative_tolerance": tolerance}) if scene.run.controlled else plain


class RunSlopes(NamedTuple):
    """A run, and neighbouring runs with slightly changed parameters of the scene."""

    run: Trajectory
    middle: Trajectory  # with noiseless sensors and a small tolerance: differences are taken from it
    values: Array  # of the parameters (p,)
    beside: tuple[Neighbours[Trajectory], ...]  # of each parameter

    @property
    def step(self) -> Array:
        """Change of each parameter between neighbouring runs, shape (p,)."""
        return np.array([one.step for one in self.beside])

    def of(self, read: Callable[[Trajectory], Array]) -> tuple[Array, Array]:
        """Derivatives of the array that `read` extracts from a run, shape (…, p), and estimated errors (p,)."""
        middle = read(self.middle)
        found = [one.slope_with_error(middle, read) for one in self.beside]
        return np.stack([slope for slope, _ in found], axis=-1), np.array([error for _, error in found])

    def states(self) -> list[tuple[Array, Array]]:
        """Derivatives and errors of q, q̇ and the tip; angles of a free base are unwrapped to be close to `middle`."""
        return [self.of(self._turned), self.of(lambda run: run.qd), self.of(lambda run: run.tip)]

    def _turned(self, run: Trajectory) -> Array:
        if run.base is None:
            return run.q
        q, turn = run.q.copy(), 2 * np.pi
        q[:, ANGLES] -= turn * np.round((q[:, ANGLES] - self.middle.q[:, ANGLES]) / turn)
        return q


def slopes_of_runs(scene: Scene, paths: Sequence[str]) -> RunSlopes:
    """A run, and runs with parameters at `paths` changed so that the error is small; errors as in `sensitivities`."""
    x = np.array([_number(scene, path) for path in paths])
    runs = _Runs(scene, paths, x)
    size = np.where(x == 0, 1.0, np.abs(x))
    third, fifth = (1, -1, 2), (1, -1, 2, -2, 3)  # neighbours for errors of third and fifth order
    first, part = (fifth, 1e-2) if scene.run.controlled else (third, 1e-5)  # `part`: step / parameter
    rounding = 1e-8 if scene.run.controlled else 1e-13  # largest relative error of runs that are not sensitive
    enough = 3e-6  # estimated error below which no other step is tried; the estimate mostly far exceeds the error
    steps, best = part * size, dict[int, _Candidate]()
    for at in (first, fifth, fifth):
        varied = np.flatnonzero(steps).tolist()
        middle, found = neighbours(runs.many, x, steps, [at] * len(x), tuple(range(1, len(at) + 1)))
        for k, one in zip(varied, found, strict=True):
            if isinstance(one, FlexlinkError):  # the scene may run only with a smaller step
                if k not in best:
                    raise one
                steps[k] = 0.0
                continue
            candidate = _candidate(one, middle, size[k], rounding)
            best[k] = min(candidate, best.get(k, candidate), key=lambda each: each.error)
            steps[k] = 0.0 if candidate.error <= enough else _other(candidate)
        if not steps.any():
            break
    return RunSlopes(runs.known[0], middle, x, tuple(best[k].beside for k in range(len(x))))


class _Candidate(NamedTuple):
    """Neighbours of a run; largest relative error of the derivatives, and the part of it due to rounding."""

    beside: Neighbours[Trajectory]
    error: float
    rounding: float


def _candidate(beside: Neighbours[Trajectory], middle: Trajectory, size: float, rounding: float) -> _Candidate:
    error = of_rounding = 0.0
    for read in (operator.attrgetter("q"), operator.attrgetter("tip")):
        f = read(middle)
        slope, off = beside.slope_with_error(f, read)
        largest = float(np.abs(f).max())
        most = max(float(np.abs(slope).max()), 1e-10 * largest / size)  # smaller slopes count as zero
        if most > 0 and off / most > error:
            error, of_rounding = off / most, rounding * largest / (beside.step * most)
    return _Candidate(beside, error, of_rounding)


def _other(candidate: _Candidate) -> float:
    """Step with which the fifth-order differences likely have a smaller error.

    For a function that changes by its own size over a length L, the second-order error is (h/L)²/6; the estimate is
    three times this error. The new step is a hundredth of L or, if the differences were of fifth order already, a fifth
    of the step. If rounding explains the error, the step is increased instead, at least 5-fold.
    """
    step = candidate.beside.step
    if candidate.error <= candidate.rounding:
        return step * max(math.sqrt(candidate.error / 1e-8), 5.0)
    return step * (0.01 / math.sqrt(2 * candidate.error) if len(candidate.beside.at) == 3 else 0.2)


class _Runs:
    """Runs of a scene with its own parameter values and with others, several runs at a time side by side."""

    def __init__(self, scene: Scene, paths: Sequence[str], x: Array) -> None:
        self.paths, self.x, self.plain = paths, x, smooth(scene, 1e-9)
        self.starts = (scene,) if self.plain == scene else (scene, self.plain)
        self.known: list[Trajectory] = []  # runs of `starts`
        self._variants = [Variants(self.plain, [path]) for path in paths]

    def many(self, points: Sequence[Array]) -> list[Trajectory | FlexlinkError]:
        """Runs at several points; in the first call these include the scene's own, whose error is raised."""
        new = () if self.known else self.starts
        numbers = [next(iter(np.flatnonzero(x != self.x).tolist()), None) for x in points]
        scenes = [
            None if k is None else or_error(self._variants[k].varied, {self.paths[k]: float(x[k])})
            for k, x in zip(numbers, points, strict=True)
        ]
        with deferred() as stop:
            good = [*new, *(one for one in scenes if isinstance(one, Scene))]
            ends = iter(outcomes(good, stop, compared=min(len(new), 1)))
        self.known += [_run(next(ends)) for _ in new]
        found = [next(ends) if isinstance(one, Scene) else one for one in scenes]
        return [self.known[-1] if k is None else self._checked(k, end) for k, end in zip(numbers, found, strict=True)]

    def _checked(self, k: int, end: object) -> Trajectory | FlexlinkError:
        """Return a neighbouring run if it has the same joints, else an error."""
        reason = end if isinstance(end, FlexlinkError) else ""
        if not reason and not self.known[-1].chain.same_layout(_run(end).chain):
            reason = "a small change of it changes the number or type of joints"
        if not reason:
            return _run(end)
        why = f"parameters: {truncated(self.paths[k])} = {float(self.x[k])!r} cannot be varied: {reason}"
        return ArgumentError(why, id="parameter-cannot-vary")


def _run(end: object) -> Trajectory:
    if isinstance(end, FlexlinkError | InterruptedRunError):
        raise end
    assert isinstance(end, Trajectory)
    return end


def _number(scene: Scene, path: object) -> float:
    """Value of the parameter at a path; run settings are rejected, since they change steps and samples."""
    if not isinstance(path, str):
        raise ArgumentError(f"parameters: {truncated(path)}: expected a path such as 'tip.mass'", id="path-form")
    if parts_of(path)[:1] == ("run",) or path == "initial.time":
        why = f"parameters: {truncated(path)}: not a parameter; run settings and initial.time are excluded"
        raise ArgumentError(why, id="not-a-parameter")
    values = scene.values_at(path)
    try:
        return number_in(values)
    except SceneError as error:
        raise ArgumentError(f"parameters: {truncated(path)} = {error}") from None
