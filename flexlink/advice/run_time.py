"""Measure the CPU time of the recommended run, for a complete run and for a repetition.

Choices and their reasons depend only on listed costs (`evaluation_cost`), not on these times.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from time import thread_time

from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.describe.run_settings import AUTO
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import EvaluationLimitError


def run_time(scene_of: Callable[[], Scene], enough: float = 0.05) -> tuple[float, float]:
    """Shortest CPU times [s] of a complete run, and of a prepared run, as with a `Problem`.

    A complete run uses a new scene, so nothing is prepared. After `enough` CPU time [s] runs are not repeated, because
    other programs disturb long runs less. Errors are as in `simulate`.
    """
    whole, again = list[float](), list[float]()
    # two to five times: the first run may load or compile code
    while len(whole) < 2 or (len(whole) < 5 and sum(whole[1:] + again) < enough):
        scene = scene_of()
        for times in (whole, again):
            started = thread_time()
            simulate(scene)
            times.append(thread_time() - started)
    return min(whole), min(again)


def own_time(scene: Scene, most: float) -> float:
    """CPU time of a prepared run of the original scene [s]; inf if listed costs exceed `most` [s], nan if it fails."""
    run, chain = scene.run, lump(scene)
    name = "Radau5" if run.method == AUTO else run.method
    evaluations = min(run.max_evaluations, max(1.0, most / run_cost(chain, name, 1.0)))
    if not run.controlled and method(name).stages * run.duration / run.fixed_step > evaluations:
        return math.inf
    taken = math.nan
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the user did not request this run
            for _ in range(2):
                started = thread_time()
                simulate(scene, max_evaluations=evaluations)
                taken = thread_time() - started
    except EvaluationLimitError:
        return math.inf
    except FlexlinkError:
        return math.nan
    return taken
