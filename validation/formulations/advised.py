"""The chain and steps that `advise` picks for an error of the tip: complete calls of a problem that has run before."""

from __future__ import annotations

import flexlink as fl
from flexlink.common.memo import Memo
from validation.formulations.flexlink_links import timed
from validation.formulations.outcome import Outcome, Setting
from validation.formulations.task import Task

ADVICE = Memo(4)


def run(task: Task, _element: str, setting: Setting) -> Outcome:
    """Ask for a tip error, as a fraction of the length, and time the run of the scene that is picked."""
    error = setting["tip"]
    advice = ADVICE(task.scene, error, lambda: fl.advise(task.scene, tip=f"{1e3 * error * task.length:.9g} mm"))
    met = "" if advice.met else " that it cannot meet"
    note = f"advice{met} took {advice.compute_time:.2g} s and {advice.runs} runs"
    return timed(task, fl.Problem(advice.scene))._replace(note=note)
