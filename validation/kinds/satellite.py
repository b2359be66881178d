"""A tumbling satellite: attitude and spin against Euler's equations in SciPy, momentum against conservation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from validation.case import Case, Measured
from validation.oracles.rigid_motions import Body, rotation


def run(case: Case, ways: tuple[dict[str, str | float], ...]) -> Iterator[Measured]:
    """Yield relative errors of attitude, spin and momenta for every integration method."""
    for scene in case.load_scenes():
        for way in ways:
            run = fl.simulate(
                scene.varied({"run": {"duration": scene.run.duration, "sample": scene.run.sample, **way}})
            )
            for quantity, error in _errors(scene, run).items():
                yield Measured(quantity, error, scene.name, varied=way)


def _errors(scene: fl.Scene, run: fl.Trajectory) -> dict[str, float]:
    body, start = _whole(scene), scene.initial.base
    assert start.quaternion is not None and start.spin is not None and run.base is not None
    attitude, spin = body.tumbling(np.array(start.quaternion), np.array(start.spin), run.t)
    R0, ω0 = rotation(np.array(start.quaternion)), np.array(start.spin)
    velocity = np.array(start.velocity) + R0 @ np.cross(ω0, body.center)
    center = np.array(start.xyz) + R0 @ body.center + np.multiply.outer(run.t, velocity)
    turning = R0 @ body.inertia @ ω0
    momentum = fl.momentum(run.chain, run.q, run.qd)
    sides = np.sign(np.sum(run.base.attitude * attitude, axis=1))[:, None]  # ±1: q and −q are the same attitude
    pairs = {
        "attitude": (run.base.attitude * sides, attitude),
        "spin of the base": (run.base.spin, spin),
        "linear momentum": (run.base.momentum.linear, np.tile(body.mass * velocity, (len(run.t), 1))),
        "angular momentum": (run.base.momentum.angular, turning + np.cross(center, body.mass * velocity)),
        "momentum about the centre": (run.base.momentum.spin, np.tile(turning, (len(run.t), 1))),
        "momentum of the states": (momentum.spin, np.tile(turning, (len(run.t), 1))),
        "centre of mass": (run.base.momentum.center, center),
    }
    return {name: _apart(found, exact) for name, (found, exact) in pairs.items()}


def _apart(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _whole(scene: fl.Scene) -> Body:
    """Base and boom as one body, in axes of the base, from the values in the scene's file."""
    base, (boom,) = scene.arm.base, scene.arm.links
    on = np.array(boom.mount.xyz)
    parts = (
        Body(each.mass, place + each.center, np.diag(each.inertia)) for each, place in ((base, 0 * on), (boom.hub, on))
    )
    first, second = parts
    return first.with_another(second)
