"""A scene's tip wrench as the arrays that the kernels read, and at its start or at another time."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.kernels.geometry.branches import loaded_body, path_to
from flexlink.kernels.inputs.record import GivenWrench, Inputs, Loads, given_at
from flexlink.motion.inputs.references import held_knots, pieces_of


def initial_wrench(scene: Scene, chain: Chain) -> tuple[Array, Frame]:
    """The wrench at the start of a scene, shape (6,), and the frame of its axes; errors as in `loads_of`."""
    loads = loads_of(scene, chain)
    return (scene.tip_wrench, "world") if loads is None else _with_frame(given_at(loads, scene.initial.time))


def wrench_at(inputs: Inputs, t: float) -> tuple[Array, Frame]:
    """The wrench at time t [s], shape (6,), and the frame of its axes."""
    return _with_frame(inputs.given_wrench(t))


def _with_frame(given: GivenWrench) -> tuple[Array, Frame]:
    return given.tip_wrench, "tip" if given.follower else "world"


def loads_of(scene: Scene, chain: Chain) -> Loads | None:
    """The tip wrench; None if it is constant and acts on the arm's tip.

    In that case its work follows from the motion of the tip in frame 0.

    Raises
    ------
    SceneError
        The wrench changes by more than float64 can represent.
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
    return Loads(True, wrench.frame == "tip", knots, coefficients, chain.arrays, path)


def no_loads(chain: Chain) -> Loads:
    """Empty loads, for an arm whose wrench is constant and acts on its tip."""
    return Loads(False, False, np.zeros(1), np.zeros((1, 1, 6)), chain.arrays, np.empty(0, np.int64))
