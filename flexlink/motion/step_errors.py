"""Errors of fixed steps at the tip: one step of h against two of h/2, from samples that stand for all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method
from flexlink.kernels.bodies.kinematics import tip_points
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate
from flexlink.kernels.tools.machine_code import direct
from flexlink.results.record import Record


def step_errors(record: Record, probed: NDArray[np.intp]) -> Array:
    """Distance of the tips after one step of h and after two of h/2 [m], from the samples `probed` of a run."""
    tips = _tips(*_ends(record, record.scratch, (record.q, record.qd), probed), [record])
    return np.asarray(tips[0])


def step_errors_side_by_side(
    records: Sequence[Record], scratch: Any, samples: tuple[Array, Array], probed: NDArray[np.intp]
) -> Array:
    """`step_errors` of eight runs from their samples (rows, n, 8), with their scratch; shape (8, probed)."""
    one, two = _ends(records[0], scratch, samples, probed)
    return _tips(one, two, records)


def _ends(record: Record, scratch: Any, samples: tuple[Array, Array], probed: NDArray[np.intp]) -> tuple[Array, Array]:
    """Angles (probed, n), or (probed, n, 8), after one step of h and after two of h/2."""
    run, shape = record.run, samples[0].shape[1:]
    none = *np.empty((2, 0, *shape)), np.empty((0, *shape[1:]))
    ends, rates, work = np.empty((2, len(probed), *shape)), np.empty(shape), np.zeros((1, *shape[1:]))
    drive = record.inputs.drive._replace(next_instant=np.array([NEVER]))  # a sampled law is not asked by these steps
    fixed = scratch, method(run.method).arrays, record.inputs._replace(drive=drive)
    for parts, (row, sample) in product((1, 2), enumerate(probed)):
        q = ends[parts - 1, row]
        q[:], rates[:] = samples[0][sample], samples[1][sample]
        origin = parts * (record.origin + int(sample) * run.steps_per_sample)
        arguments = *fixed, run.step / parts, origin, 0, parts, NEVER, (q, rates, work), none
        record.kept("probed steps", len(shape), partial(direct, integrate, *arguments))(*arguments)
    return ends[0], ends[1]


def _tips(one: Array, two: Array, records: Sequence[Record]) -> Array:
    """Distances of the tips of arms at two angles each, shape (arms, rows)."""
    tips = np.empty((2, len(records), len(one), 3))
    for part, angles in enumerate((one, two)):
        for arm, record in enumerate(records):
            own = np.ascontiguousarray(angles.reshape(*angles.shape[:2], len(records))[..., arm])
            tip_points(record.chain.arrays, own, tips[part, arm])
    return np.asarray(np.linalg.norm(tips[1] - tips[0], axis=-1))
