"""Time for a given error with SciPy's solvers and CVODE on flexlink's forward dynamics, called from Python."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import FlexlinkError, MissingDependencyError
from validation.trade.first_order import FirstOrder
from validation.trade.scenes import point, seen, trade_scene
from validation.trade.work_precision import Point


def points(name: str, solver: str, tolerances: Sequence[float]) -> list[Point]:
    """Run once for each relative tolerance; the absolute tolerance is a hundredth of it. CVODE must be installed."""
    form = FirstOrder(trade_scene(name))
    for y in (form.start, np.vstack([form.start, form.start])):  # compile before timing
        form(0.0, y)
    return [_point(name, form, solver, relative) for relative in tolerances]


def _point(name: str, form: FirstOrder, solver: str, relative: float) -> Point:
    begun = time.thread_time()
    try:
        solved = form.by(solver, relative)
    except MissingDependencyError:
        raise
    except FlexlinkError:
        return Point(relative, math.inf, 0.0)
    seconds = time.thread_time() - begun
    return point(name, seen(form.chain, solved.q), relative, seconds, solved.evaluations)
