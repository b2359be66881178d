"""Outcome of a run in another engine, judged by the same reference: right, failed with an error, or silently wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from flexlink import engines
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from validation.extremes.outcomes import RunOutcome, Truth, judged
from validation.trade.mujoco_runs import INTEGRATORS


def outcome_beside(scene: Scene, name: str, method: str, truth: Callable[[], Truth]) -> RunOutcome:
    """Run a scene with fixed steps in an engine; it refuses no step and checks no result."""
    run, started = scene.run, time.thread_time()
    if run.duration / run.step > 20_000:  # nobody can stop them
        return RunOutcome("dear", np.nan, f"{round(run.duration / run.step)} steps", 0.0)
    try:
        chain = lump(scene)
        engine = engines.load(name, chain)
        if name == "mujoco":
            engine.model.opt.integrator = INTEGRATORS[method]  # type: ignore[attr-defined]
        _, q, _ = engine.integrate(scene.varied({"run.unstable": "allow"}))
        tip = np.array([tip_position(chain, row) for row in q])
    except FlexlinkError as error:
        return RunOutcome("error", math.nan, str(error), time.thread_time() - started)
    return judged(scene, tip, truth(), "", time.thread_time() - started)
