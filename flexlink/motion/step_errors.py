"""Tip errors of fixed steps: one step h is compared with two steps h/2, at samples that represent all steps.

The functions that sum over all steps also accept several runs side by side, along a first axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.dynamics import rounding
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.runge_kutta import NEVER, probe
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion import tolerable
from flexlink.results.record import Record
from flexlink.results.tip_motion import apart, compared_path


def step_errors(record: Record, probed: NDArray[np.intp]) -> Array:
    """Distance between the tips after one step h and after two steps h/2 [m], from the `probed` samples of a run."""
    samples, found = (record.q, record.qd), [np.empty(0)]
    for part in record.parts(int(probed[0]), int(probed[-1]) + 1) if len(probed) else ():
        rows = probed[(probed >= part.start) & (probed < part.stop)]
        found.append(_tips(*_ends(record, record.scratch, record.inputs, samples, rows), [record])[0])
    return np.concatenate(found)


def step_errors_side_by_side(
    records: Sequence[Record], scratch: Any, inputs: Inputs, samples: tuple[Array, Array], probed: NDArray[np.intp]
) -> Array:
    """`step_errors` of up to eight runs from their samples (rows, n, 8); shape (runs, probed).

    `scratch` and `inputs` are those of the runs side by side.
    """
    one, two = _ends(records[0], scratch, inputs, samples, probed)
    return _tips(one, two, records)


def summed(run: RunSettings, errors: Array, size: Array) -> Array:
    """Sum of the errors of all steps [m], shape (…), from errors of the probed steps (…, probed) and arm size (…).

    Errors below the rounding error of the tip position are treated as zero.
    """
    counted = np.where(errors < rounding.of_reach(1.0) * size[..., None], 0.0, errors)
    return np.asarray(counted.sum(axis=-1) * tolerable.apart(run) * run.steps_per_sample)


def rounded_away(run: RunSettings, q: Array, qd: Array, size: Array) -> Array:
    """Tip motion [m], shape (…), that N fixed steps may lose by rounding q + h q̇: N h q̇, at most N ulp(q)/2.

    The samples are (…, rows, n), of arms of size (…). The result is zero for angles of a few turns, where the loss does
    not exceed the usual rounding error.
    """
    most, steps = np.spacing(np.abs(q).max(axis=-2)) / 2, q.shape[-2] * run.steps_per_sample
    if (most.sum(axis=-1) <= rounding.of_reach(1.0)).all():
        return np.zeros(size.shape)
    lost = np.minimum(run.fixed_step * np.abs(qd).max(axis=-2), most).sum(axis=-1) * size
    return np.where(lost > rounding.of_reach(1.0) * size, lost * steps, 0.0)


def _ends(
    record: Record, scratch: Any, inputs: Inputs, samples: tuple[Array, Array], probed: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Angles (probed, n), or (probed, n, 8), after one step h and after two steps h/2."""
    run = record.run
    ends = np.empty((2, len(probed), *samples[0].shape[1:]))
    drive = inputs.drive._replace(next_instant=np.array([NEVER]))  # these steps do not evaluate a sampled law
    inputs, origins = inputs._replace(drive=drive), record.origin + probed * run.steps_per_sample
    arguments = scratch, method(run.method).arrays, inputs, run.fixed_step, origins, probed, samples, ends
    record.kept("probed steps", ends.ndim, lambda: direct(probe, *arguments))(*arguments)
    return ends[0], ends[1]


def _tips(one: Array, two: Array, records: Sequence[Record]) -> Array:
    """Distance of each arm's tip between two configurations, shape (arms, rows)."""
    found = np.empty((len(records), len(one)))
    for arm, record in enumerate(records):
        paths = (np.ascontiguousarray(part[..., arm] if part.ndim > 2 else part) for part in (one, two))
        found[arm] = apart(*(compared_path(record.chain, path) for path in paths))
    return found
