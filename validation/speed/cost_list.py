"""Costs of the operations of adaptive steps, measured on random arms and fitted.

    python -m validation.speed.cost_list 240 > flexlink/motion/data/evaluation_costs.toml     # seeds 0 … 239

Random planar and spatial arms, plain and full (`flexlink.motion.inputs.actuation`), are run by every method with three
tolerances. Each run's compiled loop is timed (the shortest of five repeats) and its operations are counted; a single
evaluation is timed as well. The costs are fitted to all times by non-negative least squares of relative errors (NNLS).
Costs of samples and of calls from Python are also fitted, but not listed. Times are CPU times of one thread, which
depend little on other processes.
"""

from __future__ import annotations

import collections
import datetime
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

import flexlink as fl
from flexlink.common.types import Array
from flexlink.motion.adaptive_steps import AdaptiveSteps
from flexlink.motion.evaluation_cost import OPERATIONS, evaluation_time, parts_of
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from validation.random_arms import Dice, random_arm, random_tree

METHODS = ("Radau5", "Radau9", "DOP853")
TOLERANCES = (1e-2, 1e-4, 1e-6)  # tolerances of the runs, as fractions of the arm's reach
TURNS = 5
AFFORDABLE = 3e4  # largest number of evaluations of a run
FIRST_SEED = 71_000  # the seeds from here on differ from those that test `auto`
BESIDE = 2  # number of fitted costs that are not listed: samples and calls
PARTS = ("start", "body", "body", "body", "body", "coupling", "dry", "driven", "model")


class Timed(NamedTuple):
    """A run: its kind; counts of each part of each operation, of samples and of calls; its time [µs]."""

    kind: tuple[str, str, str]
    counts: Array
    microseconds: float


def scenes(seeds: range) -> Iterator[fl.Scene]:
    """Random arms with drives of every kind: half of them planar, others in space, and trees."""
    for seed in seeds:
        dice = Dice(FIRST_SEED + seed)
        try:
            scene = planar(dice) if seed % 2 == 0 else (random_arm, random_tree)[seed // 2 % 2](FIRST_SEED + seed)
            yield scene.varied({"drive": drive_of(dice, scene), "run": fl.RunSettings(duration=0.3, sample=0.03)})
        except fl.FlexlinkError:
            continue


def planar(dice: Dice) -> fl.Scene:
    """An arm of one to four links with parallel joint axes; links are rigid or bend in the plane of motion."""
    links = []
    for k in range(dice.one_of(1, 2, 3, 4)):
        flex = dice.one_of("rigid", "z", "z")
        links.append(fl.Link(
            name=f"link{k}", length=dice.linear(0.3, 1.0), flex=flex, material="stuff", section="bar",
            segments=1 if flex == "rigid" else dice.one_of(3, 5, 9, 17),
            lumping=dice.one_of("gauss", "paper", "lobatto2"),
            joint=fl.Joint(viscous=dice.one_of(0.0, 0.5), coulomb=dice.one_of(0.0, 0.0, 0.5), armature=0.05,
                           quadratic=dice.one_of(0.0, 0.0, 0.1)),
        ))  # fmt: skip
    return fl.Scene(
        name="planar",
        arm=fl.Arm(
            links=tuple(links), tip=fl.RigidBody(mass=dice.one_of(0.0, 1.0)),
            materials={"stuff": fl.Material(young=dice.decades(9, 11), density=2700.0,
                                            loss_time=dice.one_of(0.0, 1e-4))},
            sections={"bar": fl.Section(shape="rectangle", height=dice.linear(0.01, 0.03), width=0.03)},
        ),
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=tuple(dice.linear(-90, 90) for _ in links)),
    )  # fmt: skip


def drive_of(dice: Dice, scene: fl.Scene) -> fl.Drive:
    """A random drive: none or PD, with or without a model, sampling and torque limit."""
    links = scene.arm.links
    kind = dice.one_of("none", "pd", "pd", "rigid", "computed_torque")
    if kind == "none" or any(link.joint.slides for link in links) or scene.arm.base.kind == "free":
        return fl.Drive()
    free = [0.0 if link.joint.locked else 1.0 for link in links]
    ω, goal = (
        dice.linear(3, 10),
        tuple(angle + 10.0 * f for angle, f in zip(scene.initial.joint_deg, free, strict=True)),
    )
    size = 1.0 if kind == "computed_torque" else dice.decades(-0.5, 0.5)
    more: dict[str, Any] = {"gravity": "rigid"} if kind == "rigid" else {}
    if dice.chance(0.3):
        more["rate"] = 1000.0 / 3.0 if dice.chance(0.5) else 100.0
    elif dice.chance(0.3):
        more["effort"] = tuple(50.0 for _ in links)
    return fl.Drive(
        kind="computed_torque" if kind == "computed_torque" else "pd", target_deg=goal,
        kp=tuple(size * ω**2 * f for f in free), kd=tuple(size * 1.4 * ω * f for f in free), **more,
    )  # fmt: skip


