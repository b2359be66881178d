"""The paper's comparison of Runge-Kutta methods: error against step and work, drift, cost, stability, verdict."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence

import numpy as np

from flexlink.errors import DivergenceError
from flexlink.scene import Scene
from flexlink.simulate import simulate
from flexlink.spec import Positive, Spec
from flexlink.stability import stable_step
from flexlink.tableaus import tableau
from flexlink.trajectory import Trajectory
from validation.case import Case, Measured
from validation.kinds.motion import with_run
from validation.store import Series, table


class Settings(Spec, frozen=True):
    """What to run.

    duration, sample [s]; reference: two steps [s] of RK10, the finer one counts as exact; steps [s] by method;
    errors [rad] at which the methods are weighed against each other; methods whose limit of stability is measured.
    """

    duration: Positive
    sample: Positive
    reference: tuple[Positive, Positive]
    steps: dict[str, tuple[float, ...]]
    errors: tuple[Positive, ...]
    stability: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Point:
    """One run of one method."""

    method: str
    step: float  # s
    error: float  # rad, largest over joints and samples
    drift: float  # J
    evaluations: float  # of the right-hand side, per simulated second
    seconds: float  # of one core, per simulated second


LABELS = (
    "method", "step [s]", "error [rad]", "energy drift [J]", "evaluations per simulated second",
    "core seconds per simulated second",
)  # fmt: skip


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Every run as a point; then, at each error, the cheapest method; then stability."""
    for full in case.load_scenes():
        scene = with_run(full, duration=settings.duration, sample=settings.sample)
        coarse, exact = (simulate(with_run(scene, method="RK10", step=h)) for h in settings.reference)
        setting = f"RK10 h={settings.reference[0]:g} and {settings.reference[1]:g} s"
        yield Measured("reference", _distance(coarse, exact), scene.name, setting=setting)
        points = []
        for method, steps in settings.steps.items():
            cost = _seconds_per_step(scene, method, min(steps))
            yield Measured("cost per step", 1e6 * cost, scene.name, setting=method)
            for p in (_measure(scene, method, h, cost, exact) for h in steps):
                yield Measured("error", p.error, scene.name, setting=f"{method} h={p.step:g} s")
                yield Measured("energy drift", p.drift, scene.name, setting=f"{method} h={p.step:g} s")
                points.append(p)
        yield _series(scene, points)
        yield from _verdicts(scene, points, settings.errors)
        for method in settings.stability:
            yield _stability(scene, method, exact)


def _measure(scene: Scene, method: str, step: float, cost: float, exact: Trajectory) -> Point:
    run = simulate(with_run(scene, method=method, step=step))
    total = np.asarray(run.energy.total)
    drift = float(np.abs(total - total[0]).max())
    return Point(method, step, _distance(run, exact), drift, tableau(method).stages / step, cost / step)


def _seconds_per_step(scene: Scene, method: str, step: float, steps: int = 10_000, repeats: int = 3) -> float:
    """Time of a step [s]: the fastest of repeats, after a warm-up, so long that the set-up of a run does not count."""
    timed = with_run(scene, method=method, step=step, sample=steps * step, duration=steps * step)
    simulate(timed)
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        simulate(timed)
        times.append(time.perf_counter() - start)
    return min(times) / steps


def _distance(a: Trajectory, b: Trajectory) -> float:
    return float(np.abs(a.q - b.q).max())


def _series(scene: Scene, points: Sequence[Point]) -> Series:
    columns = table(LABELS, [dataclasses.astuple(p) for p in points])
    title = f"{scene.name}: error of the methods in {scene.run.duration:g} s"
    return Series(
        f"{scene.name}.error", title, columns, "step [s]", "step [s]", "max |Δq| [rad]", "log", "log", group="method"
    )


def evaluations_for(points: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Evaluations per simulated second and step [s] at which one method reaches an error; None if no run does.

    Interpolated between neighbouring runs on log scales. If the coarsest run is already better, its cost stands: a
    larger step would not be stable, or was not asked for.
    """
    runs = sorted(points, key=lambda p: -p.step)
    for coarse, fine in zip([None, *runs], runs, strict=False):
        if fine.error > error:
            continue
        if coarse is None:
            return fine.evaluations, fine.step
        share = math.log(coarse.error / error) / math.log(coarse.error / fine.error)
        factor = (fine.evaluations / coarse.evaluations) ** share
        return coarse.evaluations * factor, coarse.step / factor
    return None


def _verdicts(scene: Scene, points: Sequence[Point], errors: Sequence[float]) -> Iterator[Measured]:
    """The cheapest method at every error, in numbers and words, and what becomes of the paper's conclusion."""
    methods = list(dict.fromkeys(p.method for p in points))
    winners: dict[float, str] = {}
    for error in errors:
        reached = {m: evaluations_for([p for p in points if p.method == m], error) for m in methods}
        costs = {m: found for m, found in reached.items() if found is not None}
        if not costs:
            continue
        ranking = sorted(costs, key=lambda m: costs[m][0])
        best = winners[error] = ranking[0]
        words = [f"{best} is cheapest: {costs[best][0]:.3g} evaluations a second, h = {costs[best][1]:.2g} s."]
        words += [f"{m} takes {costs[m][0] / costs[best][0]:.2g} times as many." for m in ranking[1:]]
        words += [f"{m} does not reach it with the steps tried." for m in methods if m not in costs]
        setting = f"{best}, error {error:g} rad"
        yield Measured("cheapest method", costs[best][0], scene.name, setting=setting, note=" ".join(words))
    note = f"It holds at errors of {_listed(winners, 'RK4')} rad."
    for other in dict.fromkeys(best for best in winners.values() if best != "RK4"):
        note += f" It does not hold at {_listed(winners, other)} rad, where {other} is cheaper."
    share = list(winners.values()).count("RK4") / max(1, len(winners))
    yield Measured("paper's conclusion", share, scene.name, setting="RK4 suffices, RK10 not justified", note=note)


def _listed(winners: dict[float, str], method: str) -> str:
    return ", ".join(f"{error:g}" for error, best in winners.items() if best == method) or "no"


def _stability(scene: Scene, method: str, exact: Trajectory) -> Measured:
    """Largest stable step, by bisection, over the smallest that the linear theory gives for the postures passed."""
    some = exact.q[:: max(1, len(exact.q) // 50)]
    predicted = min(stable_step(exact.chain, method, q) for q in some)
    low, high = 0.5, 2.0
    while high - low > 0.002:
        middle = (low + high) / 2
        low, high = (middle, high) if _stable(scene, method, middle * predicted) else (low, middle)
    note = f"Predicted {predicted:.4g} s, measured {low * predicted:.4g} s."
    return Measured("stable step", low, scene.name, setting=method, note=note)


def _stable(scene: Scene, method: str, step: float) -> bool:
    """The total energy changes by less than 1 % of what gravity takes and gives."""
    steps = round(scene.run.duration / step)
    try:
        run = simulate(with_run(scene, method=method, step=step, sample=step, duration=steps * step))
    except DivergenceError:
        return False
    total = np.asarray(run.energy.total)
    return bool(np.abs(total - total[0]).max() < 0.01 * np.ptp(run.energy.gravity))
