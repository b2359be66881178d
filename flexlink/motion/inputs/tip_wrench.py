"""A scene's tip wrench at its start or at another time."""

from __future__ import annotations

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.kernels.inputs.record import GivenWrench, Inputs, given_at
from flexlink.motion.inputs.loads import loads_of


def initial_wrench(scene: Scene, chain: Chain) -> tuple[Array, Frame]:
    """The wrench at the start of a scene, shape (6,), and the frame of its axes; errors as in `loads_of`."""
    loads = loads_of(scene, chain)
    return (scene.tip_wrench, "world") if loads is None else _with_frame(given_at(loads, scene.initial.time))


def wrench_at(inputs: Inputs, t: float) -> tuple[Array, Frame]:
    """The wrench at time t [s], shape (6,), and the frame of its axes."""
    return _with_frame(inputs.given_wrench(t))


def _with_frame(given: GivenWrench) -> tuple[Array, Frame]:
    return given.tip_wrench, "tip" if given.follower else "world"
