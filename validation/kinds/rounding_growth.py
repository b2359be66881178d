"""Growth of rounding errors in a chaotic motion, and how long they explain the difference between engines.

The errors are measured with the library alone: the initial angles change by one unit in the last place, up or down, or
another solver for q̈ is used. The largest of these differences up to time t is the effect of rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.engines import load
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Fact
from validation.runs import motion_series, points_of
from validation.store import Series

LONG = True


def run(
    case: Case, engines: tuple[str, ...], duration: Positive, step: Positive, parted: Positive = 1e-3
) -> Iterator[Measured | Series]:
    """Yield the growth rate, the horizon, and the largest ratio of an engine's difference to the effect of rounding.

    Runs have a duration and step [s]; the horizon ends at a difference of `parted` [rad].
    """
    for short in case.load_scenes():
        yield from motion_series(short, simulate(short))
        scene = short.varied({"run.duration": duration, "run.step": step})
        ours = simulate(scene)
        own = np.max([_running_max(other, ours.q) for other in _own_differences(scene)], axis=0)
        apart = own >= parted
        end = int(np.argmax(apart)) if apart.any() else len(own)
        within = slice(1, end)
        rate = float(np.polyfit(ours.t[within], np.log(own[within]), 1)[0])
        ulps = 0.5 * math.sqrt(1 / (rate * step))  # random sum of half an ulp per step over one e-folding time
        facts: dict[str, Fact] = {"method": scene.run.method, "step": scene.run.fixed_step}
        yield Measured("growth rate", rate, scene.name, varied=facts)
        yield Measured("horizon", float(ours.t[end - 1]), scene.name, varied=facts)
        curves = {"time [s]": ours.t, "native, one ulp or another solver": own}
        for name in engines:
            t, q, qd = load(name, ours.chain).integrate(scene)
            begun = (part[: short.run.samples] for part in (t, q, qd))
            yield from motion_series(short, points_of(short, ours.chain, *begun), name)
            curves[name] = _running_max(q, ours.q)
            ratio = float((curves[name][within] / own[within]).max())
            upto = facts | {"duration": float(ours.t[end - 1])}
            yield Measured("difference / rounding growth", ratio, scene.name, name, upto, scale=ulps)
            at_end = float(curves[name][short.run.samples - 1])
            yield Measured("max |Δq|", at_end, scene.name, name, facts | {"duration": short.run.duration})
        title = f"{scene.name}: difference up to time t"
        yield Series(
            "growth", title, curves, "time [s]", "time [s]", "max |Δq| up to t [rad]", y_scale="log", scene=scene.name
        )


def _own_differences(scene: Scene) -> Iterator[Array]:
    for solver in SOLVERS:
        if solver != scene.run.solver:
            yield simulate(scene, solver=solver).q
    for k, angle in enumerate(scene.initial.joint_deg):
        for way in (-np.inf, np.inf):
            if angle and not scene.arm.links[k].joint.locked:
                yield simulate(scene.varied({f"initial.joint_deg.{k + 1}": np.nextafter(angle, way)})).q


def _running_max(q: Array, reference: Array) -> Array:
    differences: Array = np.maximum.accumulate(np.abs(q - reference).max(axis=1))
    return differences
