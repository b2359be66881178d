"""Fixed steps of an arm whose base may be free; when the base has turned far, its coordinates change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.floating_base import ANGLES, FAR
from flexlink.results.record import Record

Arrays = tuple[Array, Array, Array]
"""Angles q, rates q̇ and work W."""


def far_of(record: Record) -> float:
    """Rotation of a free base at which its coordinates change [rad]; inf if the base is fixed."""
    return np.inf if record.base is None else FAR


def is_far(record: Record, q: Array) -> bool:
    """Whether the base is free and has turned beyond `FAR` at angles q (n,)."""
    return record.base is not None and bool(np.abs(q[ANGLES]).max() > FAR)


def advance(
    go: Callable[..., Any],
    fixed: tuple[Any, ...],
    first: int,
    stop: int,
    rest: tuple[int, Arrays, Arrays],
    record: Record,
) -> int:
    """Integrate to step `stop`; return the number of the last step with a finite state.

    If a free base has turned far, its coordinates change, even at step `stop`: later steps do not depend on `stop`.
    """
    far, (every, (q, qd, _), _) = far_of(record), rest
    done = int(go(*fixed, first, stop, far, *rest))
    while record.base is not None and (done < stop or is_far(record, q)) and np.isfinite([q, qd]).all():
        record.base.turn(done // every + 1, q, qd, record.scratch)
        done = int(go(*fixed, done, stop, far, *rest))
    return done
