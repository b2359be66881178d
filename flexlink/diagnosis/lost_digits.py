"""Numbers of a file that differ from the expected ones only by the digits with which they were written."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Indices
from flexlink.diagnosis.joint_axes import displaced_joints, reach
from flexlink.diagnosis.shapes import Discrepancy, fewer_digits
from flexlink.engines.read_back import AXIS_FIELDS, JOINT_FIELDS, ReadBack

LOST = 1e-4
"""Largest relative difference that counts as lost digits if other numbers differ by more."""


def lost_digits(differing: Mapping[str, Discrepancy]) -> dict[str, Discrepancy]:
    """Return, by field, the entries that differ only by lost digits."""
    fields = {"lines", "masses", "centers", "inertias", *JOINT_FIELDS} & differing.keys()
    few = {field: differing[field].only(_shortened(field, differing[field])) for field in fields}
    return {field: diff for field, diff in few.items() if len(diff.rows)}


def with_entries(read: ReadBack, other: ReadBack, lost: Mapping[str, Discrepancy]) -> ReadBack:
    """Return the record with the entries of these fields and joints taken from the other record."""
    changed: dict[str, Any] = {}
    for field, diff in lost.items():
        for name in AXIS_FIELDS if field == "lines" else (field,):
            changed[name] = with_rows(getattr(read, name), getattr(other, name), diff.rows)
    if "axes" in changed:  # a flipped axis remains flipped
        changed["axes"] *= np.sign(np.einsum("ij,ij->i", changed["axes"], read.axes))[:, None]
    return dataclasses.replace(read, **changed)


def with_rows(ours: Array, theirs: Array, rows: Indices) -> Array:
    """Our numbers with some rows replaced by theirs; pairs of joints, rows (m, 2), replace K_ij and K_ji."""
    mixed = ours.copy()
    if rows.ndim == 1:
        mixed[rows] = theirs[rows]
    else:
        i, j = rows.T
        mixed[i, j] = mixed[j, i] = theirs[i, j]
    return mixed


def _shortened(field: str, diff: Discrepancy) -> NDArray[np.bool_]:
    """Whether each entry differs little; a scalar must also have a short number of digits in one of the records."""
    if field == "lines":
        return ~np.isin(diff.rows, displaced_joints(diff.our_record, diff.their_record, LOST))
    size = np.abs(diff.ours).reshape(len(diff.rows), -1).max(axis=1)
    near = np.asarray(diff.errors <= LOST * (reach(diff.our_record) if field == "centers" else size))
    return near if diff.ours.ndim > 1 else near & [_is_short(diff.only([k])) for k in range(len(near))]


def _is_short(diff: Discrepancy) -> bool:
    return fewer_digits(diff) or fewer_digits(diff._replace(ours=diff.theirs, theirs=diff.ours))
