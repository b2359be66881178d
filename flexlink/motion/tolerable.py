"""Errors that a run may have for a given tolerance, the steps whose errors are measured, and the stated error."""

import itertools
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.kernels.stepping.judgement import Allowance
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.results import balance
from flexlink.results.samples import RunSamples, StatedError
from flexlink.results.tip_motion import apart


class Thresholds:
    """Limits of the checks of a run, and of the choice of its method."""

    far_bent: float = float(np.radians(84.0))
    """Angle of a hinge beyond which a chain is a poor model of the beam [rad].

    The first and third of three axes at one point then nearly coincide, and cond(M) grows by a factor 1/cos² 84° = 90,
    so two decimal digits are lost.
    """
    a_degree: float = float(np.radians(1.0))  # increase of the largest hinge bend between two checks of M [rad]
    at_limit: float = 1e-9
    """Distance past a joint limit that is ignored [rad]: rounding error of a run that moves exactly to the limit."""
    held: float = 0.9  # part of a run at the limit of torque above which a law hardly controls its joint
    tip_share: float = 0.05
    """Tip error, relative to the tip's motion, above which a result is wrong: 5 %, as in `balance.SHARE`."""
    doubt: float = 0.1
    """Fraction of the limits `balance.SHARE` and `tip_share` above which a run is doubtful.

    It is well below 1 because only energy errors and the steps' own errors are measured. These are amplified by
    sensitive motion, and by motion that drifts out of phase.
    """
    far_turned: float = 8.0
    """Angle travelled by all joints [rad] above which a verification run is made.

    Errors of rates then become errors of angles, and configurations never repeat. In the project's models of arms that
    swing or move from place to place, joints travel at most 7.1 rad. Where errors exceeded ten tolerances, joints
    travelled at least 29 rad (among a thousand arms after an impact), or at least 8.8 rad (among 300 arms whose motors
    saturate and so hold nothing).
    """
    long: int = 100
    """An adaptive step shorter than the duration over this number may use only a proportional part of the tolerance."""
    tolerable: float = 3.0
    """Largest error of a run, in units of its tolerance, that is accepted; ideally 1, and at most 10 at the end."""
    usual: float = 0.5
    """Error that is stated where nothing indicates a larger one, in tolerances: measured, they are 0.02 to 1.3."""
    lasting: float = 0.1
    """Error relative to the displacement by estimated errors of rates that last.

    Measured on free arms, it is 0.001 to 0.5; the larger numbers belong to vibrations that the steps do not resolve.
    """
    large: float = 0.5
    """Estimated error, in tolerances, from which a run is compared with another one; half of it, if it lasts."""
    seen: float = 0.1  # smallest error that is stated where two runs were compared, in tolerances
    coarser: float = 10.0  # tolerance of a coarser run with which a run is compared, relative to that of the run
    shrinks: float = 2.0  # ratio of their distance to the error of the run that is stated; measured, it is 1.5 to 15
    unrepeated: float = 0.7
    """Estimated error, in tolerances, from which a run by a law in Python, which cannot be repeated, is doubtful.

    Among 430 random runs, eight exceeded three tolerances, the worst 51; their estimates were 0.76 or more. Twelve
    accurate ones had estimates above 0.7.
    """
    grown: float = 0.1
    """Distance of two runs, relative to the tip's motion, from which errors no longer grow in proportion to tolerances.

    Chaotic motions differ by their whole extent, however small the tolerance is.
    """
    runs: int = 4  # largest number of runs with which one run is compared
    finer: str = "Radau9"  # method of the runs with which implicit ones are compared
    few: int = 8
    """Minimum number of attempted steps after a restart, and minimum number from which a cost rate is computed."""
    switch: float = 1e-4  # CPU time of a switch to another method and back, without steps [s]
    trial: float = 0.03
    """Largest cost of the trial of a method, relative to the run so far; a trial takes at least twice `few` steps."""
    patience: Mapping[str, float] = MappingProxyType({"Radau5": 0.15, "Radau9": 0.4, "DOP853": 0.25})
    """Minimum cost of a run before it switches to a method, relative to the expected cost of the rest by that method.

    After a trial a third of it is enough, except for Radau9, to which the vibration after a start costs most; Radau5
    damps that vibration. On 90 random scenes with four tolerances, 0.15 or 0.3 for all three are equally good to 2 %.
    """


