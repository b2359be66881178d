"""Settling of the tip at the end of a move: settling time, overshoot, residual vibration.

All these quantities are computed from the samples of a run, which should be ten or more per period of the vibration.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, real, require_type, vector
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.results.tip_motion import centre_of_motion, distances, largest_distance
from flexlink.results.trajectory import Trajectory


def settling_time(run: Trajectory, *, target: ArrayLike, tolerance: float, after: float = 0.0) -> float:
    """Time after which the tip stays within a tolerance of its target to the end of the run.

    Parameters
    ----------
    run
        The run.
    target
        Rest position of the tip in frame 0, shape (3,) [m], `fl.tip_position(chain, rest.q)` with
        `rest = fl.solve_static(…)`.
    tolerance
        Largest distance from the target that counts as settled, > 0 [m].
    after
        Time from which settling is measured [s], such as the end of the move.

    Returns
    -------
    float
        Time [s] from `after` to the sample from which on all samples are within the tolerance; inf if the last is not.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or no sample follows `after`.

    Examples
    --------
    >>> rest = run.tip[-1]
    >>> print(fl.measures.settling_time(run, target=rest, tolerance=0.02) < 1.0)  # s
    True
    """
    after = real("after", after, "a time [s]")
    t, tip = _from(run, after)
    outside = np.flatnonzero(distances(tip, vector("target", target, 3)) > positive("tolerance", tolerance))
    first = outside[-1] + 1 if outside.size else 0
    return float(t[first]) - after if first < len(t) else math.inf


def overshoot(run: Trajectory, *, target: ArrayLike) -> float:
    """Largest distance by which the tip passes its target, along the straight line from its start to the target.

    Parameters
    ----------
    run
        The run.
    target
        Rest position of the tip in frame 0, shape (3,) [m].

    Returns
    -------
    float
        Largest u·(p − target) [m], where u is the unit vector from the tip's start to the target; 0 if the tip does not
        pass the target. Divided by |target − p(0)| it is the overshoot of control theory.

    Raises
    ------
    ArgumentError
        `target` has the wrong shape, is not finite, or is where the tip starts; or the run has no sample.

    Examples
    --------
    >>> print(f"{1e3 * fl.measures.overshoot(run, target=run.tip[-1]):.0f} mm beyond")
    26 mm beyond
    """
    _, tip = _from(run, -math.inf)
    goal = vector("target", target, 3)
    way = largest_distance(tip[:1], goal)
    if way == 0:
        raise ArgumentError(
            f"target = {truncated(goal.tolist())}: equals the tip's start, so there is no travel to overshoot",
            id="no-travel",
        )
    return max(0.0, float(((tip - goal) @ (goal - tip[0]) / way).max()))


def residual_vibration(run: Trajectory, *, after: float) -> float:
    """Amplitude of the tip's residual vibration after a move, wherever the tip comes to rest.

    Parameters
    ----------
    run
        The run, which continues for at least half a period after the move.
    after
        End of the move [s].

    Returns
    -------
    float
        Largest distance [m] between the tip, from the time `after` on, and the centre of the box around its path, with
        edges along the axes of frame 0. For vibration along a line it is half the peak-to-peak range.

    Raises
    ------
    ArgumentError
        `after` is not a number, or fewer than two samples follow.

    Examples
    --------
    >>> print(f"{1e3 * fl.measures.residual_vibration(run, after=0.5):.0f} mm")  # the move ends at 0.5 s
    17 mm
    """
    _, tip = _from(run, after, least=2)
    return largest_distance(tip, centre_of_motion(tip))


def _from(run: Trajectory, after: float, least: int = 1) -> tuple[Array, Array]:
    """Times and positions of the tip from `after` on."""
    t = require_type("run", run, Trajectory).t
    kept = t >= real("after", after, "a time [s]")
    if kept.sum() < least:
        span = f"run from {t[0]:g} to {t[-1]:g} s" if len(t) else "run without samples"
        raise ArgumentError(
            f"after = {truncated(after)}: a {span} has {kept.sum()} samples from that time on; needs at least {least}",
            id="too-few-samples",
        )
    return t[kept], run.tip[kept]
