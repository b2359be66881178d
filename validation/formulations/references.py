"""References of the tasks: motions of inextensible rods, the roll-up in closed form, two programs that agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from validation.reference_values import look_up, reference_array

CLOSED_FORM = "roll-up"
OWN_ERRORS = {"single_link_torque_pulse": 4e-12, "spinup_kane_simo": 2e-10}
"""Accuracy of references that do not state it themselves [m]."""


class Reference(NamedTuple):
    """Tip in frame 0, shape (samples, 3) [m], and its own error [m]."""

    tip: Array
    own_error: float


def reference(name: str, axes: Array, length: float, turns: float) -> Reference:
    """The reference of that name; planar ones are in the plane of the first two `axes`.

    `length` and `turns` of the tip are for the roll-up: the rod becomes an arc of a circle. Without a
    name there is none.
    """
    if not name:
        return Reference(np.empty((0, 3)), float("nan"))
    if name == CLOSED_FORM:
        angle = 2 * np.pi * turns
        arc = length / angle * np.array([np.sin(angle), 1 - np.cos(angle)])
        return Reference((arc @ axes[:, :2].T)[None], 0.0)
    if name in OWN_ERRORS:
        plane = reference_array(name, "values")[:, :2]
        return Reference(plane @ axes[:, :2].T, OWN_ERRORS[name])
    return Reference(reference_array(name, "tip"), float(look_up(name, "own_error_m")))
