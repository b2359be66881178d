"""MuJoCo's integrators on the exported chain, at fixed steps and without Python; only its steps are timed."""

from __future__ import annotations

from flexlink.common.memo import Memo
from validation.formulations.flexlink_links import chain_scene
from validation.formulations.outcome import Outcome, Setting
from validation.formulations.task import Task
from validation.trade.mujoco_ladder import MujocoRuns
from validation.trade.scenes import seen

RULE = "gauss"  # the default rule, which every file format can describe
LOADED = Memo(2)  # of a chain: its callback for drive and friction is compiled once


def run(task: Task, integrator: str, setting: Setting) -> Outcome:
    """Run with steps that divide the time between samples."""
    runs = LOADED(task.scene, setting["hinges"], lambda: MujocoRuns(chain_scene(task, RULE, setting)))
    q, seconds = runs.run(integrator, round(task.scene.run.spacing / setting["step"]))
    return Outcome(seen(runs.chain, q).tip, seconds, runs.chain.freedoms)
