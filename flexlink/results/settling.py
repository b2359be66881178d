"""How the tip comes to rest at the end of a move: settling time, overshoot, residual vibration.

All look at the samples of a run; between two of them the tip may be elsewhere: take ten or more a period.
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
    """Time until the tip is and stays, as far as the run goes, within a tolerance of its target.

    Parameters
    ----------
    run
        The run.
    target
        Where the tip comes to rest, frame 0, shape (3,) [m]: `fl.tip_position(chain, rest.q)`, rest of `solve_static`.
    tolerance
        Largest distance from there that counts as settled, > 0 [m].
    after
        When the clock starts [s], such as the end of the move.

    Returns
    -------
    float
        Time [s] from `after` to the first sample from which on all are within; inf where the last one is not.

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
    """How far the tip gets beyond its target, along the straight line there from where it was first.

    Parameters
    ----------
    run
        The run.
    target
        Where the tip comes to rest, frame 0, shape (3,) [m].

    Returns
    -------
    float
        Largest u·(p − target) [m], u the direction from the first place of the tip to the target; 0 where it does not
        get beyond. By |target − p(0)| it is the overshoot of control theory.

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
    """Amplitude of the tip's vibration that is left when a move is over, whatever its place of rest.

    Parameters
    ----------
    run
        The run, which goes on for at least half a period after the move.
    after
        End of the move [s].

    Returns
    -------
    float
        Largest distance of the tip from the middle of all its places from `after` on, the centre of the smallest box
        along frame 0 that holds them [m]: half the way from peak to peak of a vibration along a line.

    Raises
    ------
    ArgumentError
        `after` is not a number, or less than two samples follow.

    Examples
    --------
    >>> print(f"{1e3 * fl.measures.residual_vibration(run, after=0.5):.0f} mm")  # the move ends at 0.5 s
    17 mm
    """
    _, tip = _from(run, after, least=2)
    return largest_distance(tip, centre_of_motion(tip))


def _from(run: Trajectory, after: float, least: int = 1) -> tuple[Array, Array]:
    """Times and places of the tip from `after` on."""
    t = require_type("run", run, Trajectory).t
    kept = t >= real("after", after, "a time [s]")
    if kept.sum() < least:
        span = f"run from {t[0]:g} to {t[-1]:g} s" if len(t) else "run without samples"
        raise ArgumentError(
            f"after = {truncated(after)}: a {span} has {kept.sum()} samples from that time on; needs at least {least}",
            id="too-few-samples",
        )
    return t[kept], run.tip[kept]
