"""Links as chains of hinges, and as strain modes on their hinges: complete calls of a problem that has run before."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from validation.formulations.task import Outcome, Setting, Task

ADVICE = Memo(4)


def run(task: Task, element: str, setting: Setting) -> Outcome:
    """Run with a lumping rule, with strain modes on the stations of that rule, "RULE SHAPES", or "advise"."""
    if element == "advise":
        return _advised(task, setting)
    scene = chain_scene(task, element, setting)
    return _statics(task, scene) if task.moment else _timed(task, fl.Problem(scene))


def _advised(task: Task, setting: Setting) -> Outcome:
    """Ask for a tip error, as a fraction of the length, and time the run of the scene that is picked."""
    error = setting["tip"]
    advice = ADVICE(task.scene, error, lambda: fl.advise(task.scene, tip=f"{1e3 * error * task.length:.9g} mm"))
    met = "" if advice.met else " that it cannot meet"
    note = f"advice{met} took {advice.compute_time:.2g} s and {advice.runs} runs"
    return _timed(task, fl.Problem(advice.scene))._replace(note=note)


def _timed(task: Task, problem: fl.Problem) -> Outcome:
    """Run a problem, and time it when it runs again."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # about doubtful results; here a reference measures the error
        problem.simulate()
        begun = time.thread_time()
        found = problem.simulate()
        seconds = time.thread_time() - begun
    return Outcome(found.tip, seconds, found.chain.freedoms - (task.held == "moved"))


def chain_scene(task: Task, element: str, setting: Setting) -> Scene:
    """The scene with a lumping rule and its number of hinges per link, with a tolerance, and with strain modes."""
    rule, _, shapes = element.partition(" ")
    change: dict[str, Any] = {
        "link.*.lumping": rule, "link.*.segments": round(setting["hinges"]) + 1, "run.method": "auto",
        "run.step": None, "run.tolerance": setting.get("tolerance", 1e-3) * task.length,
    }  # fmt: skip
    if shapes:
        count = round(setting["modes"])
        change["link.*.modes"] = {"x": count, "y": count, "z": count, "shapes": shapes}
    return task.scene.varied(change)


def _statics(task: Task, scene: Scene) -> Outcome:
    """Solve for the equilibrium under the end moment."""
    chain, wrench = fl.lump(scene), np.array([0.0, 0.0, 0.0, 0.0, 0.0, task.moment])

    def tip() -> Array:
        return fl.tip_position(chain, fl.solve_static(chain, tip_wrench=wrench).q)

    tip()
    begun = time.thread_time()
    found = tip()
    return Outcome(found[None], time.thread_time() - begun, chain.freedoms)
