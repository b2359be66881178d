"""Check the times of a record against the arm's slowest mode.

A record shows a mode if it covers at least a tenth of the mode's period, with two or more samples per period.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from flexlink.chain.lumping import lump
from flexlink.common.errors import DataFileError, Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.steady import first_elastic_frequency
from flexlink.identification.block import Block
from flexlink.motion.inputs.actuation import initial_wrench
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate


def slowest_mode(scene: Scene) -> float:
    """Natural frequency of the slowest elastic mode at rest, with driven joints locked [Hz]; nan if there is none."""
    try:
        chain = lump(scene)
        wrench, frame = initial_wrench(scene, chain)
        return first_elastic_frequency(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame)
    except FlexlinkError:  # for example, an arm without a static equilibrium
        return np.nan


def in_periods(t: Array, hertz: float) -> str:
    """Text with the length of a record and the number of periods of the slowest mode that it contains.

    >>> print(in_periods(np.linspace(0.0, 3.0, 601), 2.5))
    3 s, 7.5 periods of the slowest mode, 2.5 Hz
    """
    length = float(t[-1] - t[0])
    periods = f", {length * hertz:.3g} periods of the slowest mode, {hertz:.3g} Hz" if hertz > 0 else ""
    return f"{length:.4g} s{periods}"


def doubts_of_times(scene: Scene, blocks: Sequence[Block], t: Array, hertz: float) -> tuple[Diagnostic, ...]:
    """Warnings about the times t of a record, shape (samples,) [s]."""
    shown = 0.1  # smallest length of a record that shows the slowest mode, in periods of this mode
    length, between = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    if length * hertz < shown:
        text = f"the record is {length:.3g} s long, {length * hertz:.2g} of a period of the slowest mode, "
        text += f"{hertz:.3g} Hz; if its times are in s, name the column 't [s]'"
        return (Diagnostic(text, "record-too-short"),)
    if not 2 * between * hertz > 1:
        return ()
    spacing = f"samples are {between:.3g} s apart, {length:.4g} s in total: too far apart for the mode of "
    spacing += f"{hertz:.3g} Hz, which needs a sample every {1 / (2 * hertz):.2g} s or less"
    if not _swings(scene, blocks, hertz, between):
        return (Diagnostic(f"{spacing}; this mode is not excited", "sampling-too-slow"),)
    text = f"{spacing}, and which the simulation excites; if the times are in ms, name the column 't [ms]'"
    raise DataFileError(text, id="likely-unit")


def as_long(scene: Scene, t: Array, margin: float = 0.0) -> Scene:
    """The scene with a run as long as the record, at its times if possible; with a `margin` [s] longer and finer."""
    finer = 4  # samples of the run per sample of the record, for times that are shifted
    between = float(np.median(np.diff(t))) / (finer if margin else 1)
    length = float(t[-1]) - scene.initial.time + margin
    for sample in (float(f"{between:.9g}"), scene.run.spacing):
        duration = max(math.ceil(length / sample - 1e-6), 1) * sample
        try:
            return scene.varied({"run.sample": sample, "run.duration": float(f"{duration:.12g}")})
        except FlexlinkError as error:
            reason = error
    raise reason


def _swings(scene: Scene, blocks: Sequence[Block], hertz: float, between: float) -> bool:
    """Whether the simulation deviates from a spline through its samples by a large part of the measured range.

    The simulation covers several periods of the slowest mode and enough samples for a spline. If that takes too long,
    a straight line replaces the spline.
    """
    periods, most, per_period = 20, 400, 20  # smallest and largest number of periods; samples per period
    few = 8  # smallest number of the record's samples that the simulation covers
    part = 0.1  # smallest deviation from the spline that counts, relative to the measured range
    every = max(round(between * hertz * per_period), 1)
    count = min(max(periods * per_period, few * every), most * per_period)
    t = np.asarray(scene.initial.time + between / every * np.arange(count), np.float64)
    try:
        run = simulate(as_long(scene, t))
    except FlexlinkError:  # the error is reported when the run itself is needed
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
