"""CPU time of the run that advice hands over, measured where it is given: of its whole, and of its repetition.

What is chosen, and why, follows from costs by a list, `evaluation_cost`, and never from these times.
"""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time

from flexlink.describe.scene import Scene
from flexlink.motion.simulate import simulate


def run_time(scene_of: Callable[[], Scene], enough: float = 0.05) -> tuple[float, float]:
    """The shortest CPU times [s] of a run, and of one that is prepared, as a `Problem` is.

    Of the first nothing is prepared, by a scene that is made anew each time.
    After `enough` CPU time [s] it is not made more often: other programs disturb a long run less. Errors as in
    `simulate`.
    """
    whole, again = list[float](), list[float]()
    # from two to five times: the first run may load or compile code
    while len(whole) < 2 or (len(whole) < 5 and sum(whole[1:] + again) < enough):
        scene = scene_of()
        for times in (whole, again):
            started = thread_time()
            simulate(scene)
            times.append(thread_time() - started)
    return min(whole), min(again)
