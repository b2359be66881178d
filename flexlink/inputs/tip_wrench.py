"""A scene's tip wrench as the arrays that the kernels read, and its value at the start."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.inputs.interpolation import held_knots, pieces_of
from flexlink.kernels.bodies.branches import loaded_body, path_to
from flexlink.kernels.inputs.record import GivenWrench, Inputs, WrenchTable, given_at


def wrench_table(scene: Scene, chain: Chain) -> WrenchTable | None:
    """The scene's tip wrench if it is not a constant one, in frame 0, on the arm's tip, whose motion tells its work.

    Raises
    ------
    SceneError
        It changes by more than float64 can hold.
    """
    wrench = scene.wrench
    if not wrench.varies and (not wrench.acts or chain.loaded == len(chain.bodies) - 1):
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
    path = path_to(chain.bodies, loaded_body(chain.bodies))
    return WrenchTable(wrench.frame == "tip", knots, coefficients, chain.arrays, path)


def initial_wrench(scene: Scene, chain: Chain) -> tuple[Array, Frame]:
    """The wrench at the start of a scene, shape (6,), and its axes; errors as in `wrench_table`."""
    table = wrench_table(scene, chain)
    return (scene.tip_wrench, "world") if table is None else _with_frame(given_at(table, scene.initial.time))


def wrench_at(inputs: Inputs, t: float) -> tuple[Array, Frame]:
    """The wrench at time t [s], shape (6,), and its axes."""
    return _with_frame(inputs.given_wrench(t))


def _with_frame(given: GivenWrench) -> tuple[Array, Frame]:
    return given.tip_wrench, "tip" if given.follower else "world"
