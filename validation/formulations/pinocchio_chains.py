"""SciPy's solvers with Pinocchio's accelerations on the exported chain: number of evaluations × least time of an ABA.

As in the trade study, the time is that of Pinocchio's ABA in a C++ loop; SciPy and the interpreter cost nothing. Runs
with more than `MOST` evaluations are given up: they would take far longer than any other program's.
"""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.memo import Memo
from validation.formulations.flexlink_links import chain_scene
from validation.formulations.outcome import Outcome, Setting
from validation.formulations.task import Task
from validation.trade.pinocchio_ladder import PinocchioForm, seconds_of_aba

RULE = "gauss"  # the default rule, which every file format can describe
MOST = 15_000  # evaluations: half a second of Python
LOADED = Memo(2)


def run(task: Task, solver: str, setting: Setting) -> Outcome:
    """Run with a relative tolerance; the absolute one is a hundredth of it."""

    def load() -> tuple[PinocchioForm, float]:
        form = PinocchioForm(chain_scene(task, RULE, setting), setting.get("most", MOST))
        return form, seconds_of_aba(form.chain)

    form, aba = LOADED(task.scene, setting["hinges"], load)
    form.evaluations = 0
    try:
        found = form.by_scipy(solver, setting["tolerance"])
    except np.linalg.LinAlgError as error:
        raise FlexlinkError(f"{task.name}: {solver} diverges: {error}") from error
    return Outcome(found.tip, found.evaluations * aba, form.chain.freedoms - len(form.led), counted=True)
