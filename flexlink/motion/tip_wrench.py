"""A scene's tip wrench as what the kernels read, and what acts at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain, ChainArrays
from flexlink.describe.scene import Scene
from flexlink.kernels.tip_wrench import put_given
from flexlink.motion.interpolation import held_knots, pieces_of

Array = NDArray[np.float64]


class WrenchTable(NamedTuple):
    """F = Σ_j c_j x^j, x = time since the last knot, in axes of frame 0 or, if it follows, of the tip."""

    follows: bool
    knots: Array  # (m,) [s]
    coefficients: Array  # (m, order + 1, 6) [N / s^j, N m / s^j]
    chain: ChainArrays  # at whose tip it acts


def wrench_table(scene: Scene, chain: Chain) -> WrenchTable | None:
    """The scene's tip wrench if it is not constant in frame 0.

    Raises
    ------
    SceneError
        It changes by more than float64 can hold.
    """
    wrench = scene.wrench
    if not wrench.varies:
        return None
    times = np.array(wrench.times or (0.0,))
    tables = {"forces": wrench.forces or (wrench.force,), "moments": wrench.moments or (wrench.moment,)}
    rows = {name: np.zeros((len(times), 3)) + table for name, table in tables.items()}
    if wrench.times is None or wrench.hold:
        knots, parts = held_knots(times), [table[:, None] for table in rows.values()]
    else:
        knots = times
        parts = [pieces_of(f"wrench.{name}", times, table, smooth=wrench.smooth) for name, table in rows.items()]
    coefficients = np.ascontiguousarray(np.concatenate(parts, axis=2))
    return WrenchTable(wrench.frame == "tip", knots, coefficients, chain.arrays)


class GivenWrench(NamedTuple):
    """What `analysis` takes of a wrench that does not change with time, as `solve_static` and `modes`."""

    tip_wrench: Array  # (6,)
    follower: bool  # it is in axes of the tip frame


def initial_wrench(scene: Scene, chain: Chain) -> GivenWrench:
    """The wrench that a scene starts under; errors as in `wrench_table`."""
    table = wrench_table(scene, chain)
    return GivenWrench(scene.tip_wrench, False) if table is None else given_at(table, scene.initial.time)


def given_at(table: WrenchTable, t: float) -> GivenWrench:
    """The wrench of a table at time t [s]."""
    given = np.empty(6)
    put_given(table, t, t, given)
    return GivenWrench(given, table.follows)