def timed(scene: fl.Scene) -> Timed | None:
    """Shortest time of a run's compiled loop in several repeats; None if the run fails or takes no step."""
    least, counts, kind = np.inf, np.zeros(0), ("", "", "")
    try:
        problem = problem_of(scene)
        for _ in range(TURNS):
            steps = SingleRun(problem).steps
            assert isinstance(steps, AdaptiveSteps)
            times: list[float] = []
            steps._take_steps = clocked(steps._take_steps, times)
            for _reached in steps:
                pass
            if steps.failure or not times:
                return None
            if sum(times) < least:
                record, least = steps.record, sum(times)
                chain, drive = record.chain, record.inputs.drive
                kind = (
                    "plane" if chain.is_planar else "space", "plain" if chain.arrays.rare is None else "full",
                    "explicit" if steps.method.explicit else "implicit",
                )  # fmt: skip
                counts = np.append(design(steps.work_done, parts_of(chain, drive), drive), [steps.row, len(times)])
    except fl.FlexlinkError:
        return None
    return Timed(kind, counts, 1e6 * least)


def of_an_evaluation(scene: fl.Scene) -> Timed | None:
    """Time of a single evaluation, measured with steps of zero length; None if the scene is refused."""
    try:
        problem = problem_of(scene)
        chain, drive = problem.chain, problem.inputs.drive
        work_done = [1.0, *[0.0] * (len(OPERATIONS) - 1)]
        kind = (
            "plane" if chain.is_planar else "space", "plain" if chain.arrays.rare is None else "full", "explicit",
        )  # fmt: skip
        counts = np.append(design(work_done, parts_of(chain, drive), drive), [0.0, 0.0])
        return Timed(kind, counts, 1e6 * evaluation_time(problem))
    except fl.FlexlinkError:
        return None


def clocked(function: Callable[..., Any], times: list[float]) -> Callable[..., Any]:
    """Wrap a function so that each call appends its CPU time [s] to `times`."""

    def call(*arguments: Any) -> Any:
        started = time.thread_time()
        found = function(*arguments)
        times.append(time.thread_time() - started)
        return found

    return call


def design(work_done: Sequence[float], parts: Array, drive: Any) -> Array:
    """Counts of each part of each operation in a run, flattened, in the form that `operation_costs` uses."""
    counted = np.ones((len(OPERATIONS), len(PARTS)))
    limited = bool(np.min(drive.effort, initial=np.inf) < np.inf) and not drive.rate
    counted[:, 7:] = np.array([not drive.rate, limited, drive.rate > 0, *[0] * 6])[:, None]
    return np.asarray((np.array(work_done)[:, None] * counted * parts).ravel())


def fitted(runs: list[Timed]) -> tuple[Array, Array]:
    """Fit costs (operations, parts) [µs] to runs of one kind; also return ratios of fitted to measured times."""
    A, y = np.array([run.counts for run in runs]), np.array([run.microseconds for run in runs])
    found, _ = nnls(A / y[:, None], np.ones(len(y)), maxiter=100_000)
    return found[:-BESIDE].reshape(len(OPERATIONS), len(PARTS)), A @ found / y


def written(costs: Array) -> Iterator[str]:
    """Costs of the operations of one kind as TOML."""
    for name, row in zip(OPERATIONS, costs, strict=True):
        values = dict(zip(PARTS[5:], row[5:], strict=True))
        entries = [f"start = {row[0]:.4g}"] if row[0] else []
        if row[1:5].any():
            entries.append("body = [" + ", ".join(f"{x:.4g}" for x in row[1:5]) + "]")
        entries += [f"{part} = {value:.4g}" for part, value in values.items() if value]
        if entries:
            yield f"{name} = {{ {', '.join(entries)} }}"


def main() -> None:
    """Measure, fit, and print the list."""
    seeds = range(int(sys.argv[1]))
    warnings.simplefilter("ignore")
    runs = collections.defaultdict[tuple[str, str, str], list[Timed]](list)
    for number, scene in enumerate(scenes(seeds)):
        alone = of_an_evaluation(scene)
        if alone is not None:
            runs[alone.kind].append(alone)
        for method in METHODS:
            for tolerance in TOLERANCES:
                given = {"method": method, "relative_tolerance": tolerance, "max_evaluations": AFFORDABLE}
                run = timed(scene.varied({f"run.{key}": value for key, value in given.items()}))
                if run is not None:
                    runs[run.kind].append(run)
        print(number, file=sys.stderr, flush=True)
    print(HEAD.format(seeds=len(seeds), date=datetime.date.today()))
    for kind in sorted(runs):
        costs, ratio = fitted(runs[kind])
        spread = np.percentile(ratio, [5, 95])
        print(f"\n[{'.'.join(kind)}]  # {len(runs[kind])} runs; nine in ten within {spread[0]:.2f} … {spread[1]:.2f}")
        print(*written(costs), sep="\n")


HEAD = """\
# CPU time of the operations of a step [µs]: a base cost, and costs per body, by its number of hinges (0 … 3), per
# coupling of hinges, per joint with dry friction, per driven joint, and per driven joint with a model-based controller.
# Measured on {date} by
#
#     python -m validation.speed.cost_list {seeds}
#
# Runs of random arms with three tolerances by Radau5, Radau9 and DOP853, the shortest of five turns on a shared core of
# 3 GHz; non-negative least squares of relative errors. Another machine scales all costs by a similar factor, so
# comparisons and the cheapest method do not change; `flexlink info` measures seconds on the current machine. Operations
# that are not listed could not be separated from others."""


if __name__ == "__main__":
    main()
