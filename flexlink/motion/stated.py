"""The stated error of a run with a tolerance: from the errors of its steps, or by comparison with another run.

The error estimate of a step is that of an embedded formula of lower order, a hundred times the step's own error; only
what lasts is dangerous. A rate that a sampled law reads becomes a torque that is held for a whole period, so the
estimated errors of such rates add up (`read_by`), and so do those of joints that nothing holds (`Thresholds.lasting`).
Other errors of a motion that does not amplify them are less than a tolerance (`Thresholds.usual`).
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.schemes.methods import Method, method
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.motion.tolerable import Thresholds
from flexlink.results.samples import RunSamples, State, StatedError
from flexlink.results.tip_motion import apart

Monitor = Any
"""The `Monitor` of a run, which imports this file."""


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
    """The error of a run that may replace the `first` one: its distance to another run, which may begin earlier.

    Two runs may agree by chance, so it is at least `Thresholds.seen`.
    """
    one, two, n = run.record, other.record, run.n_valid
    end = two.state(other.n_valid - 1)
    tip, before = apart(one.compared(n), two.compared(other.n_valid)[-n:]), first.before
    if before is not None and two.t[0] == one.t[0] and np.array_equal(two.q[0], one.q[0]):  # both begin in one state
        tip += before.tip[-1]
    tip = np.maximum(tip, Thresholds.seen * first.tolerance)
    return _described(run, first, tip, _outputs_apart(run, other), end, two.inputs.drive.delayed(end.t))


def shown_by(coarser: Monitor, run: Monitor) -> StatedError:
    """The error of a run from its distance to a coarser one, with which a run that continues it is not compared."""
    found = compared_with(coarser, run, run)
    tip = np.maximum(found.tip / Thresholds.shrinks, Thresholds.usual * run.tolerance)
    return found._replace(tip=tip, end=None, delayed=None)


def _described(
    run: Monitor,
    first: Monitor,
    tip: Array,
    outputs: dict[str, Array],
    end: State | None = None,
    delayed: Array | None = None,
) -> StatedError:
    record = first.record
    start = record.state(0)
    travelled, drifting, drifted = run.travelled, run.drifting, float(displaced(run)[-1])
    if (before := first.before) is not None:
        start, travelled, drifting = before.start, before.travelled + travelled, before.drifting + drifting
    tip.setflags(write=False)
    return StatedError(
        tip, first.tolerance, end is not None, outputs, start, travelled, drifting, drifted, end, delayed
    )


def displaced(run: Monitor) -> Array:
    """Estimated displacement by errors of rates that last [m], in this and earlier runs, at the valid samples."""
    own, before, t = run.record.so_far[: run.n_valid, SO_FAR.drifted], run.before, run.record.t
    return np.asarray(own if before is None else own + before.drifted + before.drifting * (t[: run.n_valid] - t[0]))


def extrapolated(found: StatedError, run: Monitor, coarser: Monitor) -> StatedError:
    """The error of a run that no finer one confirms, from the error `found` of a coarser run: it shrinks as tolerances.

    Errors of the run's own steps are added.
    """
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
    handed_on, drifted = (0.0, 0.0) if before is None else (float(before.tip[-1]), before.drifted)
    found = np.full(n, handed_on)
    if so_far[n - 1, SO_FAR.drifted] > 0.0 or before is not None:
        found += Thresholds.lasting * (displaced(monitor) - drifted)
    if so_far[n - 1, SO_FAR.kicked] > 0.0:
        kicked = np.diff(so_far[:n, SO_FAR.kicked], prepend=0.0)
        rows = [(row, read_by(method(name))[0]) for row, name, _ in monitor.methods]
        for (first, error), (stop, _) in itertools.pairwise([*rows, (n, 0.0)]):
            kicked[first:stop] *= error
        found += kicked.cumsum()
    return np.asarray(np.maximum(found, Thresholds.usual * monitor.tolerance))
