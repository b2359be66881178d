"""How a column of a run changes with numbers of its scene, where that of its states is known: evaluated, not run again.

    dy/dp = ∂y/∂p + ∂y/∂q dq/dp + ∂y/∂q̇ dq̇/dp

is the slope of y along p and the states q + h dq/dp, q̇ + h dq̇/dp together, by central differences of fourth order.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.record import trajectory_from_states
from flexlink.results.trajectory import Trajectory

NUDGE = 1e-3
"""Part of a number, and angle or rate [rad, rad/s] of any joint, by which the states are moved at most: the differences
are then off by 1e-12 of what the column is made of, and rounding by a few 1e-13 / NUDGE of it."""
CENTRAL = {1: 8 / 12, -1: -8 / 12, 2: -1 / 12, -2: 1 / 12}
FORWARD = {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4}
"""Of differences: how many steps, and the weight; forward where the number is at the least that is allowed."""


def column_slope(run: Trajectory, path: str, value: float, name: str, dq: Array, dqd: Array) -> Array:
    """dy/dp of a column at the samples (samples,), of states that change by `dq`, `dqd` (samples, n).

    Raises
    ------
    ArgumentError
        There is no such column, or none whose slope is known so: works are integrals.
    """
    scene = _smooth(run.scene)
    known = [name for name in run.columns if name not in {"t [s]", "work [J]", "imbalance [J]"}]
    if name not in known:
        raise ArgumentError(
            f"name = {truncated(name)}: no column with a slope; allowed are {short_list(known)}"
            f"{did_you_mean(name, known)}"
        )
    fastest = max(float(np.abs(part).max(initial=0.0)) for part in (dq, dqd))
    h = NUDGE * min(abs(value) or 1.0, 1 / fastest if fastest else np.inf)
    slope = np.zeros(len(run.t))
    for step, weight in (CENTRAL if _allowed(scene, path, value - 2 * h) else FORWARD).items():
        problem = problem_of(scene.varied({path: value + step * h}))
        moved = trajectory_from_states(problem, run.t.copy(), run.q + step * h * dq, run.qd + step * h * dqd)
        slope += weight / h * moved.columns[name]
    return slope


def _allowed(scene: Scene, path: str, value: float) -> bool:
    try:
        scene.varied({path: value})
    except SceneError:
        return False
    return True


def _smooth(scene: Scene | None) -> Scene:
    """The scene without what makes readings of sensors jump."""
    if scene is None:
        raise ArgumentError("run: does not know its scene")
    return replace(scene, sensor=tuple(replace(each, noise=0.0, seed=None, resolution=None) for each in scene.sensor))