APART = 128
"""Number of steps between two error probes in a long run. A probe repeats a step as two half steps; this costs 2 %."""


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """Tolerance of a run [m]; relative tolerances refer to the arm's size, or to its largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.size)


def allowed_imbalance(run: RunSettings, chain: Chain, least: float, explicit: bool, compared: bool) -> Allowance:
    """Energy imbalance explained by position errors δ of the bodies as large as the tolerance: m g δ and m v δ/τ.

    τ, the time in which a body deviates by δ, is the length of a long step. If errors of `Thresholds.tolerable` δ are
    proportional to the motion, rates have the same relative error as positions, and energies twice that error. An
    implicit method damps vibrations with amplitudes below δ at any frequency, and these may contain all the energy, or
    the work of a drive. Such a run is `compared` with a second run, if there is one, which decides. δ is at least the
    `least` tolerance [m].
    """
    if not run.controlled or run.duration == 0:
        return balance.NOTHING
    momentum = math.sqrt(2 * chain.mass) * Thresholds.long / run.duration
    share = 2 * Thresholds.tolerable if explicit else math.inf
    part = run.tolerance_within(1.0) if run.accuracy == "deflection" else 0.0
    δ = max(tolerance_of(run, chain, 0.0), least)
    return Allowance(δ, part, chain.weight, momentum, share, not explicit, compared)


def probed(run: RunSettings, rows: slice) -> Indices:
    """Indices of the samples after which the error of a step is measured."""
    every = samples_apart(run)
    return np.arange(-(-rows.start // every) * every, rows.stop, every)


def samples_apart(run: RunSettings) -> int:
    """Number of samples between two measured steps."""
    fewest = 64  # minimum number of measured steps in a run with enough steps
    steps_apart = min(APART, (run.samples - 1) * run.steps_per_sample // fewest)
    return max(1, -(-steps_apart // run.steps_per_sample))


# The stated error of a run with a tolerance: from the errors of its steps, or by comparison with another run.
#
# The error estimate of a step is that of an embedded formula of lower order, a hundred times the step's own error; only
# what lasts is dangerous. A rate that a sampled law reads becomes a torque that is held for a whole period, so the
# estimated errors of such rates add up (`read_by`), and so do those of joints that nothing holds
# (`Thresholds.lasting`). Other errors of a motion that does not amplify them are less than a tolerance
# (`Thresholds.usual`).


Monitor = Any  # the `Monitor` of a run, which imports this file


def read_by(rule: Method) -> tuple[float, float]:
    """How a method misjudges rates that a sampled law reads: two factors of their estimated displacement by a step.

    The first gives the error of the run: measured on robots with modes of 20 to 300 Hz and laws of 50 Hz to 2 kHz, the
    error is this factor times the sum of the displacements, within a factor of 2. The second gives the error of a step,
    so that steps follow the vibrations that the law reads: the filter of implicit methods hides them.
    """
    if rule.explicit:
        return 1.0, 2.0
    return (1.0, 10.0) if rule.stages >= 5 else (5.0, 60.0)


def stated_of(monitor: Monitor) -> StatedError:
    """The error of a run with a tolerance that its steps state."""
    return _described(monitor, monitor, estimated_error(monitor), {})


def compared_with(other: Monitor, run: Monitor, first: Monitor) -> StatedError:
    """The error of a run that may replace the `first`: their distance, at least `seen` as two may agree by chance."""
    one, two, n = run.record, other.record, run.n_valid
    end = two.state(other.n_valid - 1)
    tip, before = apart(one.compared(n), two.compared(other.n_valid)[-n:]), first.before
    if before is not None and two.t[0] == one.t[0] and np.array_equal(two.q[0], one.q[0]):  # both begin in one state
        tip += before.tip[-1]
    tip = np.maximum(tip, Thresholds.seen * first.tolerance)
    found = _described(run, first, tip, _outputs_apart(run, other))
    return found._replace(compared=True, end=end, delayed=two.inputs.drive.delayed(end.t))


def shown_by(coarser: Monitor, run: Monitor) -> StatedError:
    """The error of a run from its distance to a coarser one, with which a run that continues it is not compared."""
    found = compared_with(coarser, run, run)
    tip = np.maximum(found.tip / Thresholds.shrinks, Thresholds.usual * run.tolerance)
    return found._replace(tip=tip, end=None, delayed=None)


def _described(run: Monitor, first: Monitor, tip: Array, outputs: dict[str, Array]) -> StatedError:
    start, travelled, drifting, drifted = first.record.state(0), run.travelled, run.drifting, displaced(run).item(-1)
    if (before := first.before) is not None:
        start, travelled, drifting = before.start, before.travelled + travelled, before.drifting + drifting
    tip.setflags(write=False)
    return StatedError(tip, first.tolerance, False, outputs, start, travelled, drifting, drifted)


def displaced(run: Monitor) -> Array:
    """Estimated displacement by errors of rates that last [m], in this and earlier runs, at the valid samples."""
    own, before, t = run.record.so_far[: run.n_valid, SO_FAR.drifted], run.before, run.record.t
    return own if before is None else np.asarray(own + before.drifted + before.drifting * (t[: run.n_valid] - t[0]))


def extrapolated(found: StatedError, run: Monitor, coarser: Monitor) -> StatedError:
    """The error of a run without a finer one, from a coarser run's, which shrinks as tolerances, and its own steps."""
    return found._replace(tip=found.tip * run.tolerance / coarser.tolerance + estimated_error(run))


