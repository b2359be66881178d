"""What becomes of a run in another engine, judged by the same truth: right, said to have failed, or silently wrong."""

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
from validation.extremes.outcomes import Found, Truth, judged
from validation.trade.mujoco_runs import INTEGRATORS


def outcome_beside(scene: Scene, name: str, method: str, truth: Callable[[], Truth]) -> Found:
    """Run a scene with fixed steps in an engine as it is: no step is refused, and nothing doubts the result."""
    run, started = scene.run, time.thread_time()
    if run.duration / run.step > 20_000:  # nobody can stop them
        return Found("dear", np.nan, f"{round(run.duration / run.step)} steps", 0.0)
    try:
        chain = lump(scene)
        engine = engines.load(name, chain)
        if name == "mujoco":
            engine.model.opt.integrator = INTEGRATORS[method]  # type: ignore[attr-defined]
        _, q, _ = engine.integrate(scene.varied({"run.unstable": "allow"}))
        tip = np.array([tip_position(chain, row) for row in q])
    except FlexlinkError as error:
        return Found("error", math.nan, str(error), time.thread_time() - started)
    return judged(scene, tip, truth(), "", time.thread_time() - started)
