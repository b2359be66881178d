"""CPU time of the run that advice hands over, measured where it is given: of its whole, and of its repetition.

What is chosen, and why, follows from costs by a list, `evaluation_cost`: the same on any machine, at any time.
"""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time
from typing import NamedTuple

from flexlink.describe.scene import Scene
from flexlink.motion.simulate import Problem

REPEATS = 5
ENOUGH = 0.05
"""Repeats, at most, and time [s] after which none begins: the shortest counts, and a long run needs no other."""


class RunTime(NamedTuple):
    """CPU time of a run [s]."""

    whole: float  # of `simulate` from a scene
    again: float  # of `Problem.simulate`, prepared before


def run_time(scene_of: Callable[[], Scene]) -> RunTime:
    """The shortest times of a run, by a scene that is made anew for each, so that nothing of it is prepared.

    Errors as in `simulate`.
    """
    found: list[RunTime] = []
    began = thread_time()
    while not found or (len(found) < REPEATS and thread_time() - began < ENOUGH):
        scene = scene_of()
        started = thread_time()
        problem = Problem(scene)
        problem.simulate()
        ended = thread_time()
        problem.simulate()
        found.append(RunTime(ended - started, thread_time() - ended))
    return RunTime(*map(min, zip(*found, strict=True)))
