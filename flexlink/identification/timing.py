"""Whether the times of a record fit the arm: its length and rate beside the arm's slowest mode.

A record shows a mode that swings at least once in ten of its lengths, and has two samples in each period or more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from flexlink.chain.lumping import lump
from flexlink.common.errors import DataFileError, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.at_rest import first_elastic_frequency
from flexlink.identification.block import Block
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.tip_wrench import initial_wrench
from flexlink.motion.simulate import simulate


def slowest_mode(scene: Scene) -> float:
    """Frequency of the slowest elastic mode at rest, the driven joints held [Hz]; nan where there is none."""
    try:
        chain = lump(scene)
        wrench, frame = initial_wrench(scene, chain)
        return first_elastic_frequency(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame)
    except FlexlinkError:  # such as an arm that does not rest
        return np.nan


def in_periods(t: Array, hertz: float) -> str:
    """How long a record is, and how much of the slowest mode it shows.

    >>> print(in_periods(np.linspace(0.0, 3.0, 601), 2.5))
    3 s, 7.5 periods of the slowest mode, 2.5 Hz
    """
    length = float(t[-1] - t[0])
    return f"{length:.4g} s" + (
        f", {length * hertz:.3g} periods of the slowest mode, {hertz:.3g} Hz" if hertz > 0 else ""
    )


def doubts_of_times(scene: Scene, blocks: Sequence[Block], t: Array, hertz: float) -> tuple[str, ...]:
    """What is to be known of the times t of a record, shape (samples,) [s].

    Raises
    ------
    DataFileError
        Samples are too far apart to show a mode in which the scene swings as far as was measured.
    """
    shown = 0.1  # part of a period that a record must have at least
    length, between = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    if length * hertz < shown:
        return (
            f"the record is {length:.3g} s long, {length * hertz:.2g} of a period of the slowest mode, {hertz:.3g} Hz; "
            "if its times are in s, their head is 't [s]'",
        )
    if not 2 * between * hertz > 1:
        return ()
    told = (
        f"samples are {between:.3g} s apart, {length:.4g} s in all: too far for the slowest mode, {hertz:.3g} Hz, "
        f"which needs one every {1 / (2 * hertz):.2g} s or more often"
    )
    if not _swings(scene, blocks, hertz, between):
        return (f"{told}; that mode is not seen",)
    raise DataFileError(
        f"{told}, and in which the scene swings; if the times are in ms, their head is 't [ms]'", id="likely-unit"
    )


def as_long(scene: Scene, t: Array) -> Scene:
    """The scene with a run as long as its record, sampled as that is where it can be."""
    between = float(np.median(np.diff(t)))
    length = float(t[-1]) - scene.initial.time
    for sample in (float(f"{between:.9g}"), scene.run.spacing):
        duration = max(math.ceil(length / sample - 1e-6), 1) * sample
        try:
            return scene.varied({"run.sample": sample, "run.duration": float(f"{duration:.12g}")})
        except FlexlinkError as error:
            reason = error
    raise reason


def _swings(scene: Scene, blocks: Sequence[Block], hertz: float, between: float) -> bool:
    """Whether a scene moves between samples by a good part of what was measured: beside splines through them.

    For some periods of its slowest mode, and as many samples as are enough for a spline where that is not endless;
    else beside a straight line.
    """
    periods, most, per_period = 20, 400, 20  # of the slowest mode, at least and at most; samples of each
    few = 8  # samples of the record
    part = 0.1  # of what was measured
    every = max(round(between * hertz * per_period), 1)
    count = min(max(periods * per_period, few * every), most * per_period)
    t = np.asarray(scene.initial.time + between / every * np.arange(count), np.float64)
    try:
        run = simulate(as_long(scene, t))
    except FlexlinkError:  # reported where the run itself is needed
        return False
    for block in blocks:
        y = scipy.interpolate.CubicSpline(run.t, run.columns[block.name])(t)
        if count > few * every // 2:
            inside = slice(None, (count - 1) // every * every + 1)
            between_samples = y[inside] - scipy.interpolate.CubicSpline(t[::every], y[::every])(t[inside])
        else:
            between_samples = y - np.polyval(np.polyfit(t - t[0], y, 1), t - t[0])
        if np.ptp(between_samples) > part * np.ptp(block.y):
            return True
    return False
