"""Other programs on the exported chain: MuJoCo at fixed steps, SciPy with Pinocchio's accelerations, Drake.

As in the trade study, only MuJoCo's and Drake's steps are timed. Pinocchio's time is the number of evaluations × the
least time of an ABA in a C++ loop; SciPy and the interpreter cost nothing. Drake would call Python for drives and dry
friction, so it runs scenes without them, in a child process, which may crash.
"""

from __future__ import annotations

import functools

from flexlink.common.memo import Memo
from flexlink.describe.scene import Scene
from flexlink.engines.child_process import ChildProcess
from validation.formulations.flexlink_links import chain_scene
from validation.formulations.task import Outcome, Setting, Task
from validation.trade.contestants import Contestant
from validation.trade.scenes import seen
from validation.trade.with_mujoco import Mujoco
from validation.trade.with_pinocchio import Pinocchio

RULE = "gauss"  # the default rule, which every file format can describe
MOST = 15_000  # evaluations in Pinocchio: half a second of Python; longer runs take far longer than any other program's
LONGEST = 60.0  # s of CPU of a run in Drake; at most 6 are needed, so that a slow machine gives up none
STUCK = 600.0  # s: a call that does not return is ended
LOADED = Memo(4)  # of a chain: MuJoCo's callback for drive and friction is compiled once


def run(task: Task, element: str, setting: Setting) -> Outcome:
    """Run with a program and its method, "PROGRAM METHOD", and its step, tolerance or accuracy."""
    program, _, method = element.partition(" ")
    scene, key = chain_scene(task, RULE, setting), (program, setting["hinges"])
    if program == "drake":
        found: Outcome = _child().call(f"Drake: {task.name}", STUCK, in_drake, scene, method, setting["accuracy"])
        return found
    if program == "mujoco":
        return _outcome(LOADED(task.scene, key, lambda: Mujoco(scene)), method, scene.run.spacing / setting["step"])
    loaded = LOADED(task.scene, key, lambda: Pinocchio(scene, setting.get("most", MOST)))
    return _outcome(loaded, method, setting["tolerance"])._replace(counted=True)


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
    from validation.trade.with_drake import Drake  # noqa: PLC0415  needs Drake, which may crash a process

    return _outcome(Drake(scene, LONGEST), scheme, accuracy)


def _outcome(contestant: Contestant, method: str, setting: float) -> Outcome:
    found, chain = contestant.run(method, setting), contestant.chain
    return Outcome(seen(chain, found.q).tip, found.seconds, chain.freedoms - len(contestant.scene.motion))