def _outputs_apart(run: Monitor, other: Monitor) -> dict[str, Array]:
    """Distance of what is read besides the tip, by name with unit: sensors, and the outputs that the run lists."""
    if not run.record.follows_vibrations or run.record.base is not None:
        return {}
    one, two = (each.record.trajectory(each.n_valid) for each in (run, other))
    listed = {"loads": ("moment [N m]", "force [N]"), "torques": ("tau [N m]",)}
    own = 0.5  # the error of the other run is at most half of the distance, as it has a smaller tolerance
    part = Thresholds.usual * run.tolerance / run.record.chain.size  # of the largest value so far, as for the tip
    found = {}
    for name in (*one.sensor_names, *(name for kind in run.run.outputs for name in listed[kind])):
        a, b = (_output(each, name, len(one.t)) for each in (one, two))
        found[name] = np.maximum(np.abs(a - b).max(axis=1) / own, part * np.maximum.accumulate(np.abs(a).max(axis=1)))
    return found


def _output(run: RunSamples, name: str, rows: int) -> Array:
    """The last `rows` samples of a sensor, of loads or of torques, (rows, values)."""
    if name in run.sensor_names:
        values = run.readings[name]
    else:
        values = run.tau if name.startswith("tau") else np.asarray(getattr(run.loads, name.split(maxsplit=1)[0]))
    return values[-rows:].reshape(rows, -1)


def estimated_error(monitor: Monitor) -> Array:
    """Error of the tip at the valid samples [m], from the errors of the steps and the error handed on."""
    n, before, so_far = monitor.n_valid, monitor.before, monitor.record.so_far
    least = Thresholds.usual * monitor.tolerance
    handed_on, drifted = (0.0, 0.0) if before is None else (float(before.tip[-1]), before.drifted)
    found = np.full(n, handed_on)
    if so_far.item(n - 1, SO_FAR.drifted) > 0.0 or before is not None:
        found += Thresholds.lasting * (displaced(monitor) - drifted)
    if so_far.item(n - 1, SO_FAR.kicked) > 0.0:
        kicked = np.diff(so_far[:n, SO_FAR.kicked], prepend=0.0)
        rows = [(row, read_by(method(name))[0]) for row, name, _ in monitor.methods]
        for (first, error), (stop, _) in itertools.pairwise([*rows, (n, 0.0)]):
            kicked[first:stop] *= error
        found += kicked.cumsum()
    return np.asarray(np.maximum(found, least, out=found))
