"""The paper's comparison of Runge-Kutta methods: error against step and work, drift, cost, stability."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.speed.races import race
from validation.store import Series, table

LABELS = (
    "method", "step [s]", "error [rad]", "energy drift [J]", "evaluations per simulated second",
    "core seconds per simulated second",
)  # fmt: skip


@kind(timed=True, beside=True)
def run(
    case: Case,
    duration: Positive,
    sample: Positive,
    reference: tuple[Positive, Positive],
    steps: dict[str, tuple[float, ...]],
    stability: tuple[str, ...] = (),
) -> Iterator[Measured | Series]:
    """Yield error, drift and cost of every run, then stability limits; the report compares the methods.

    `reference` are two steps of RK10 [s]; the run with the finer step is taken as exact. `steps` are the steps of each
    method [s]. The stability limit is measured for the methods in `stability`.
    """
    for full in case.load_scenes():
        scene = full.varied({"run.duration": duration, "run.sample": sample})
        coarse, exact = (simulate(scene, method="RK10", step=h) for h in reference)
        facts: Facts = {"method": "RK10", "step": reference[0], "to step": reference[1]}
        yield Measured("reference", _distance(coarse, exact), scene.name, varied=facts)
        points = []
        for method, sizes in steps.items():
            cost = _seconds_per_step(scene, method, min(sizes))
            yield Measured("cost per step", 1e6 * cost, scene.name, varied={"method": method}, timed=True)
            for h in sizes:
                error, drift = _errors(scene, method, h, exact)
                yield Measured("error", error, scene.name, varied={"method": method, "step": h})
                yield Measured("energy drift", drift, scene.name, varied={"method": method, "step": h})
                points.append((method, h, error, drift, methods.method(method).stages / h, cost / h))
        title = f"{scene.name}: largest error of each method within {scene.run.duration:g} s"
        labels = "step [s]", "step [s]", "max |Δq| [rad]"
        columns = table(LABELS, points)
        yield Series("comparison", title, columns, *labels, "log", "log", group="method", scene=scene.name)
        for method in stability:
            yield _stability(scene, method, exact)


def _errors(scene: Scene, method: str, step: float, exact: Trajectory) -> tuple[float, float]:
    """Largest error of the angles over joints and samples [rad], and drift of the energy [J]."""
    run = simulate(scene, method=method, step=step, unstable="allow")
    total = np.asarray(run.energy.total)
    return _distance(run, exact), float(np.abs(total - total[0]).max())


def _seconds_per_step(scene: Scene, method: str, step: float, steps: int = 10_000) -> float:
    """Time of a step [s] in the fastest of several runs after a warm-up; the runs are long, so set-up is negligible."""
    duration = steps * step
    timed = scene.varied(
        {"run": RunSettings(method=method, step=step, sample=duration, duration=duration, unstable="allow")}
    )
    return race({method: lambda _: simulate(timed)}, turns=3, turn=0.0)[method] / steps


def _distance(a: Trajectory, b: Trajectory) -> float:
    return float(np.abs(a.q - b.q).max())


def _stability(scene: Scene, method: str, exact: Trajectory) -> Measured:
    """Largest stable step, by bisection, relative to the smallest one predicted for configurations during the run."""
    some = exact.q[:: max(1, len(exact.q) // 50)]
    predicted = min(stable_step(exact.chain, q, method=method) for q in some)
    low, high = 0.5, 2.0
    while high - low > 0.002:
        middle = (low + high) / 2
        low, high = (middle, high) if _stable(scene, method, middle * predicted) else (low, middle)
    note = f"Predicted {predicted:.4g} s, measured {low * predicted:.4g} s."
    return Measured("stable step", low, scene.name, varied={"method": method}, note=note)


def _stable(scene: Scene, method: str, step: float) -> bool:
    """Whether a run is stable: the total energy changes by less than 1 % of the range of the gravity energy."""
    steps = round(scene.run.duration / step)
    try:
        run = simulate(scene, method=method, step=step, sample=step, duration=steps * step, unstable="allow")
    except DivergenceError:
        return False
    total = np.asarray(run.energy.total)
    return bool(np.abs(total - total[0]).max() < 0.01 * np.ptp(run.energy.gravity))
