"""Drake's error-controlled integrators on the exported chain, in a child process, which may crash; only they are timed.

Drake would call Python for drives and dry friction, so it runs scenes without them.
"""

from __future__ import annotations

import functools

from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.engines.child_process import ChildProcess
from validation.formulations.flexlink_links import chain_scene
from validation.formulations.outcome import Outcome, Setting
from validation.formulations.task import Task
from validation.trade.scenes import seen

RULE = "gauss"  # the default rule, which every file format can describe
LONGEST = 5.0  # s of CPU of a run
STUCK = 60.0  # s: a call that does not return is ended


def run(task: Task, scheme: str, setting: Setting) -> Outcome:
    """Run with a target accuracy."""
    scene = chain_scene(task, RULE, setting)
    found: Outcome = _child().call(f"Drake: {task.name}", STUCK, in_drake, scene, scheme, setting["accuracy"])
    return found


@functools.cache
def _child() -> ChildProcess:
    return ChildProcess()


def in_drake(scene: Scene, scheme: str, accuracy: float) -> Outcome:
    """Run in this process, which needs Drake.

    Raises
    ------
    FlexlinkError
        Drake gives up, or the run takes too long.
    """
    from validation.trade.drake_ladder import DrakeRuns  # noqa: PLC0415  needs Drake, which may crash a process

    runs = DrakeRuns(scene)
    found = runs.run(scheme, accuracy, LONGEST)
    if found is None or found.q is None:
        raise FlexlinkError(f"{scene.name}: Drake's {scheme} does not reach the end within {LONGEST:g} s")
    return Outcome(seen(runs.chain, found.q).tip, found.seconds, runs.chain.freedoms)
